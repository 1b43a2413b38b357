"""The edge daemon as a process on the bus."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w

from slipstream.bus import Bus, Router
from slipstream.messages import (
    ALL_PREVIEWS,
    ALL_RSU_HEALTH,
    ALL_STATES,
    RsuHealth,
    SegmentState,
    capture_time_ns,
    decode,
)
from slipstream_cli.main import main
from tests.slipstream.collector import collector


class Ears:
    """Collects what an edge daemon says."""

    def __init__(self, bus: Bus) -> None:
        self.states: list[SegmentState] = []
        self.health: list[RsuHealth] = []
        self.previews: list[bytes] = []
        self.bare: list[bytes] = []
        self._changed = threading.Condition()
        for key in (ALL_STATES, ALL_RSU_HEALTH):
            # Else a daemon's last state replaces the one before it, where this process stalls.
            bus.subscribe(key, self._take, every=True)
        for key in (ALL_PREVIEWS, f"{ALL_PREVIEWS}/bare"):
            bus.subscribe(key, self._take, history=False)

    def _take(self, key: str, payload: bytes) -> None:
        with self._changed:
            if key.endswith("state"):
                self.states.append(decode(SegmentState, payload, key))
            elif key.endswith("health"):
                self.health.append(decode(RsuHealth, payload, key))
            else:
                (self.bare if key.endswith("bare") else self.previews).append(payload)
            self._changed.notify_all()

    def until(self, condition: object, seconds: float) -> bool:
        """Wait until the condition holds."""
        with self._changed:
            return self._changed.wait_for(condition, seconds)  # type: ignore[arg-type]


def edge_toml(folder: Path, camera: Path, router: Router, source: dict[str, object]) -> Path:
    """A settings file for one RSU."""
    path = folder / "edge.toml"
    settings = {
        "rsus": {"r1": {"camera": str(camera), "source": source}},
        "bus": {"connect": [router.endpoint]},
    }
    path.write_text(tomli_w.dumps(settings))
    return path


def start(config: Path) -> subprocess.Popen[str]:
    """Start the real command."""
    return subprocess.Popen(
        [sys.executable, "-m", "slipstream_cli", "edge", "--config", str(config)],
        stderr=subprocess.PIPE,
        text=True,
    )


def end(process: subprocess.Popen[str]) -> str:
    """Stop it and return what it logged."""
    process.send_signal(signal.SIGTERM)
    _, log = process.communicate(timeout=20)
    return log


@pytest.mark.long
@pytest.mark.process
def test_states_health_and_preview_come_traced_and_sigterm_ends_it(
    tmp_path: Path, street_clips: dict[str, Path], router: Router, bus: Bus
) -> None:
    """A looped clip in real time becomes a stable flag, health figures and a JPEG. Spans follow
    each other in time; the last of a state carries what the dispatcher's spans carry.
    """
    folder = street_clips["stable"]
    ears = Ears(bus)
    source = {"clip": str(folder / "video.mp4"), "loop": True}
    with collector() as found:
        config = edge_toml(tmp_path, folder / "camera.toml", router, source)
        with config.open("a") as file:
            file.write(f'[service]\ntraces = "{found.endpoint}"\n')
        process = start(config)
        try:
            assert ears.until(lambda: any(s.y_e is not None for s in ears.states), 60)
            assert ears.until(lambda: bool(ears.previews and ears.bare), 60)
            assert found.wait_for(lambda spans: sum(s.name == "frames" for s in spans) >= 3)
        finally:
            log = end(process)
        assert process.returncode == 0, log
        roots = sorted((s for s in found.spans if not s.parent), key=lambda s: s.began_ns)
        assert {root.name for root in roots} == {"frames"}
        for root in roots:
            assert found.tree(root) == {"window": {}, "publish": {}}
            assert root.attributes["rsu"] == "r1"
        assert any(root.attributes["frames"] > 0 for root in roots)
        told = [s.attributes for s in found.spans if s.name == "publish"]
        assert sorted(t["sequence"] for t in told) == list(range(1, len(told) + 1))
        assert {t["segment"] for t in told} == {"stable_road"}
    assert all(root.began_ns < root.ended_ns for root in roots)
    known = [s for s in ears.states if s.y_e is not None]
    assert known[-1].y_e == 1
    assert abs(known[-1].time_ns - time.time_ns()) < 60e9
    assert ears.until(lambda: ears.health[-1].status == "ended", 60)
    health = ears.health[-1]
    assert health.frames > 50
    # A daemon does not wait for a router: its first states may go before the link is there.
    assert ears.until(lambda: ears.states[-1].sequence == health.states, 60)
    sequence = [s.sequence for s in ears.states]
    assert sequence == list(range(sequence[0], health.states + 1))
    assert sequence[0] <= 3
    for payloads in (ears.previews, ears.bare):
        picture = cv2.imdecode(np.frombuffer(payloads[-1], np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape == (360, 640, 3)
        assert health.started_ns < (capture_time_ns(payloads[0]) or 0) <= health.time_ns
    assert health.calibration is not None
    assert health.calibration.file == str(folder / "camera.toml")
    assert 0 < (health.calibration.speed_error or 0) < 0.05


@pytest.mark.nightly
@pytest.mark.process
def test_a_clip_played_once_and_fast_ends_by_itself(
    tmp_path: Path, street_clips: dict[str, Path], router: Router, bus: Bus
) -> None:
    """Every frame is used, and there is a state for each second of the clip's own time."""
    folder = street_clips["turbulent"]
    ears = Ears(bus)
    source = {"clip": str(folder / "video.mp4"), "pace": "fast"}
    process = start(edge_toml(tmp_path, folder / "camera.toml", router, source))
    _, log = process.communicate(timeout=90)
    assert process.returncode == 0, log
    assert ears.until(lambda: bool(ears.health) and ears.health[-1].status == "ended", 5)
    assert ears.health[-1].frames == 14 * 15
    assert ears.health[-1].frames_skipped == 0
    assert ears.health[-1].states == pytest.approx(15, abs=1)
    assert ears.until(lambda: ears.states[-1].sequence == ears.health[-1].states, 10)
    assert ears.states[-1].y_e == 0


