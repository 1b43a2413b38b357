"""Batteries: reserve, charging on the way and at the depot, and what nobody can reach."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.plans.verify import verify_plans
from dispatcher_daemon.planning.roads import RoadLeg, fleet_travel
from dispatcher_daemon.planning.roads.charge import Battery, charges_kwh, leg_energy_kwh
from dispatcher_daemon.planning.routes import insert_stops
from dispatcher_daemon.planning.routes.charging_stops import with_charging_stops
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
REFERENCE_S = 10.0


def with_fleet(problem: RoutingProblem, **changes: Any) -> RoutingProblem:
    """The problem with another fleet."""
    fleet = problem.fleet.model_dump() | changes
    return replace(problem, fleet=Fleet.model_validate(fleet))


def electric(
    town: Town,
    battery_kwh: float,
    stops: tuple[str, ...] = ("03", "33"),
    charging: str | None = None,
    depot_kw: float | None = None,
    **vehicle: Any,
) -> tuple[RoutingProblem, TrafficSnapshot]:
    """One vehicle with a battery, without reserve, at "00"."""
    own_type = {"battery_kwh": battery_kwh, "battery_reserve": 0.0}
    problem, snapshot = town(stops, [{"id": "v", "own_type": own_type, **vehicle}])
    places = [] if charging is None else [{"id": "fast", "node": charging, "power_kw": 60.0}]
    depots = [{"id": problem.fleet.depots[0].id, "node": "00", "charging_power_kw": depot_kw}]
    return with_fleet(problem, charging_stops=places, depots=depots), snapshot


def need_kwh(problem: RoutingProblem, snapshot: TrafficSnapshot, *places: str) -> float:
    """Energy of the legs between places."""
    travel = fleet_travel(problem, snapshot)
    legs = [travel.leg(a, b) for a, b in pairwise(places)]
    physics = problem.profiles[0].physics
    return sum(leg_energy_kwh(leg, physics) for leg in legs if leg is not None)


def dispatched(problem: RoutingProblem, snapshot: TrafficSnapshot) -> CycleResult:
    """One cycle in route form."""
    settings = DispatcherSettings(form="route", interval_s=2000.0, deadline_s=1000.0)
    cycle = Cycle(problem, snapshot, settings, 1, 0, 1, REFERENCE_S)
    with ThreadPoolExecutor(1) as thread:
        return run_cycle(cycle, solve_in_process([ExactSolver()]), thread)


def test_what_no_charge_reaches_is_named(town: Town) -> None:
    """With the energy that it needs; the other stop is served."""
    problem, snapshot = electric(town, 100.0)
    near, far = (need_kwh(problem, snapshot, "depot-0", stop, "depot-0") for stop in ("s0", "s1"))
    assert near < far
    problem, snapshot = electric(town, 0.5 * (near + far))
    result = dispatched(problem, snapshot)
    assert [u.stop for u in result.report.unserved] == ["s1"]
    assert f"{far:.2f} kWh are needed there and back" in result.report.unserved[0].reason
    assert [s.stop for s in result.plans[0].stops] == ["depot-0", "s0", "depot-0"]


def test_the_reserve_is_not_touched(town: Town) -> None:
    """A battery that would last to its last kWh does not last with a reserve."""
    problem, snapshot = electric(town, 100.0, ("33",))
    need = need_kwh(problem, snapshot, "depot-0", "s0", "depot-0")
    for reserve, served in ((0.0, True), (0.2, False)):
        own_type = {"battery_kwh": 1.1 * need, "battery_reserve": reserve}
        other = with_fleet(problem, vehicles=[{"id": "v", "own_type": own_type}])
        assert bool(dispatched(other, snapshot).plans) == served


def test_a_charging_stop_is_inserted_where_it_is_needed(town: Town) -> None:
    """Charging takes its time at the place's power, and the charge joins up to the end."""
    plain, snapshot = electric(town, 100.0, ("33",))
    need = need_kwh(plain, snapshot, "depot-0", "s0", "depot-0")
    problem, snapshot = electric(town, 0.8 * need, ("33",), charging="22")
    result = dispatched(problem, snapshot)
    assert result.report.unserved == ()
    (plan,) = result.plans
    places = [s.stop for s in plan.stops]
    assert sorted(places) == ["depot-0", "depot-0", "fast", "s0"]
    (at,) = (s for s in plan.stops if s.stop == "fast")
    seconds = (at.departure_ns - at.arrival_ns) * 1e-9
    assert at.charged_kwh == pytest.approx(60.0 * seconds / 3600, rel=1e-6)
    assert plan.stops[-1].charge_kwh == pytest.approx(0.0, abs=1e-4)
    assert at.node == "22"


def test_a_vehicle_charges_at_its_depot_before_it_leaves(town: Town) -> None:
    """As long as it needs, within its window; too short a window leaves the stop unserved."""
    plain, snapshot = electric(town, 100.0, ("33",))
    need = need_kwh(plain, snapshot, "depot-0", "s0", "depot-0")
    for window_s, served in ((400.0, True), (100.0, False)):
        # Half of the need is missing, and takes 300 s.
        problem, snapshot = electric(
            town,
            2 * need,
            ("33",),
            depot_kw=0.5 * need * 12,
            charge_kwh=0.5 * need,
            depart_by_s=window_s,
        )
        result = dispatched(problem, snapshot)
        assert bool(result.plans) == served
        if served:
            assert result.plans[0].depart_ns * 1e-9 == pytest.approx(REFERENCE_S + 300.0, abs=1.0)
            assert result.plans[0].stops[0].charge_kwh == pytest.approx(need, rel=1e-3)


