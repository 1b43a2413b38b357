"""No carrier has less than alone, and plans keep each carrier's stops with its vehicles."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.improvement.carriers import Accounts, nobody_worse_off
from dispatcher_daemon.planning.improvement.exchanges import best_exchanges
from dispatcher_daemon.planning.improvement.sweeps import BlockDescent
from dispatcher_daemon.planning.plans import Candidate, Cycle
from dispatcher_daemon.planning.platooning.reductions import planned_reductions
from dispatcher_daemon.planning.roads import Route
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.route_form import route_cycle
from dispatcher_daemon.planning.route_form.fleet_plan import departing_when_ready
from dispatcher_daemon.planning.routes.base_routes import base_routes
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.consumption import drag_saving_kwh
from slipstream.messages import VehiclePlan
from slipstream_lab.research.cities.generator import CityShape, generate_city, with_carriers

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
AMPLE_S = 250.0
"""No search here takes so long on a machine that stalls: a plan is the same again."""
SETTINGS = DispatcherSettings(
    form="route",
    solvers=("exact",),
    deadline_s=AMPLE_S,
    interval_s=AMPLE_S + 1.0,
    city=CitySettings(
        search=SearchSettings(rounds=2, iterations_per_stop=5, workers=1, time_limit_s=AMPLE_S),
        block_deadline_s=AMPLE_S,
        second_rounds=1,
        max_sweeps=4,
        patience=2,
    ),
)
SOLVE = solve_in_process([ExactSolver()])
MANY_SEEDS = [
    3,
    *(pytest.param(n, marks=pytest.mark.long) for n in (0, 1)),
    *(pytest.param(n, marks=pytest.mark.nightly) for n in range(4, 24)),
]


def cycle_of(problem: RoutingProblem, snapshot: TrafficSnapshot) -> Cycle:
    """Cycle 3."""
    return Cycle(problem, snapshot, SETTINGS, 3, snapshot.now_ns, 11, reference_delay_s=10.0)


def planner_of(problem: RoutingProblem, snapshot: TrafficSnapshot) -> Planner:
    """With the ways of least energy."""
    return Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)


def convoy(
    town: Town, carriers: Sequence[str | None], price_kw: float = 0.0
) -> tuple[RoutingProblem, TrafficSnapshot]:
    """Two vans to one far junction; the second is ready a minute after the first, which may wait
    and then leads: of two that enter at once the first by name does.
    """
    stops = [
        {"id": f"s{n}", "node": "33", "service_s": 20.0, "carrier": carrier}
        for n, carrier in enumerate(carriers)
    ]
    vehicles = [
        {"ready_s": 60.0 * n, "depart_by_s": 120.0, "first_stop": f"s{n}", "carrier": carrier}
        for n, carrier in enumerate(carriers)
    ]
    problem, snapshot = town(stops, vehicles)
    return replace(problem, price_of_waiting_kw=price_kw), snapshot


def together(problem: RoutingProblem, snapshot: TrafficSnapshot) -> tuple[Planner, list[Itinerary]]:
    """Both leave when the second is ready."""
    planner = planner_of(problem, snapshot)
    found = [planner.itinerary(n, (f"s{n}",), planner.legs(n, (f"s{n}",)), 60.0) for n in (0, 1)]
    return planner, [itinerary for itinerary in found if itinerary is not None]


def test_who_leads_has_less_than_who_follows(town: Town) -> None:
    """The place in a platoon decides what each has; both together have what the plan saves."""
    planner, pair = together(*convoy(town, ("a", "b")))
    base = departing_when_ready(planner, {"van-0": ("s0",), "van-1": ("s1",)}, {})
    accounts = Accounts(planner, base, base)
    assert accounts.gains_kwh() == {"a": 0.0, "b": 0.0}
    accounts.change(pair)
    gains = accounts.gains_kwh()
    assert 0 < 2 * gains["a"] < gains["b"]
    meetings = planner.book.meetings()
    assert math.fsum(gains.values()) == pytest.approx(sum(meetings.add(i.traversals) for i in pair))
    accounts.change(base)
    assert list(accounts.gains_kwh().values()) == pytest.approx([0.0, 0.0], abs=1e-12)


def waiting_price_kw(town: Town) -> float:
    """At which a minute costs more than a leader saves, and less than both save."""
    planner, pair = together(*convoy(town, ("a", "b")))
    base = departing_when_ready(planner, {"van-0": ("s0",), "van-1": ("s1",)}, {})
    gains = Accounts(planner, base, pair).gains_kwh()
    return (gains["a"] + 0.5 * gains["b"]) * 60.0


@pytest.mark.parametrize(
    ("carriers", "meet"),
    [((None, None), True), (("a", "a"), True), (("a", "b"), False), (("a", None), False)],
)
def test_a_leader_that_would_lose_does_not_wait_for_another_carrier(
    town: Town, carriers: tuple[str | None, str | None], meet: bool
) -> None:
    """Within a carrier one waits for the other, as both together gain; between two none does.
    Vehicles without a carrier are one carrier, and another one than any that has a name.
    """
    problem, snapshot = convoy(town, carriers, waiting_price_kw(town))
    result = run_cycle(cycle_of(problem, snapshot), SOLVE)
    departures = {plan.vehicle: plan.depart_ns for plan in result.plans}
    assert (departures["van-0"] == departures["van-1"]) is meet
    assert any(s.platoon for plan in result.plans for s in plan.segments) is meet
    told = {summary.carrier: summary for summary in result.report.carriers}
    assert set(told) == (set() if meet else set(carriers))
    for summary in told.values():
        assert summary.saved_cost_kwh == 0.0
        assert summary.cooperative_kwh == summary.baseline_kwh


def test_free_waits_stay_and_their_worth_is_told(town: Town) -> None:
    """Where waiting costs nothing both carriers gain, and the report says what each has."""
    problem, snapshot = convoy(town, ("a", "b"))
    result = run_cycle(cycle_of(problem, snapshot), SOLVE)
    leads, follows = result.report.carriers
    assert (leads.carrier, follows.carrier) == ("a", "b")
    assert 0 < leads.saved_cost_kwh < follows.saved_cost_kwh
    assert result.report.energy is not None
    parts = leads.cooperative_kwh + follows.cooperative_kwh
    assert parts == pytest.approx(result.report.energy.cooperative_kwh)
    parts = leads.baseline_kwh + follows.baseline_kwh
    assert parts == pytest.approx(result.report.energy.baseline_kwh)


def test_what_is_undone_keeps_every_stop(town: Town) -> None:
    """Vehicles that have exchanged stops go back together; the other carrier's stay."""
    stops = [
        {"id": name, "node": node, "service_s": 20.0, "carrier": name[0]}
        for name, node in (("a1", "33"), ("a2", "30"), ("b1", "33"))
    ]
    vehicles = [{"carrier": carrier, "depart_by_s": 300.0} for carrier in "aab"]
    problem, snapshot = town(stops, vehicles)
    problem = replace(problem, price_of_waiting_kw=20.0)
    planner = planner_of(problem, snapshot)

    def plan(departures: Sequence[float], *visits: tuple[str, ...]) -> list[Itinerary]:
        made = [
            planner.itinerary(n, own, planner.legs(n, own), depart_s)
            for n, (own, depart_s) in enumerate(zip(visits, departures, strict=True))
        ]
        return [itinerary for itinerary in made if itinerary is not None]

    base = plan([0.0, 0.0, 0.0], ("a1",), ("a2",), ("b1",))
    # Carrier a has exchanged its stops and waits long for nobody.
    other = plan([0.0, 200.0, 0.0], ("a2",), ("a1",), ("b1",))
    accounts = nobody_worse_off(planner, base, other)
    assert accounts is not None
    fair = accounts.present
    assert [i.stops for i in fair] == [("a1",), ("a2",), ("b1",)]
    assert fair[:2] == base[:2]
    assert fair[2] is other[2]
    assert min(accounts.gains_kwh().values()) >= 0


