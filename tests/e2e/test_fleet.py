"""A town's fleet at work while its dispatcher, its agents and its router are killed at random."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
import tomli_w

from slipstream.bus import Bus, free_port
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_POSITIONS,
    Estimate,
    KinematicFeatures,
    SegmentState,
    VehiclePosition,
    decode,
    state_key,
)
from slipstream_lab.simulation.live.process import WorldProcess
from slipstream_lab.simulation.live.town import VANS, town
from slipstream_lab.simulation.live.world_spec import WorldCounts

pytestmark = [
    pytest.mark.process,
    pytest.mark.nightly,
    pytest.mark.alone,
    pytest.mark.attack,
    # A hundred kills take 20 minutes.
    pytest.mark.timeout(3600),
]

SEGMENTS = ("avenue_east", "avenue_west")
CALM = KinematicFeatures(
    mean_speed_mps=Estimate(value=13.5, standard_error=0.1),
    mean_acceleration_mps2=Estimate(value=0.0, standard_error=0.01),
    density_veh_per_m=Estimate(value=0.02, standard_error=0.001),
    speed_std_mps=Estimate(value=0.4, standard_error=0.1),
    acceleration_variance_m2ps4=Estimate(value=0.05, standard_error=0.01),
    mean_gap_m=Estimate(value=22.0, standard_error=2.0),
)
ROUTER = """
import signal, sys
from slipstream.bus import Router
router = Router(int(sys.argv[1]))
signal.pause()
"""
BETWEEN_S = 5.0
"""Between two kills: what was killed comes back after a second or two, as under systemd."""


class Daemons:
    """The processes of a town, which are killed and started again."""

    def __init__(self, folder: Path, port: int, orders: Path, vans: list[str]) -> None:
        bus = {"connect": [f"tcp/127.0.0.1:{port}"]}
        self.database = folder / "slipstream.db"
        halves = {"agents-a": vans[::2], "agents-b": vans[1::2]}
        site = {
            "bus": bus,
            "database_url": f"sqlite:///{self.database}",
            "fleet": str(orders),
            "agents": {
                name: {"state": str(folder / name), "vehicles": [{"id": van} for van in half]}
                for name, half in halves.items()
            },
            "dispatcher": {
                "form": "route",
                "solvers": ["exact"],
                "interval_s": 8.0,
                "deadline_s": 3.0,
            },
        }
        path = folder / "site.toml"
        path.write_text(tomli_w.dumps(site))
        self._commands = {"router": [sys.executable, "-c", ROUTER, str(port)]}
        for name, words in {
            "dispatcher": ["dispatcher"],
            **{name: ["agent", "--name", name] for name in halves},
        }.items():
            self._commands[name] = [
                *(sys.executable, "-m", "slipstream_cli", *words, "--config", str(path)),
            ]
        self._logs = {name: (folder / f"{name}.log").open("ab") for name in self._commands}
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.unwanted: list[str] = []

    def start(self, name: str) -> None:
        """Start one."""
        self._running[name] = subprocess.Popen(
            self._commands[name], stdout=self._logs[name], stderr=subprocess.STDOUT
        )

    def __enter__(self) -> Daemons:
        for name in self._commands:
            self.start(name)
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running.values():
            process.terminate()
        for process in self._running.values():
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        for log in self._logs.values():
            log.close()

    def kill(self, name: str) -> None:
        """As the kernel does it when memory is short; back a second later."""
        process = self._running[name]
        if process.poll() is not None:
            self.unwanted.append(f"{name} had ended with {process.returncode}")
        process.send_signal(signal.SIGKILL)
        process.wait()
        time.sleep(1.0)
        self.start(name)

    def log(self, name: str) -> str:
        """What one has logged."""
        return Path(self._logs[name].name).read_text(errors="replace")

    def orders(self) -> dict[str, list[str]]:
        """Orders by state, as the command line lists them."""
        done = subprocess.run(
            [
                *(sys.executable, "-m", "slipstream_cli", "orders", "list", "--json"),
                *("--url", f"sqlite:///{self.database}"),
            ],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        found: dict[str, list[str]] = {}
        for order in json.loads(done.stdout):
            found.setdefault(order["state"], []).append(order["order"])
        return found


class Roadside:
    """Both avenues are calm, as two RSUs tell once a second."""

    def __init__(self, bus: Bus) -> None:
        self._outlets = {s: bus.publisher(state_key(f"rsu-{s}", s), history=0) for s in SEGMENTS}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        sequence = 0
        while not self._ended.wait(1.0):
            sequence += 1
            for segment, outlet in self._outlets.items():
                outlet.put(
                    SegmentState(
                        rsu=f"rsu-{segment}",
                        segment=segment,
                        sequence=sequence,
                        time_ns=time.time_ns(),
                        window_s=10.0,
                        features=CALM,
                        y_e=1,
                        reason=None,
                        vehicles=8,
                        frames=300,
                        coverage=1.0,
                    )
                )

    def __enter__(self) -> Roadside:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()


def test_a_fleet_survives_kills(
    tmp_path: Path, full_size: bool, figure: Callable[[str], None]
) -> None:
    """Dispatcher, agents, router, 100 times in full size: no order is served twice or lost, no
    vehicle is without a plan, and no gap stays close behind a silent partner for a second.
    """
    kills, port = 100 if full_size else 8, free_port()
    settings = BusSettings(connect=(f"tcp/127.0.0.1:{port}",))
    spec = town(tmp_path / "town", settings)
    positions: dict[str, VehiclePosition] = {}

    def take(key: str, payload: bytes) -> None:
        position = decode(VehiclePosition, payload, key)
        positions[position.vehicle] = position

    chance = random.Random(18)
    with ExitStack() as stack:
        daemons = stack.enter_context(
            Daemons(tmp_path, port, spec.fleet, list(spec.deliveries.vehicles))
        )
        bus = stack.enter_context(Bus.open(settings))
        bus.subscribe(ALL_POSITIONS, take, history=False)
        stack.enter_context(Roadside(bus))
        world = stack.enter_context(WorldProcess(spec))
        world.open(lambda: False, lambda share: None)

        def wait(seconds: float, until: Callable[[WorldCounts], bool]) -> bool:
            ends = time.monotonic() + seconds
            while time.monotonic() < ends:
                world.poll()
                if world.counts is not None and until(world.counts):
                    return True
                time.sleep(0.2)
            return False

        assert wait(150, lambda c: c.fleet_on_road >= VANS // 2), daemons.log("dispatcher")
        for _ in range(kills):
            name = chance.choice(["dispatcher", "agents-a", "agents-b", "router"])
            daemons.kill(name)
            wait(BETWEEN_S + chance.random() * BETWEEN_S, lambda _: False)
        assert world.counts is not None
        served = world.counts.orders_served
        # All is well again: orders are served, and the vehicles on the road follow plans.
        assert wait(240, lambda c: c.orders_served >= served + 5)
        wait(20, lambda _: False)
        counts = world.counts
        orders = daemons.orders()
        lost = [p.vehicle for p in positions.values() if p.on_road and p.cycle is None]
    figure(
        f"fleet, {kills} kills: {counts.orders_served} orders served, {counts.orders_served_again} "
        f"again; {len(orders.get('served', []))} known as served; {counts.tours_begun} tours; "
        f"{counts.platooned_m:.0f} m in platoons; a silent partner was followed for "
        f"{counts.longest_silence_s:.2f} s at most"
    )
    assert daemons.unwanted == []
    assert counts.orders_served_again == 0
    assert counts.longest_silence_s <= 1.0
    assert lost == []
    assert len(positions) == VANS
    assert not orders.get("failed")
    # Who is being served now is not yet known as served; nothing else is missing, nothing is added.
    being_served = VANS
    assert counts.orders_served - being_served <= len(orders["served"]) <= counts.orders_served
    for name in ("dispatcher", "agents-a", "agents-b"):
        assert "Traceback" not in daemons.log(name), daemons.log(name)[-2000:]
