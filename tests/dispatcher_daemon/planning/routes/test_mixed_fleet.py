"""Vehicles of several types in one fleet."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.plans.energy import route_energy
from dispatcher_daemon.planning.platooning import Meetings, open_shares
from dispatcher_daemon.planning.roads import fleet_travel
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.planning.routes.servability import unservable
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.braking import BRAKING
from slipstream.energy.consumption import ETA_FOLLOWER, ETA_LEADER, drag_saving_kwh, drive_energies
from slipstream.energy.drafting import reductions_at
from slipstream.vehicle_types import PRESETS, VehicleType

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]


def small(town: Town) -> tuple[RoutingProblem, TrafficSnapshot]:
    """Four vehicles that may wait for each other, and six stops."""
    vehicles = [{"id": f"v{n}", "depart_by_s": 120.0} for n in range(4)]
    return town(["11", "22", "30", "33", "02", "13"], vehicles)


def with_types(problem: RoutingProblem, *kinds: str | VehicleType | None) -> RoutingProblem:
    """The same with the vehicles' types, in turn."""
    fleet = problem.fleet
    of = [kinds[n % len(kinds)] for n in range(len(fleet.vehicles))]
    vehicles = tuple(
        v.model_copy(update={"own_type" if isinstance(kind, VehicleType) else "type": kind})
        for v, kind in zip(fleet.vehicles, of, strict=True)
    )
    return replace(problem, fleet=fleet_like(fleet, vehicles=vehicles))


def fleet_like(fleet: Fleet, **changes: object) -> Fleet:
    """A copy without what the fleet has looked up."""
    parts = {name: getattr(fleet, name) for name in type(fleet).model_fields}
    return Fleet(**{**parts, **changes})


def dispatched(problem: RoutingProblem, snapshot: TrafficSnapshot) -> CycleResult:
    """One cycle in route form."""
    settings = DispatcherSettings(form="route", interval_s=2000.0, deadline_s=1000.0)
    cycle = Cycle(problem, snapshot, settings, 1, 0, 1, 10.0)
    with ThreadPoolExecutor(1) as thread:
        return run_cycle(cycle, solve_in_process([ExactSolver()]), thread)


@pytest.mark.slow
def test_each_vehicle_pays_by_its_own_type(town: Town) -> None:
    """A truck's path costs and takes more than a car's; each plan has its vehicle's energy."""
    problem, snapshot = small(town)
    mixed = with_types(problem, None, "truck_40t")
    travel = fleet_travel(mixed, snapshot)
    car, truck = (travel.of(v) for v in mixed.fleet.vehicles[:2])
    start, end = mixed.fleet.depots[0].id, mixed.fleet.stops[0].id
    pair = travel.row[start], travel.row[end]
    assert truck.energy_kwh[pair] > 3 * car.energy_kwh[pair]
    assert truck.duration_s[pair] >= car.duration_s[pair]
    result = dispatched(mixed, snapshot)
    assert result.report.status in ("ok", "baseline")
    for plan in result.plans:
        physics = mixed.profile_of(plan.vehicle).physics
        assert plan.energy_kwh > physics.electrical_kwh(physics.rolling_force_n * plan.distance_m)


@pytest.mark.slow
def test_a_slow_truck_is_planned_at_its_own_speed(town: Town) -> None:
    """Times and advised speeds never exceed what it can drive."""
    problem, snapshot = small(town)
    slow = PRESETS["truck_40t"].model_copy(update={"max_speed_mps": 6.0, "battery_kwh": None})
    vehicles = tuple(v.model_copy(update={"own_type": slow}) for v in problem.fleet.vehicles)
    crawling = replace(problem, fleet=fleet_like(problem.fleet, vehicles=vehicles))
    for plan in dispatched(crawling, snapshot).plans:
        assert all(segment.speed_mps <= 6.0 for segment in plan.segments)
        for segment in plan.segments:
            length_m = problem.network.segments[segment.segment].length_m
            assert length_m / ((segment.exit_ns - segment.entry_ns) * 1e-9) <= 6.0 * 1.001


