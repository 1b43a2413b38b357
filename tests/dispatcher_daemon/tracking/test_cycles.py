"""Whole days of the tracker and the cycle: who is planned from where, and what becomes of orders."""

from __future__ import annotations

import importlib.util
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from dispatcher_daemon.cycle import run_cycle
from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.plans import Cycle
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.execution.pool import solve_in_process
from dispatcher_daemon.tracking import FleetTracker, Situation
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.messages import VehiclePlan
from slipstream.orders import FleetRecords

_SPEC = importlib.util.spec_from_file_location(
    "fleet_drive", Path(__file__).parent / "fleet_drive.py"
)
assert _SPEC is not None
assert _SPEC.loader is not None
fleet_drive = importlib.util.module_from_spec(_SPEC)
sys.modules["fleet_drive"] = fleet_drive
_SPEC.loader.exec_module(fleet_drive)
Van = fleet_drive.Van

S = 10**9
SEARCH = SearchSettings(rounds=1, iterations_per_stop=20, time_limit_s=5.0)
SETTINGS = DispatcherSettings(
    solvers=("exact",),
    form="route",
    city=CitySettings(search=SEARCH, second_rounds=0, max_sweeps=2),
)
SOLVE = solve_in_process([ExactSolver()])


@dataclass
class Day:
    """A town's dispatcher and its vans, in steps of a second."""

    problem: RoutingProblem
    snapshot: TrafficSnapshot
    vans: dict[str, object]
    file: Fleet | None
    now_ns: int = 0
    number: int = 0
    situations: list[Situation] = field(default_factory=list)
    sent: list[VehiclePlan] = field(default_factory=list)
    mute: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.now_ns = self.now_ns or self.snapshot.now_ns
        self.tracker = FleetTracker(self.problem.network)
        self.database = FleetRecords()

    def cycle(self) -> tuple[VehiclePlan, ...]:
        """One cycle, with what the daemon does around it."""
        self.number += 1
        now_ns = self.now_ns
        self.tracker.list_fleet(self.file, now_ns)
        reference_s = SETTINGS.deadline_s
        situation = self.tracker.situation(self.file, self.number, now_ns, reference_s)
        self.situations.append(situation)
        if situation.fleet is None:
            return ()
        snapshot = TrafficSnapshot(now_ns, self.snapshot.segments, ())
        problem = RoutingProblem(self.problem.network, situation.fleet)
        cycle = Cycle(
            problem,
            snapshot,
            SETTINGS,
            self.number,
            now_ns,
            self.number,
            commitments=situation.commitments,
        )
        result = run_cycle(cycle, SOLVE)
        assert result.report.status != "failed", result.report.reason
        plans = self.tracker.admissible(result.plans)
        reference_ns = now_ns + round(reference_s * S)
        self.tracker.publish(plans, situation.fleet.stop_by_id, reference_ns, now_ns)
        self.sent += plans
        return plans

    def drive(self, seconds: int, step_s: int = 1) -> None:
        """The vans drive and report."""
        for _ in range(0, seconds, step_s):
            self.now_ns += step_s * S
            for van in self.vans.values():
                self.report(van)

    def report(self, van: object) -> None:
        """One van reports."""
        position, progress = van.step(self.now_ns)  # type: ignore[attr-defined]
        if position.vehicle in self.mute:
            return
        if van.answer is not None and van.talks:  # type: ignore[attr-defined]
            self.tracker.on_acknowledgement(van.answer, self.now_ns)  # type: ignore[attr-defined]
            van.answer = None  # type: ignore[attr-defined]
        self.tracker.on_position(position, self.now_ns)
        if progress is not None:
            self.tracker.on_progress(progress, self.now_ns)

    def run(self, cycles: int) -> None:
        """Cycles with driving between them."""
        for _ in range(cycles):
            plans = self.cycle()
            self.drive(2)
            for plan in plans:
                self.vans[plan.vehicle].offer(plan, self.now_ns)  # type: ignore[attr-defined]
            self.drive(28)

    def states(self) -> Counter[str]:
        """Number of orders by state."""
        return Counter(order.state for order in self.tracker.book.orders.values())


STOPS = ["11", "22", "33", "30", "03", "21"]


@pytest.fixture
def day(town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]]) -> Callable[..., Day]:
    """A factory of days with two vans."""

    def make(stops: list[str] = STOPS, vans: int = 2, **how: object) -> Day:
        problem, snapshot = town(stops, [{"capacity": None} for _ in range(vans)])
        names = [vehicle.id for vehicle in problem.fleet.vehicles]
        made = {name: Van(name, "00-01", **how) for name in names}
        return Day(problem, snapshot, made, problem.fleet)

    return make


@pytest.mark.parametrize("talks", [True, False])
def test_a_day_serves_every_order_once_and_sends_nobody_back(day, talks) -> None:
    """Vans are planned on from where they are; at the end all is served and they are free."""
    today = day(talks=talks)
    today.drive(2)
    for _ in range(60):
        today.run(1)
        if today.states() == {"served": 6} and not today.situations[-1].commitments:
            break
    for i, s in enumerate(today.situations):
        print(
            i + 1,
            [
                (
                    c.vehicle,
                    c.plan.cycle,
                    c.place,
                    c.stops,
                    [(l.path, l.complete) for l in c.legs],
                    c.moving,
                    c.lost,
                )
                for c in s.commitments
            ],
            s.left_out,
        )
    for p in today.sent:
        print(
            p.cycle,
            p.vehicle,
            p.continues,
            [s.stop for s in p.stops],
            (p.depart_ns - p.issued_ns) // S,
            [(s.arrival_ns - today.snapshot.now_ns) // S for s in p.stops],
            [(s.leg, s.segment) for s in p.segments],
        )
    for v in today.vans.values():
        print(v.name, v.refused, [x.cycle for x in v.plans], v.plan and v.plan.cycle)
    print(today.tracker.book.orders)
    assert today.states() == {"served": 6}
    assert all(van.plan is None for van in today.vans.values())
    assert {plan.continues is None for plan in today.sent} == (
        {True, False} if talks else {True, False}
    )
    for van in today.vans.values():
        assert set(van.refused) <= {"elsewhere", "not on this way"}
