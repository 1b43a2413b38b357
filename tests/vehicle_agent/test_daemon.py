"""The agents as a process on the bus."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
import tomli_w

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_ACKNOWLEDGEMENTS,
    ALL_POSITIONS,
    ALL_PROGRESS,
    Message,
    PlanAcknowledgement,
    VehicleAdvice,
    VehiclePosition,
    VehicleProgress,
    advice_key,
    decode,
    driver_key,
    plan_key,
    sensing_key,
)
from tests.vehicle_agent.tours import VAN, plan, report, sensing

pytestmark = pytest.mark.process

_MODELS = {
    "advice": VehicleAdvice,
    "acknowledgement": PlanAcknowledgement,
    "position": VehiclePosition,
    "progress": VehicleProgress,
}


class Vehicle:
    """A vehicle, its driver and its dispatcher, as far as an agent hears of them."""

    def __init__(self, bus: Bus) -> None:
        self.heard: dict[str, list[Message]] = {name: [] for name in _MODELS}
        self._changed = threading.Condition()
        for key in (ALL_ACKNOWLEDGEMENTS, ALL_PROGRESS):
            bus.subscribe(key, self._take, every=True)
        for key in (ALL_POSITIONS, advice_key(VAN)):
            bus.subscribe(key, self._take, history=False, every=True)
        self._sensing = bus.publisher(sensing_key(VAN), history=0)
        self.driver = bus.publisher(driver_key(VAN), history=0)
        self.plans = bus.publisher(plan_key(VAN))

    def _take(self, key: str, payload: bytes) -> None:
        kind = key.rpartition("/")[2]
        with self._changed:
            self.heard[kind].append(decode(_MODELS[kind], payload, key))
            self._changed.notify_all()

    def latest(self, kind: str) -> Message | None:
        """The newest message of a kind."""
        with self._changed:
            return self.heard[kind][-1] if self.heard[kind] else None

    def sense_until(
        self, condition: Callable[[], bool], name: str = "out1", *, on_road: bool = False
    ) -> bool:
        """Sense ten times a second until a condition holds, half a minute at most."""
        ends = time.monotonic() + 30
        while time.monotonic() < ends:
            now_ns = time.time_ns()
            self._sensing.put(sensing(0, name, 10.0, on_road=on_road, time_ns=now_ns))
            if condition():
                return True
            time.sleep(0.1)
        return False


@pytest.fixture
def router() -> Iterator[Router]:
    """On a free port."""
    with Router() as found:
        yield found


def start(folder: Path, router: Router, vehicles: int = 1) -> subprocess.Popen[str]:
    """The real command, for some vehicles."""
    names = [VAN, *(f"other-{number}" for number in range(vehicles - 1))]
    config = folder / "agent.toml"
    config.write_text(
        tomli_w.dumps(
            {
                "agents": {
                    "a": {
                        "state": str(folder / "state"),
                        "vehicles": [{"id": name} for name in names],
                    }
                },
                "bus": {"connect": [router.endpoint]},
            }
        )
    )
    return subprocess.Popen(
        [sys.executable, "-m", "slipstream_cli", "agent", "--config", str(config)],
        stderr=subprocess.PIPE,
        text=True,
    )


def end(process: subprocess.Popen[str], number: int = signal.SIGTERM) -> str:
    """Stop it and return what it logged."""
    os.kill(process.pid, number)
    try:
        return process.communicate(timeout=20)[1]
    finally:
        process.kill()


def current(cycle: int = 1) -> object:
    """A plan of now."""
    now_ns = time.time_ns()
    return plan(cycle, issued_ns=now_ns, valid_until_ns=now_ns + 600 * 10**9, depart_ns=now_ns)


@pytest.mark.long
def test_an_agent_answers_advises_and_goes_on_after_a_kill(tmp_path: Path, router: Router) -> None:
    """Plan, advice, arrival, kill -9: the new process knows where the tour was."""
    with Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        van = Vehicle(bus)
        first = start(tmp_path, router)
        try:
            van.plans.put(current())  # type: ignore[arg-type]
            van.driver.put(b"not a report")
            assert van.sense_until(lambda: van.latest("acknowledgement") is not None)
            answer = van.latest("acknowledgement")
            assert isinstance(answer, PlanAcknowledgement)
            assert answer.accepted

            def advised(mode: str) -> bool:
                advice = van.latest("advice")
                return isinstance(advice, VehicleAdvice) and advice.mode == mode

            assert van.sense_until(lambda: advised("cruise"), on_road=True)
            assert psutil.Process(first.pid).memory_info().rss < 65e6

            def located() -> bool:
                # It comes on a subscription of its own, perhaps later than the advice.
                position = van.latest("position")
                assert isinstance(position, VehiclePosition)
                return (position.cycle, position.leg, position.on_road) == (1, 0, True)

            assert van.sense_until(located, on_road=True)

            def arrived() -> bool:
                progress = van.latest("progress")
                return isinstance(progress, VehicleProgress) and bool(progress.visits)

            assert van.sense_until(arrived, "out2")
        finally:
            os.kill(first.pid, signal.SIGKILL)
            first.communicate(timeout=20)
        for messages in van.heard.values():
            messages.clear()
        second = start(tmp_path, router)
        try:

            def serves() -> bool:
                advice = van.latest("advice")
                return isinstance(advice, VehicleAdvice) and advice.leg == 1

            assert van.sense_until(serves, "out2")
            van.driver.put(report(0, "served", "a").model_copy(update={"time_ns": time.time_ns()}))

            def leaves() -> bool:
                advice = van.latest("advice")
                return isinstance(advice, VehicleAdvice) and advice.depart_ns is not None

            assert van.sense_until(leaves, "out2")

            def has_served() -> bool:
                progress = van.latest("progress")
                assert isinstance(progress, VehicleProgress)
                return [(v.stop, v.status) for v in progress.visits] == [("a", "served")]

            assert van.sense_until(has_served, "out2")
        finally:
            log = end(second)
        assert "Traceback" not in log
        assert second.returncode == 0


@pytest.mark.long
def test_an_agent_whose_vehicle_is_silent_stops_advising(tmp_path: Path, router: Router) -> None:
    """Advice on old sensing ends within a second."""
    with Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        van = Vehicle(bus)
        process = start(tmp_path, router)
        try:
            van.plans.put(current())  # type: ignore[arg-type]

            def drives() -> bool:
                advice = van.latest("advice")
                return isinstance(advice, VehicleAdvice) and advice.mode == "cruise"

            assert van.sense_until(drives, on_road=True)
            ends = time.monotonic() + 20
            doubts = False
            while time.monotonic() < ends and not doubts:
                advice = van.latest("advice")
                assert isinstance(advice, VehicleAdvice)
                doubts = advice.mode == "none" and "clock" in (advice.reason or "")
                time.sleep(0.05)
            assert doubts
        finally:
            end(process)


def test_a_folder_that_cannot_be_used_is_one_line(tmp_path: Path) -> None:
    """Exit status 2, naming the key."""
    config = tmp_path / "agent.toml"
    config.write_text('[agents.a]\nstate = "/dev/null/x"\nvehicles = [{ id = "a" }]\n')
    done = subprocess.run(
        [sys.executable, "-m", "slipstream_cli", "agent", "--config", str(config)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "state" in done.stderr