def test_a_platoon_saves_by_the_types_of_leader_and_followers(town: Town) -> None:
    """By hand: the paper's 5 % of the car's drag, and of the truck's what was measured behind one
    other at 9 m and less; then the other way round; then as the last and in the middle of three.
    """
    problem, snapshot = small(town)
    # The truck's own brakes allow platoons of two, these of four.
    kinds = [
        PRESETS[name].model_copy(update={"braking": BRAKING["brake_by_wire"]})
        for name in ("paper_car", "truck_40t")
    ]
    mixed = with_types(problem, *kinds)
    planner = Planner(mixed, snapshot, [], 3.0)
    assert planner.book.longest == mixed.longest_platoon == 4
    assert with_types(problem, None, "truck_40t").longest_platoon == 2
    assert isinstance(planner.book.meetings(), Meetings)
    segment = next(iter(planner.book.shares))
    length = mixed.network.segments[segment].length_m
    speed = snapshot.segments[segment].speed_mps
    car, truck = (mixed.profile_of(v) for v in mixed.fleet.vehicles[:2])

    def saved(profile: object, eta: float) -> float:
        physics = car.physics if profile is car else truck.physics
        return drag_saving_kwh(length, min(speed, 25.0), eta, physics)

    meetings = planner.book.meetings()
    meetings.add({segment: [(0.0, 50.0, (0,))]})
    gain = meetings.add({segment: [(1.0, 51.0, (1,))]})
    close = reductions_at("truck", 9.144)
    assert gain == pytest.approx(saved(car, ETA_LEADER) + saved(truck, close.follower))
    meetings.remove({segment: [(0.0, 50.0, (0,))]})
    gain = meetings.add({segment: [(2.0, 52.0, (0,))]})
    assert gain == pytest.approx(saved(truck, close.leader) + saved(car, ETA_FOLLOWER))
    gain = meetings.add({segment: [(2.5, 52.5, (3,))]})
    assert gain == pytest.approx(saved(truck, close.last))
    gain = meetings.add({segment: [(0.5, 50.5, (2,))]})
    before = saved(truck, close.leader)
    after = saved(truck, close.middle) + saved(car, ETA_LEADER)
    assert gain == pytest.approx(after - before)
    assert planner.book.shares == open_shares(mixed, snapshot, car)


def test_energies_of_a_route_are_those_of_its_vehicle(town: Town) -> None:
    """With the load of its type, and what it recuperates."""
    problem, snapshot = small(town)
    mixed = with_types(problem, "van")
    planner = Planner(mixed, snapshot, [fleet_travel(mixed, snapshot)], 3.0)
    stop = mixed.fleet.stops[0].id
    itinerary = planner.itinerary(0, (stop,), planner.legs(0, (stop,)))
    assert itinerary is not None
    assert itinerary.route is not None
    drives = [leg.drive for leg in itinerary.route.legs]
    etas = [[0.0] * len(leg.path) for leg in itinerary.route.legs]
    expected = drive_energies(drives, etas, PRESETS["van"].profile.physics).sum()
    assert route_energy(mixed, itinerary.route, {}).driven == expected


@pytest.mark.slow
def test_loads_go_to_vehicles_that_may_carry_them(town: Town) -> None:
    """Two heavy stops and one truck among vans: the truck serves them; without it, nobody."""
    problem, snapshot = small(town)
    heavy = tuple(
        stop.model_copy(update={"mass_kg": 4000.0 if n < 2 else 10.0})
        for n, stop in enumerate(problem.fleet.stops)
    )
    mixed = with_types(problem, "van", "truck_40t")
    mixed = replace(mixed, fleet=fleet_like(mixed.fleet, stops=heavy))
    result = dispatched(mixed, snapshot)
    by_stop = {s.stop: plan.vehicle for plan in result.plans for s in plan.stops[1:-1]}
    for stop in heavy[:2]:
        assert mixed.fleet.vehicle_by_id[by_stop[stop.id]].type == "truck_40t"
    vans = with_types(mixed, "van")
    missing = unservable(vans, snapshot)
    assert [*missing] == [stop.id for stop in heavy[:2]]
    assert "payload" in missing[heavy[0].id]
