"""Each plan's part of its cycle's baseline."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from dispatcher_daemon.planning.plans import Candidate, RouteEnergy, plan_energies
from dispatcher_daemon.planning.roads import Route
from dispatcher_daemon.planning.roads.routes import StopVisit
from slipstream.energy.consumption import Energy
from slipstream.energy.ledger import PlanEnergy

PROBLEM = SimpleNamespace(fleet=SimpleNamespace(stop_by_id=dict.fromkeys("abcd")))


def _plan(*tours: tuple[str, str, float, float]) -> Candidate:
    """Plans by (vehicle, stops, energy without drafting, what drafting saves)."""
    routes, energies = [], []
    for vehicle, stops, alone_kwh, drag_kwh in tours:
        visits = tuple(StopVisit(place, 0.0, 0.0) for place in ("depot", *stops, "depot"))
        routes.append(Route(vehicle, visits, ()))
        alone = Energy(alone_kwh, 0.5 * alone_kwh, 0.25 * alone_kwh, 0.25 * alone_kwh)
        driven = alone._replace(
            total_kwh=alone_kwh - drag_kwh, drag_kwh=0.25 * alone_kwh - drag_kwh
        )
        by_segment = (alone_kwh - drag_kwh,), (alone_kwh,)
        energies.append(RouteEnergy(driven, alone, 0.0, 0.0, *by_segment))
    return Candidate("exact", 0.0, tuple(routes), (), tuple(energies))


def _baseline_kwh(energy: PlanEnergy) -> float:
    saved = (*energy.saved_drag_kwh, energy.saved_distance_kwh, energy.saved_acceleration_kwh)
    return sum((*energy.driven_kwh, *saved))


def test_whose_stops_are_the_same_has_its_own_baseline() -> None:
    """Its saving is its own; the split is that of `split_saving`."""
    chosen = _plan(("v", "ab", 3.0, 0.5), ("w", "c", 2.0, 0.0))
    baseline = _plan(("v", "ba", 4.0, 0.0), ("w", "c", 1.0, 0.0))
    found = plan_energies(PROBLEM, chosen, baseline)
    assert _baseline_kwh(found["v"]) == pytest.approx(4.0)
    assert found["v"] == PlanEnergy((2.5,), (0.5,), pytest.approx(0.75), pytest.approx(0.25))
    assert _baseline_kwh(found["w"]) == pytest.approx(1.0)


def test_vehicles_that_change_stops_share_their_baselines() -> None:
    """By what their plans need without drafting; a vehicle that stays at home has no part."""
    chosen = _plan(("v", "abc", 3.0, 0.5), ("w", "d", 1.0, 0.0))
    baseline = _plan(("v", "ab", 2.0, 0.0), ("w", "d", 2.5, 0.0), ("x", "c", 4.0, 0.0))
    found = plan_energies(PROBLEM, chosen, baseline)
    assert {v: _baseline_kwh(e) for v, e in found.items()} == pytest.approx({"v": 6.0, "w": 2.5})
    swapped = _plan(("v", "ac", 2.0, 0.0), ("w", "bd", 4.0, 0.0))
    found = plan_energies(PROBLEM, chosen, swapped)
    assert {v: _baseline_kwh(e) for v, e in found.items()} == pytest.approx({"v": 4.5, "w": 1.5})


def test_without_a_baseline_a_plan_alone_is_it() -> None:
    """Nothing but drafting is saved."""
    (energy,) = plan_energies(PROBLEM, _plan(("v", "a", 3.0, 0.5)), None).values()
    assert energy == PlanEnergy((2.5,), (0.5,))