def random_fleet(seed: int, town: Town) -> tuple[RoutingProblem, TrafficSnapshot]:
    """Three to six vans of up to three carriers; stops of theirs and of anybody; waiting costs
    nothing, little or much. The price of an order's lateness does not matter: there is none.
    """
    rng = np.random.default_rng(seed)
    carriers = [None, "a", "b"][int(rng.integers(2)) :]
    count = int(rng.integers(len(carriers), 7))
    owners = [carriers[n % len(carriers)] for n in range(count)]
    vehicles: list[dict[str, Any]] = [
        {
            "carrier": owner,
            "ready_s": float(rng.integers(0, 120)),
            "depart_by_s": float(rng.integers(120, 400)),
            "capacity": int(rng.integers(2, 5)),
        }
        for owner in owners
    ]
    stops = [
        {
            "id": f"s{n}",
            "node": f"{rng.integers(1, 4)}{rng.integers(1, 4)}",
            "service_s": 20.0,
            "demand": 1,
            "carrier": None if rng.random() < 0.25 else carriers[int(rng.integers(len(carriers)))],
        }
        for n in range(int(rng.integers(4, 2 * count + 1)))
    ]
    if rng.random() < 0.3:
        vehicles[0]["first_stop"] = "s0"
        stops[0]["carrier"] = owners[0]
    problem, snapshot = town(stops, vehicles, seed=seed)
    price_kw = float(rng.choice([0.0, 0.05, 0.2, 1.0]))
    return replace(problem, price_of_waiting_kw=price_kw), snapshot


