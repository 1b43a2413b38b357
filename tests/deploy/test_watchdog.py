"""What systemd's watchdog hears from the real daemons: progress, and silence when there is none."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w

from slipstream.bus import Router, free_port

from .conftest import DEPLOY

_WATCHDOG_S = 6.0

_STICKING_EDGE = """
import sys, time
from pathlib import Path
import numpy as np
import edge_daemon.daemon
from edge_daemon.detection import Detections
from slipstream_cli.main import main

class Sticking:
    requests = 1

    def detect(self, image):
        while Path(sys.argv[2]).exists():
            time.sleep(0.1)
        return Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), np.zeros(0, int))

edge_daemon.daemon.open_detector = lambda *_: Sticking()
sys.exit(main(["edge", "--config", sys.argv[1]]))
"""


class Manager:
    """Stands in for systemd: starts a daemon and listens on its notification socket."""

    def __init__(self, folder: Path, command: list[str]) -> None:
        path = folder / "notify"
        path.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self.process = subprocess.Popen(
            command,
            env=os.environ
            | {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": str(int(1e6 * _WATCHDOG_S))},
        )

    def hears(self, word: str, within_s: float) -> bool:
        """True once a notification that begins with the word has come."""
        deadline = time.monotonic() + within_s
        while (left := deadline - time.monotonic()) > 0:
            self._socket.settimeout(left)
            try:
                if self._socket.recv(4096).decode().startswith(word):
                    return True
            except TimeoutError:
                break
        return False

    def forget(self) -> None:
        """Drop what has come but was not yet read."""
        self._socket.setblocking(False)
        try:
            while True:
                self._socket.recv(4096)
        except BlockingIOError:
            pass

    def stop(self) -> None:
        """Kill what is left."""
        self.process.kill()
        self.process.wait()
        self._socket.close()


@contextmanager
def managed(folder: Path, *command: str) -> Iterator[Manager]:
    """A daemon under the stand-in."""
    manager = Manager(folder, [sys.executable, *command])
    try:
        yield manager
    finally:
        manager.stop()


def settings(folder: Path, name: str, content: dict[str, object]) -> str:
    """Write a settings file; returns its path."""
    path = folder / f"{name}.toml"
    path.write_text(tomli_w.dumps(content))
    return str(path)


def edge_settings(folder: Path, router: Router, source: dict[str, object]) -> str:
    """Settings of an RSU whose camera is the example's."""
    camera = DEPLOY / "config" / "camera-rsu-1.toml"
    rsu = {"camera": str(camera), "source": source}
    return settings(folder, "edge", {"rsus": {"r": rsu}, "bus": {"connect": [router.endpoint]}})


@pytest.mark.long
@pytest.mark.process
def test_a_stuck_detector_silences_the_watchdog(tmp_path: Path, router: Router) -> None:
    """READY, then a sign of life each second; none while the pipeline stands, again when it moves.

    The capture thread and the bus go on all the while: it is the work that counts.
    """
    clip = tmp_path / "clip.mp4"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"mp4v"), 10, (1280, 720))
    for _ in range(20):
        writer.write(np.full((720, 1280, 3), 90, dtype=np.uint8))
    writer.release()
    config = edge_settings(tmp_path, router, {"clip": str(clip), "loop": True})
    stick = tmp_path / "stick"
    with managed(tmp_path, "-c", _STICKING_EDGE, config, str(stick)) as manager:
        assert manager.hears("READY=1", 30)
        for _ in range(2):
            assert manager.hears("WATCHDOG=1", _WATCHDOG_S)
        stick.touch()
        time.sleep(2.0)
        manager.forget()
        assert not manager.hears("WATCHDOG=1", 1.5 * _WATCHDOG_S)
        assert manager.process.poll() is None
        stick.unlink()
        assert manager.hears("WATCHDOG=1", _WATCHDOG_S)
        manager.process.send_signal(signal.SIGTERM)
        assert manager.hears("STOPPING=1", 5)
        assert manager.process.wait(timeout=10) == 0


@pytest.mark.long
@pytest.mark.process
def test_waiting_for_a_camera_is_progress(tmp_path: Path, router: Router) -> None:
    """A restart would not bring an absent camera back, so the watchdog is fed."""
    source = {"url": f"rtsp://127.0.0.1:{free_port()}/none", "stall_timeout_s": 1.0}
    config = edge_settings(tmp_path, router, source)
    with managed(tmp_path, "-c", _STICKING_EDGE, config, str(tmp_path / "none")) as manager:
        assert manager.hears("READY=1", 30)
        for _ in range(3):
            assert manager.hears("WATCHDOG=1", _WATCHDOG_S)


@pytest.mark.long
@pytest.mark.process
@pytest.mark.parametrize("daemon", ["dispatcher", "dashboard"])
def test_the_servers_daemons_tell_their_progress(
    daemon: str, tmp_path: Path, router: Router
) -> None:
    """READY once they serve, signs of life after it, STOPPING at the end."""
    content: dict[str, object] = {
        "bus": {"connect": [router.endpoint]},
        "database_url": f"sqlite:///{tmp_path / 'slipstream.db'}",
    }
    if daemon == "dashboard":
        content["dashboard"] = {"port": free_port(), "scene_port": free_port()}
    config = settings(tmp_path, daemon, content)
    with managed(tmp_path, "-m", "slipstream_cli", daemon, "--config", config) as manager:
        assert manager.hears("READY=1", 90)
        # With nobody looking, the dashboard is brought up to date every 5 s.
        for _ in range(2):
            assert manager.hears("WATCHDOG=1", 8)
        manager.process.send_signal(signal.SIGTERM)
        assert manager.hears("STOPPING=1", 20)
        assert manager.process.wait(timeout=20) == 0


@pytest.mark.long
@pytest.mark.process
def test_agents_without_a_vehicle_to_advise_tell_their_progress(tmp_path: Path) -> None:
    """Without a router too: waiting for sensing is progress, a restart would not bring it."""
    content: dict[str, object] = {
        "agents": {"a": {"vehicles": [{"id": "van"}], "state": str(tmp_path / "tours")}},
        "bus": {"connect": [f"tcp/127.0.0.1:{free_port()}"]},
    }
    config = settings(tmp_path, "agent", content)
    with managed(tmp_path, "-m", "slipstream_cli", "agent", "--config", config) as manager:
        assert manager.hears("READY=1", 30)
        for _ in range(2):
            assert manager.hears("WATCHDOG=1", _WATCHDOG_S)
        manager.process.send_signal(signal.SIGTERM)
        assert manager.hears("STOPPING=1", 10)
        assert manager.process.wait(timeout=10) == 0