@pytest.mark.long
@pytest.mark.process
def test_an_absent_camera_gives_unknown_states(
    tmp_path: Path, street_clips: dict[str, Path], router: Router, bus: Bus
) -> None:
    """The daemon runs on and says that it sees nothing."""
    ears = Ears(bus)
    camera = street_clips["stable"] / "camera.toml"
    process = start(edge_toml(tmp_path, camera, router, {"url": "http://127.0.0.1:9/none"}))
    try:
        assert ears.until(lambda: len(ears.states) >= 3, 30)
    finally:
        log = end(process)
    assert process.returncode == 0, log
    assert {(s.y_e, s.reason) for s in ears.states} == {(None, "no_frames")}
    assert "no_signal" in {h.status for h in ears.health}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"camera": "/nowhere/camera.toml"}, "/nowhere/camera.toml: no such file"),
        ({"sauce": 1}, "edge.toml: rsus.r1.sauce: unknown key"),
        ({"window_s": "ten"}, "edge.toml: rsus.r1.window_s"),
        ({"bus": {"connect": ["nonsense"]}}, "rsus.r1.bus: stands once, at the top"),
    ],
)
def test_bad_settings_are_one_line_and_exit_2(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: dict[str, object],
    expected: str,
) -> None:
    """No traceback for a user's mistake."""
    rsu: dict[str, object] = {"camera": "camera.toml", "source": {"clip": "video.mp4"}}
    config = tmp_path / "edge.toml"
    config.write_text(tomli_w.dumps({"rsus": {"r1": rsu | change}}))
    assert main(["edge", "--config", str(config)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert expected in line


@pytest.mark.long
@pytest.mark.process
def test_a_clip_of_another_size_than_the_calibration_is_one_line(
    tmp_path: Path, street_clips: dict[str, Path], router: Router
) -> None:
    """What is found while the daemon starts ends it likewise."""
    folder = street_clips["stable"]
    calibration = (folder / "camera.toml").read_text()
    calibration = calibration.replace("width = 1280", "width = 1920")
    camera = tmp_path / "other_size.toml"
    camera.write_text(calibration.replace("height = 720", "height = 1080"))
    process = start(edge_toml(tmp_path, camera, router, {"clip": str(folder / "video.mp4")}))
    _, log = process.communicate(timeout=60)
    assert process.returncode == 2, log
    lines = [line for line in log.splitlines() if line.startswith("slipstream:")]
    assert len(lines) == 1
    assert "the calibration is for 1920×1080" in lines[0]
    assert "Traceback" not in log
