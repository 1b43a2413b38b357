"""The energy ledger's parts over whole days: what was driven, once, against what plans say."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import fsum

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.ledger import HOUR_NS, EnergyHour, PlanEnergy, merged
from slipstream.messages import VehiclePlan

from .fleet_drive import Day, Van

STOPS = ("11", "22", "33", "30", "03", "21")
Make = Callable[..., Day]
Town = tuple[RoutingProblem, TrafficSnapshot]


@pytest.fixture
def day(town: Callable[..., Town]) -> Make:
    """A factory of days with two vans of three orders each, that begin shortly before an hour."""

    def make(**how: object) -> Day:
        stops = [
            {"id": f"s{i}", "node": node, "service_s": 20.0, "demand": 1}
            for i, node in enumerate(STOPS)
        ]
        problem, snapshot = town(stops, [{"capacity": 3}, {"capacity": 3}])
        vans = {v.id: Van(v.id, "00-01", **how) for v in problem.fleet.vehicles}  # type: ignore[arg-type]
        today = Day(problem, snapshot, vans, problem.fleet)
        today.now_ns += HOUR_NS - today.now_ns % HOUR_NS - 150 * 10**9
        today.restart()
        today.drive(2)
        return today

    return make


def finish(today: Day, restarts: bool = False) -> list[EnergyHour]:
    """The ledger after the last van is home."""
    for _ in range(60):
        today.run(1)
        if restarts:
            today.restart()
            today.drive(3)
        if all(van.plan is None and van.plans for van in today.vans.values()):
            today.run(2)
            return merged(today.store.driven)
    raise AssertionError("vans are not back")


def accepted(today: Day, vehicle: str) -> list[tuple[VehiclePlan, PlanEnergy]]:
    """The plans that a van has followed, with their energies."""
    energies = {result.report.cycle: result.energies for result in today.results}
    return [(plan, energies[plan.cycle][vehicle]) for plan in today.vans[vehicle].plans]


def driven_kwh(plans: list[tuple[VehiclePlan, PlanEnergy]]) -> float:
    """By hand: each plan's energy up to the place at which the next one begins.

    The way stays the same here, so that each plan's segments are the last ones of the one before.
    """
    parts = []
    for (plan, energy), (later, after) in pairwise(plans):
        whole = len(plan.segments) - len(later.segments)
        assert [s.segment for s in plan.segments[whole:]] == [s.segment for s in later.segments]
        parts += energy.driven_kwh[:whole]
        begun = energy.begin if whole == 0 else 0.0
        parts.append(energy.driven_kwh[whole] * (after.begin - begun) / (1.0 - begun))
    return fsum((*parts, *plans[-1][1].driven_kwh))


@pytest.mark.slow
@pytest.mark.parametrize(("restarts", "late_s"), [(False, 45.0), (True, 0.0)])
def test_a_day_is_booked_once(day: Make, restarts: bool, late_s: float) -> None:
    """Way and energy of each van are those of its plans, each up to its replacement; vans that are
    late are planned anew from where they are, and dispatchers that start go on. These do not know
    answers of after the last cycle: some energy is booked by the plan before.
    """
    today = day(late_s=late_s)
    ledger = finish(today, restarts)
    replaced = 0
    for vehicle in today.vans:
        plans, own = accepted(today, vehicle), [p for p in ledger if p.vehicle == vehicle]
        replaced += len(plans) - 1
        assert fsum(p.distance_m for p in own) == pytest.approx(plans[0][0].distance_m, rel=1e-9)
        by_hand, rel = driven_kwh(plans), 0.01 if restarts else 1e-9
        assert fsum(p.plan_kwh for p in own) == pytest.approx(by_hand, rel=rel)
    assert replaced >= 4
    assert len({part.hour_ns for part in ledger}) == 2
    for part in ledger:
        saved = part.saved_distance_kwh + part.saved_drag_kwh + part.saved_acceleration_kwh
        assert part.baseline_kwh - part.plan_kwh == pytest.approx(saved, abs=1e-12)
        assert part.baseline_kwh > 0


@pytest.mark.slow
def test_what_was_driven_by_then_is_booked(day: Make) -> None:
    """While a van is under way its ledger grows with its place, in the hour of its clock."""
    today = day()
    metres = []
    for _ in range(8):
        today.run(1)
        today.cycle()
        metres.append(fsum(part.distance_m for part in today.store.driven))
        assert max((p.hour_ns for p in today.store.driven), default=0) <= today.now_ns
    assert metres == sorted(metres)
    whole_m = fsum(van.plans[0].distance_m for van in today.vans.values())
    assert 0 < metres[3] < metres[-1] < whole_m


@pytest.mark.slow
def test_what_nobody_reports_is_not_booked(day: Make) -> None:
    """Of vans that never answer nothing is known; of one that is silent, what it said before."""
    today = day()
    never, other = today.vans
    today.vans[never].muted_until_ns = 2**62
    today.restart()
    today.run(4)
    assert {part.vehicle for part in today.store.driven} == {other}
    today.vans[other].muted_until_ns = 2**62
    today.run(1)
    before = merged(today.store.driven)
    today.run(2)
    assert merged(today.store.driven) == before


@pytest.mark.slow
def test_a_cycle_s_plans_add_up_to_its_summary(day: Make) -> None:
    """Vehicles' parts of the baseline, and of what is saved, are the cycle's."""
    today = day()
    today.run(3)
    for result in today.results:
        summary, energies = result.report.energy, result.energies.values()
        assert summary is not None
        driven = fsum(kwh for energy in energies for kwh in energy.driven_kwh)
        drag = fsum(kwh for energy in energies for kwh in energy.saved_drag_kwh)
        distance = fsum(energy.saved_distance_kwh for energy in energies)
        acceleration = fsum(energy.saved_acceleration_kwh for energy in energies)
        assert driven == pytest.approx(summary.cooperative_kwh)
        assert drag == pytest.approx(summary.saved_drag_kwh, abs=1e-9)
        assert distance == pytest.approx(summary.saved_distance_kwh, abs=1e-9)
        assert acceleration == pytest.approx(summary.saved_acceleration_kwh, abs=1e-9)
