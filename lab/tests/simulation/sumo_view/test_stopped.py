"""A vehicle that breaks down in SUMO's traffic, as the edge sees it in the pictures."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from edge_daemon.camera import load_camera
from edge_daemon.detection import open_detector
from edge_daemon.pipeline import Pipeline
from edge_daemon.settings import TrackSettings
from edge_daemon.sources.clip import FastClip, open_clip
from slipstream.messages import StoppedVehicles
from slipstream_lab.simulation.ground_truth import load_truth
from slipstream_lab.simulation.sumo_view import SumoClipSettings, render_sumo_clip
from slipstream_lab.simulation.sumo_view.examples import find_net, find_routes, find_rsu

BROKEN = """
    <vType id="plain" vClass="passenger" length="4.55" width="1.83" carFollowModel="IDM"/>
    <vehicle id="broken" type="plain" depart="40" departPos="180" departSpeed="10" departLane="0">
        <route edges="west-2 west-3 west-4"/>
        <stop lane="west-2_0" endPos="233" duration="14"/>
    </vehicle>
</routes>"""


@pytest.mark.nightly
def test_a_breakdown_beside_flowing_traffic_is_one_event(tmp_path: Path) -> None:
    """It is told from six seconds after it stands until two after it moves on, once, in its lane
    and place, though the other lane's traffic hides it at times.
    """
    # Its own lane is free; in the other one a vehicle comes by every 2.6 s.
    routes = re.sub(
        r'    <flow id="calm-3".*?/>\n', "", find_routes("calm").read_text(), flags=re.S
    )
    file = tmp_path / "broken.rou.xml"
    file.write_text(routes.replace("</routes>", BROKEN))
    settings = SumoClipSettings(
        net=find_net("avenue"),
        routes=(file,),
        additional=(),
        rsu=find_rsu("approach"),
        seconds=26.0,
        fps=10.0,
        begin_s=44.0,
        seed=5,
    )
    render_sumo_clip(settings, tmp_path / "clip")
    truth = load_truth(tmp_path / "clip" / "truth.csv")
    still = truth.take(truth.speed_mps < 0.1)
    assert len(np.unique(still.vehicle)) == 1
    begin_s, end_s = float(still.time_s[0]), float(still.time_s[-1])
    assert end_s - begin_s > 12

    # It creeps to its place: arrived is who has a metre left.
    own = truth.take(truth.vehicle == still.vehicle[0])
    left_m = np.hypot(*(own.centre_m - still.centre_m[0]).T)
    arrived_s = float(own.time_s[(left_m < 1.0).argmax()])

    camera, track = load_camera(tmp_path / "clip" / "camera.toml"), TrackSettings()
    detector = open_detector(track.detector, camera)
    pipeline = Pipeline("r", camera, detector, track.stability, track.window_s)
    told: list[tuple[float, StoppedVehicles]] = []
    due_s = 0.0
    clip = open_clip(tmp_path / "clip" / "video.mp4", loop=False, size=camera.size)
    for frame in FastClip(clip).frames():
        pipeline.process(frame)
        if frame.media_time_s >= due_s:
            due_s += 1.0
            states = pipeline.states(round(frame.media_time_s * 1e9))
            told += [(frame.media_time_s, pipeline.stopped(state)) for state in states]
    times = [time_s for time_s, message in told if message.vehicles]
    assert begin_s + 3 < times[0] < begin_s + 7
    assert end_s - 1 < times[-1] < end_s + 3
    assert len(times) == round(times[-1] - times[0]) + 1
    segment = next(each for each in camera.segments if each.id == "west-2")
    place_m = float(segment.along(still.centre_m[:1])[0]) - segment.begin_m
    for message in (message for _, message in told if message.vehicles):
        (vehicle,) = message.vehicles
        assert message.segment == "west-2"
        assert vehicle.lane == 0
        assert vehicle.along_m == pytest.approx(place_m, abs=2.0)
        assert vehicle.since_ns / 1e9 == pytest.approx(arrived_s, abs=2.0)