def costs_kwh(problem: RoutingProblem, routes: Sequence[Route], reference_s: float) -> Counter[Any]:
    """Cost of the routes by carrier, as a sum over legs and waits."""
    found: Counter[Any] = Counter()
    for route in routes:
        vehicle = problem.fleet.vehicle_by_id[route.vehicle]
        waits_s = route.visits[0].departure_s - reference_s - vehicle.ready_s
        found[vehicle.carrier] += sum(leg.cost_kwh for leg in route.legs)
        found[vehicle.carrier] += problem.price_of_waiting_kw * waits_s / 3600.0
        at_stops_s = sum(visit.wait_s for visit in route.visits)
        found[vehicle.carrier] += problem.price_of_standing_kw * at_stops_s / 3600.0
    return found


def drafted_kwh(problem: RoutingProblem, plans: Sequence[VehiclePlan]) -> Counter[Any]:
    """What each carrier's vehicles save, from platoons, places and shares in the messages alone."""
    platoons: dict[tuple[str, str], list[tuple[str, int, float, float]]] = defaultdict(list)
    for plan in plans:
        for segment in plan.segments:
            if segment.platoon is not None and segment.place is not None:
                key = segment.segment, segment.platoon
                share = segment.drafting_share
                assert share is not None
                platoons[key].append((plan.vehicle, segment.place, segment.speed_mps, share))
    found: Counter[Any] = Counter()
    for (name, _), members in platoons.items():
        length_m = problem.network.segments[name].length_m
        for vehicle, place, speed_mps, share in members:
            profile = problem.profile_of(vehicle)
            eta = planned_reductions(problem, profile, speed_mps).at(place, len(members))
            saved = share * drag_saving_kwh(length_m, speed_mps, eta, profile.physics)
            found[problem.fleet.vehicle_by_id[vehicle].carrier] += saved
    return found


def check(problem: RoutingProblem, snapshot: TrafficSnapshot) -> CycleResult:
    """Published plans serve each stop by its carrier, and no carrier has less than alone; what the
    report says is what the plans are worth.
    """
    this = cycle_of(problem, snapshot)
    result = run_cycle(this, SOLVE)
    fleet = problem.fleet
    for plan in result.plans:
        owner = fleet.vehicle_by_id[plan.vehicle].carrier
        served = [fleet.stop_by_id[stop.stop].carrier for stop in plan.service_stops]
        assert set(served) <= {owner, None}
    with ThreadPoolExecutor(1) as thread:
        again = route_cycle(this, SOLVE, thread)
    assert isinstance(again.baseline, Candidate)
    tried = [c for c in (*again.candidates, again.fallback) if isinstance(c, Candidate)]
    published = next(candidate for candidate in tried if candidate.plans == result.plans)
    alone = costs_kwh(problem, again.baseline.routes, this.reference_s)
    cost = costs_kwh(problem, published.routes, this.reference_s)
    saved = drafted_kwh(problem, result.plans)
    told = {of_one.carrier: of_one.saved_cost_kwh for of_one in result.report.carriers}
    assert set(told) == (set(fleet.carriers) if len(fleet.carriers) > 1 else set())
    for carrier in fleet.carriers:
        gain = alone[carrier] - cost[carrier] + saved[carrier]
        assert gain >= -1e-9, carrier
        if told:
            assert told[carrier] == pytest.approx(gain, abs=1e-9)
    return result


@pytest.mark.slow
@pytest.mark.parametrize("seed", MANY_SEEDS)
def test_random_fleets_keep_their_stops_and_nobody_loses(town: Town, seed: int) -> None:
    """See `check`. Of every other fleet platoons count as expected."""
    problem, snapshot = random_fleet(seed, town)
    check(replace(problem, drafting="expected" if seed % 2 else "ideal"), snapshot)


@pytest.mark.long
@pytest.mark.parametrize("carriers", [4])
def test_no_carrier_of_a_city_loses(carriers: int) -> None:
    """Twelve vans at one depot, of few carriers or each of its own."""
    shape = CityShape(depots=1, open_share=0.9, window_share=0.3)
    city = generate_city(1, vehicles=12, stops=36, segments=160, shape=shape)
    city = with_carriers(city, carriers)
    problem = replace(city.problem, price_of_time_kw=2.0, price_of_waiting_kw=0.1)
    result = check(problem, city.snapshot)
    assert any(of_one.saved_cost_kwh > 1e-6 for of_one in result.report.carriers)