def test_a_stop_that_charging_leaves_no_time_for_is_not_inserted(town: Town) -> None:
    """A vehicle whose tour has to begin before it has charged enough says by how much it fails;
    where its window is longer the stop is put in, and no battery is enough without a charger.
    """
    plain, snapshot = electric(town, 100.0, ("33",))
    need = need_kwh(plain, snapshot, "depot-0", "s0", "depot-0")
    half = {"charge_kwh": 0.5 * need, "depart_by_s": 100.0}
    for depot_kw, changes, said in (
        (0.5 * need * 12, half, "it would leave 200 s too late, as it has to charge before"),
        (0.5 * need * 12, half | {"depart_by_s": 400.0}, None),
        (None, half, "its battery does not last, with no charging stop in reach"),
    ):
        problem, snapshot = electric(town, 2 * need, ("33",), depot_kw=depot_kw, **changes)
        cycle = Cycle(problem, snapshot, DispatcherSettings(), 1, 0, 1, REFERENCE_S)
        result = insert_stops(cycle, {"v": ()}, ["s0"])
        (offer,) = result.tried[0].tours
        assert offer.detail == said
        assert offer.obstacle == (None if said is None else "charge")
        assert (result.found is not None) == (said is None)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"charge_kwh": None}, "no charge is planned"),
        ({"charge_kwh": 1e3}, "more charge than it can have"),
        ({"charge_kwh": 0.0}, "less than its reserve"),
        ({"charged_kwh": 5.0}, "cannot take in 5 kWh"),
    ],
)
def test_the_verifier_counts_charge_by_itself(
    town: Town, change: dict[str, Any], fault: str
) -> None:
    """A plan whose figures cannot be is refused."""
    problem, snapshot = electric(town, 100.0)
    own_type = {"battery_kwh": 100.0, "battery_reserve": 0.1}
    problem = with_fleet(problem, vehicles=[{"id": "v", "own_type": own_type}])
    (plan,) = dispatched(problem, snapshot).plans

    def faults(stops: Any) -> tuple[str, ...]:
        changed = plan.model_copy(update={"stops": stops})
        network = problem.network
        return verify_plans([changed], network, problem.fleet, (), 3.0, reference_s=REFERENCE_S)

    assert faults(plan.stops) == ()
    wrong = plan.stops[1].model_copy(update=change)
    assert any(fault in f for f in faults((plan.stops[0], wrong, *plan.stops[2:])))


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(
    capacity=st.floats(0.05, 3.0),
    reserve=st.floats(0.0, 0.5),
    start=st.floats(0.0, 1.0),
    power_kw=st.floats(1.0, 200.0),
    places=st.lists(st.sampled_from(["01", "12", "21", "32", "p"]), max_size=3, unique=True),
    order=st.permutations(["s0", "s1", "s2"]),
)
def test_charge_stays_between_reserve_and_capacity(
    town: Town,
    capacity: float,
    reserve: float,
    start: float,
    power_kw: float,
    places: list[str],
    order: list[str],
) -> None:
    """On every route that is given, whatever the battery; a battery that lasts never detours."""
    problem, snapshot = town(["03", "31", "22"], [{"id": "v"}])
    table = [{"id": f"c{n}", "node": node, "power_kw": power_kw} for n, node in enumerate(places)]
    problem = with_fleet(problem, charging_stops=table)
    travel, physics = fleet_travel(problem, snapshot), problem.profiles[0].physics
    stops = ["depot-0", *order, "depot-0"]
    legs = [leg for a, b in pairwise(stops) if (leg := travel.leg(a, b))]
    battery = Battery(capacity, reserve * capacity, start * capacity)

    def energy_kwh(leg: RoadLeg) -> float:
        return leg_energy_kwh(leg, physics)

    found = with_charging_stops(
        battery, problem.fleet, travel, legs, battery.charge_kwh, energy_kwh
    )
    direct = battery.charge_kwh - sum(map(energy_kwh, legs)) >= battery.reserve_kwh
    if found is None:
        assert not direct
        return
    charges = charges_kwh(battery, found, [energy_kwh(leg) for leg in found], battery.charge_kwh)
    assert min(charges[1:]) >= battery.reserve_kwh - 1e-5
    if direct:
        assert found == legs
    for leg, arrival in zip(found, charges[1:], strict=True):
        if leg.charging is not None:
            assert arrival + leg.charging.energy_kwh <= capacity + 1e-6
            seconds = leg.charging.energy_kwh / power_kw * 3600
            assert leg.charging.duration_s == pytest.approx(seconds)
    assert [leg.end for leg in found if leg.charging is None] == stops[1:]


def test_tours_are_cut_to_what_batteries_last(town: Town) -> None:
    """Two vehicles share stops that one would serve alone on a full battery."""
    problem, snapshot = electric(town, 100.0, ("30", "03", "33"))
    whole = need_kwh(problem, snapshot, "depot-0", "s0", "s2", "s1", "depot-0")
    far = need_kwh(problem, snapshot, "depot-0", "s2", "depot-0")
    own_type = {"battery_kwh": 0.5 * (far + whole), "battery_reserve": 0.0}
    vehicles = [{"id": name, "own_type": own_type} for name in ("a", "b")]
    result = dispatched(with_fleet(problem, vehicles=vehicles), snapshot)
    assert result.report.unserved == ()
    assert len(result.plans) == 2
