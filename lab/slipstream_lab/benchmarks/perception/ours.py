"""Our whole pipeline on a clip, every frame: decoding, watch, detection, tracking, states.

The parts are the edge daemon's own; only the bus is missing. `python -m
slipstream_lab.benchmarks.perception.ours` prints the figures as one line of JSON.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path

from edge_daemon.camera import load_camera
from edge_daemon.detection import detect_stream, open_detector, prefetch
from edge_daemon.frame import Frame
from edge_daemon.pipeline import Pipeline
from edge_daemon.settings import DetectorSettings, StabilitySettings, WatchSettings
from edge_daemon.sources.clip import ClipReader, open_clip
from edge_daemon.tracking import HIGH_SCORE
from edge_daemon.watch import Watch
from slipstream.service import rss_mb
from slipstream_lab.benchmarks.perception.speed import Speed, speed_of, written

_WINDOW_S = 10.0
_EVERY_S = 1.0


def measure(
    clip: Path,
    detector_settings: DetectorSettings,
    frames: int,
    warm_up: int,
    *,
    live: bool,
    whole: bool = False,
) -> Speed:
    """Run it.

    Args:
        clip: folder with video.mp4 and camera.toml; the video is looped.
        live: frames come at the clip's own rate, as from a camera, and none is skipped; else as
            fast as they are taken.
    """
    camera = load_camera(clip / "camera.toml")
    detector = open_detector(detector_settings, None if whole else camera)
    pipeline = Pipeline("bench", camera, detector, StabilitySettings(), _WINDOW_S)
    watch = Watch(camera, WatchSettings())
    reader = open_clip(clip / "video.mp4", loop=True, size=camera.size)
    taken = islice(_frames(reader, live=live), warm_up + frames)
    # As `slipstream track` does: the next picture is decoded while a request is awaited.
    offered: Iterable[Frame] = taken if live else prefetch(taken, 1)
    done: list[float] = []
    latencies: list[float] = []
    vehicles = 0
    cpu_s = due_s = 0.0
    with closing(detect_stream(offered, detector)) as results:
        for number, (frame, found) in enumerate(results, start=1):
            assert frame is not None
            assert found is not None
            watch.look(frame, found.boxes_above(HIGH_SCORE))
            pipeline.update(frame, watch.steady(found))
            if frame.media_time_s >= due_s:
                pipeline.states(frame.captured_ns)
                due_s += _EVERY_S
            now = time.monotonic()
            if number >= warm_up:
                done.append(now)
            if number == warm_up:
                cpu_s = -time.process_time()
            if number > warm_up:
                latencies.append(now - frame.captured_s)
                vehicles += len(found)
    cpu_s += time.process_time()
    return speed_of(done, latencies, cpu_s, vehicles, rss_mb())


def _frames(reader: ClipReader, *, live: bool) -> Iterator[Frame]:
    """Frames that carry the moment at which their decoding began."""
    pictures = reader.read_all()
    clock_began = time.monotonic()
    due_s = 0.0
    while True:
        if live:
            time.sleep(max(0.0, clock_began + due_s - time.monotonic()))
        began = time.monotonic()
        picture = next(pictures)
        due_s = picture.media_time_s + 1 / reader.fps
        yield replace(picture.now(), captured_s=began)


def main() -> None:
    """Measure once."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--model", default="builtin")
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--warm-up", type=int, default=60)
    parser.add_argument("--whole-picture", action="store_true")
    parser.add_argument("--live", action="store_true")
    options = parser.parse_args()
    settings, whole = DetectorSettings(model=options.model), options.whole_picture
    speed = measure(
        options.clip, settings, options.frames, options.warm_up, live=options.live, whole=whole
    )
    print(written(speed))


if __name__ == "__main__":
    main()
