"""`slipstream world` as a newcomer meets it: one command, and vehicles drive by what RSUs see."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from slipstream.bus import free_port

pytestmark = [
    pytest.mark.process,
    pytest.mark.alone,
    pytest.mark.nightly,
    pytest.mark.timeout(1800),
]

SEGMENT = "4th_adams-4th_liberty"


class World:
    """A running `slipstream world` with one RSU."""

    def __init__(self, state: Path, *arguments: str) -> None:
        self.port = free_port()
        self.log: list[str] = []
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "slipstream_cli", "world", "--state", str(state)),
                *("--port", str(self.port), "--rsus", "1", "--interval", "4", *arguments),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        stderr = self.process.stderr
        assert stderr is not None
        threading.Thread(
            target=lambda: self.log.extend(line.rstrip() for line in stderr), daemon=True
        ).start()

    def says(self, what: str, seconds: float) -> str:
        """The first log line with these words."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for line in list(self.log):
                if what in line:
                    return line
            assert self.process.poll() is None, "\n".join(self.log)
            time.sleep(0.1)
        raise AssertionError("not said in time:\n" + "\n".join(self.log))


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., World]]:
    """Starts the real command; kills it at the end if the test has not ended it."""
    worlds: list[World] = []

    def go(*arguments: str) -> World:
        worlds.append(World(tmp_path / "state", *arguments))
        return worlds[-1]

    yield go
    for world in worlds:
        if world.process.poll() is None:
            world.process.kill()
        world.process.wait()
        for stream in (world.process.stdout, world.process.stderr):
            if stream is not None:
                stream.close()


def test_plans_move_vehicles_before_cameras_that_rsus_watch(
    start: Callable[..., World],
) -> None:
    """States of a real segment come in, a cycle plans the hour's orders, vans drive, the page is
    up; then Ctrl-C ends all of it within seconds and leaves no process.
    """
    world = start("--json")
    line = world.says("pictures at", 300)
    assert SEGMENT in line
    url = line.rsplit(" ", 1)[1]
    world.says("ready", 120)
    with urllib.request.urlopen(f"{url}picture.jpg", timeout=20) as answer:
        picture = answer.read()
    assert picture.startswith(b"\xff\xd8")
    world.says("the dashboard is at", 120)
    # Vehicles are planned in the first cycle after they have said where they are.
    world.says(" plans by pyvrp", 240)
    world.says("edge rsu-01 INFO ready", 120)
    time.sleep(15.0)
    children = psutil.Process(world.process.pid).children(recursive=True)
    began = time.monotonic()
    os.kill(world.process.pid, signal.SIGINT)
    output, _ = world.process.communicate(timeout=60)
    assert time.monotonic() - began < 20
    assert world.process.returncode == 0, "\n".join(world.log)
    _, alive = psutil.wait_procs(children, timeout=5)
    assert alive == []
    figures = json.loads(output)
    assert figures["dashboard_http"] == 200
    assert figures["processes_restarted"] == 0
    assert list(figures["y_e"]) == [SEGMENT]
    assert figures["segment_states"] >= 1
    assert figures["cycles"] >= 1
    assert figures["plans"] >= 2
    counts = figures["world"]
    assert counts["tours_begun"] >= 2
    assert counts["fleet_vehicles_driven"] >= 1
    assert figures["positions"] >= 2
    assert figures["vehicles_moved"] >= 1
    assert counts["frames"] >= 10
    assert counts["vehicles"] > 50