def test_a_plan_names_nothing_of_another_carrier(town: Town) -> None:
    """Of vehicles, stops, depots and carriers none but its own stands in any field of a plan, and
    a platoon's name is made of numbers.
    """
    ids: dict[str, dict[str, str]] = {
        carrier: {what: f"{what}-of-{carrier}" for what in ("van", "parcel", "yard")}
        for carrier in ("smith", "jones")
    }
    problem, snapshot = town(
        [
            {"id": own["parcel"], "node": "33", "carrier": carrier, "latest_s": 2000.0}
            for carrier, own in ids.items()
        ],
        [
            {"id": own["van"], "depot": f"depot-{n}", "carrier": carrier, "depart_by_s": 60.0}
            for n, (carrier, own) in enumerate(ids.items())
        ],
        depots=("00", "00"),
    )
    yards = tuple(
        depot.model_copy(update={"id": own["yard"]})
        for depot, own in zip(problem.fleet.depots, ids.values(), strict=True)
    )
    vans = tuple(
        van.model_copy(update={"depot": own["yard"]})
        for van, own in zip(problem.fleet.vehicles, ids.values(), strict=True)
    )
    fleet = type(problem.fleet)(depots=yards, stops=problem.fleet.stops, vehicles=vans)
    result = run_cycle(cycle_of(replace(problem, fleet=fleet), snapshot), SOLVE)
    assert len(result.plans) == 2
    for plan, (own, other) in zip(
        result.plans, (("smith", "jones"), ("jones", "smith")), strict=True
    ):
        text = plan.model_dump_json()
        assert {segment.platoon for segment in plan.segments} >= {"c3-p1"}
        assert other not in text
        assert all(name in text for name in ids[own].values())


def test_base_routes_keep_to_carriers(town: Town) -> None:
    """Also where a stop is anybody's, and where another carrier's van would be nearer."""
    nodes = ("33", "30", "03", "22", "11", "23")
    for owners in ("ababab", "abab--"):
        stops = [
            {"id": f"s{n}", "node": node, "carrier": None if owner == "-" else owner}
            for n, (node, owner) in enumerate(zip(nodes, owners, strict=True))
        ]
        problem, snapshot = town(
            stops,
            [{"carrier": "a"}, {"carrier": "b", "depot": "depot-1"}, {}],
            depots=("00", "33"),
        )
        travel = Travel(problem, roads_of(problem, snapshot))
        with ThreadPoolExecutor(1) as thread:
            names = [stop.id for stop in problem.fleet.stops]
            routes = base_routes(problem, travel, names, SETTINGS.city.search, thread, 1)
        assert routes.unassigned == ()
        for vehicle in problem.fleet.vehicles:
            for stop in routes.stops[vehicle.id]:
                assert problem.fleet.stop_by_id[stop].carrier in (None, vehicle.carrier)


def test_other_routes_are_adopted_within_a_carrier(town: Town) -> None:
    """Routes that serve the same stops better are not taken where a stop would change its carrier:
    what it is compared with has it.
    """
    for carriers, adopted in ((("a", "a"), 1), (("a", "b"), 0)):
        problem, snapshot = town(
            ["11", "22"],
            [{"carrier": carrier, "depot": f"depot-{n}"} for n, carrier in enumerate(carriers)],
            depots=("00", "33"),
        )
        planner = planner_of(problem, snapshot)
        crossed = departing_when_ready(planner, {"van-0": ("s1",), "van-1": ("s0",)}, {})
        descent = BlockDescent(planner, SETTINGS.city, SOLVE, crossed)
        straight = {"van-0": ("s0",), "van-1": ("s1",)}
        assert descent.adopt(straight, 1, math.inf, lambda: 0.0) == adopted
        assert (descent.present[0].stops == ("s0",)) is bool(adopted)


def test_stops_are_exchanged_within_a_carrier(town: Town) -> None:
    """Even those that are anybody's: who serves them is settled before."""
    problem, snapshot = town(
        ["33", "30", "03"], [{"carrier": "a"}, {"carrier": "a"}, {"carrier": "b"}]
    )
    planner = planner_of(problem, snapshot)
    present = departing_when_ready(planner, {f"van-{n}": (f"s{n}",) for n in range(3)}, {})
    meetings = planner.book.meetings()
    for itinerary in present:
        meetings.add(itinerary.traversals)
    found = best_exchanges(planner, present, meetings, 50, np.random.default_rng(1))
    assert {frozenset(i.number for i in pair) for pair in found} == {frozenset({0, 1})}
