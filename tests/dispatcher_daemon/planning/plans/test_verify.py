from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from dispatcher_daemon.fleet import Depot, Fleet
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import run_cycle
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.planning.plans.verify import verify_plans
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.messages import VehiclePlan

OPEN = {"avenue_east", "avenue_west"}
Plain = list[dict[str, Any]]


@pytest.fixture(scope="module")
def plans(
    demo: RoutingProblem, traffic: Callable[..., TrafficSnapshot], now_ns: int
) -> tuple[VehiclePlan, ...]:
    """The demo's crossing plans: platoons on both avenues."""
    settings = DispatcherSettings(solvers=("exact",))
    snapshot = traffic(avenue_east=1, avenue_west=1)
    solve = solve_in_process([ExactSolver()])
    return run_cycle(Cycle(demo, snapshot, settings, 1, now_ns, 1), solve).plans


def verify(
    demo: RoutingProblem,
    plans: Sequence[VehiclePlan],
    open_segments: set[str] = OPEN,
    sync_window_s: float = 3.0,
    unserved: tuple[str, ...] = (),
    longest: int = 2,
) -> tuple[str, ...]:
    """Faults of plans of a cycle that was given its time to solve."""
    deadline_s = DispatcherSettings().deadline_s
    return verify_plans(
        plans,
        demo.network,
        demo.fleet,
        open_segments,
        sync_window_s,
        longest=longest,
        unserved=unserved,
        reference_s=deadline_s,
    )


def faults(demo: RoutingProblem, plans: Plain, open_segments: set[str] = OPEN) -> str:
    """All faults as one text."""
    rebuilt = [VehiclePlan.model_validate(plan) for plan in plans]
    return "\n".join(verify(demo, rebuilt, open_segments))


def spoilt(plans: tuple[VehiclePlan, ...], spoil: Callable[[Plain], None]) -> Plain:
    """The plans as plain data, changed."""
    plain = [plan.model_dump() for plan in plans]
    for plan in plain:
        plan["stops"], plan["segments"] = list(plan["stops"]), list(plan["segments"])
    spoil(plain)
    for plan in plain:
        plan["stops"], plan["segments"] = tuple(plan["stops"]), tuple(plan["segments"])
    return plain


def test_sound_plans_pass(demo: RoutingProblem, plans: tuple[VehiclePlan, ...]) -> None:
    """The dispatcher's own plans have no fault."""
    assert verify(demo, plans) == ()


def test_a_platoon_has_no_more_vehicles_than_its_brakes_allow(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """One line names the platoon and the road."""
    found = verify(demo, plans, longest=1)
    assert found
    assert all("2 vehicles, more than the 1 that their brakes allow" in fault for fault in found)


def put(value: Any, *path: Any) -> Callable[[Plain], None]:
    """Another value, or what becomes of the present one, at some place of the plans."""

    def spoil(plain: Any) -> None:
        *way, last = path
        for step in way:
            plain = plain[step]
        plain[last] = value(plain[last]) if callable(value) else value

    return spoil


def both(*spoils: Callable[[Plain], None]) -> Callable[[Plain], None]:
    """One after the other."""
    return lambda plain: [spoil(plain) for spoil in spoils].clear()


def without(number: int, *path: Any) -> Callable[[Plain], None]:
    """A list without one of its entries."""
    return put(lambda rows: [*rows[:number], *rows[number + 1 :]], *path)


def later(moment_ns: int) -> int:
    """By 5 ms."""
    return moment_ns + 5_000_000


STOPS, WAY, AVENUE = (0, "stops"), (0, "segments"), 2
A, B = (0, "segments", AVENUE), (1, "segments", AVENUE)
FIRST, SECOND = (*WAY, 0), (*WAY, 1)
LEADER, FOLLOWER = {"place": 0, "gap_m": None}, {"place": 1, "gap_m": 1.5}
NO_PLACE = put(None, *B, "place")


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (lambda p: p.pop(1), "stop c3: served 0 times"),
        (lambda p: p.append(p[0]), "van-a: has more than one plan"),
        (put("van-x", 0, "vehicle"), "van-x: not in the fleet"),
        (put(2, 0, "cycle"), "plans of different cycles"),
        (put(lambda stops: stops[:2], *STOPS), "van-a: serves no stop"),
        (put(lambda stops: stops[:-1], *STOPS), "van-a: does not end at its depot"),
        (put("west", *STOPS, 1, "node"), "van-a: no stop c1 at node west"),
        (put("west", *STOPS, 2, "node"), "van-a: no stop c4 at node west"),
        (put(lambda s: [s[0], s[2], s[1], *s[3:]], *STOPS), "van-a: does not serve c1 first"),
        (without(0, *WAY), "van-a: leg 0 does not join its stops"),
        (without(3, *WAY), "van-a: leg 0 does not join its stops"),
        (without(1, *WAY), "van-a: no turn from depot_road_east into avenue_east"),
        (
            put("mill_street_east", *SECOND, "segment"),
            "van-a: no turn from mill_street_east into avenue_east",
        ),
        (
            put("avenue_west", *WAY, 3, "segment"),
            "van-a: no turn from avenue_east into avenue_west",
        ),
        (put("moon_street", *SECOND, "segment"), "van-a: unknown segments ['moon_street']"),
        (
            put(1, *FIRST, "leg"),
            "van-a: its legs are not one after another between its stops",
        ),
        (
            put(lambda way: [s for s in way if s["leg"] != 1], *WAY),
            "van-a: its legs are not one after another between its stops",
        ),
        (
            lambda p: p[0].update(depart_ns=p[0]["issued_ns"] - 1),
            "van-a: leaves before its plan is issued, or at another time than its first stop says",
        ),
        (
            put(lambda stop: {**stop, "departure_ns": stop["arrival_ns"]}, *STOPS, 1),
            "van-a: leaves c1 before it is served",
        ),
        (put(later, *SECOND, "entry_ns"), "van-a: the times of leg 0 do not join up"),
        (put(later, *WAY, -1, "entry_ns"), "van-a: the times of leg 2 do not join up"),
        (put(30.0, *FIRST, "speed_mps"), "van-a: faster than allowed on depot_road_east"),
        (
            put(lambda mps: 1.01 * mps, *FIRST, "speed_mps"),
            "van-a: faster than allowed on depot_road_east",
        ),
        (
            both(put("moon_street", *FIRST, "segment"), put(30.0, *SECOND, "speed_mps")),
            "van-a: faster than allowed on gate_east",
        ),
        (
            put(lambda s: {**s, "exit_ns": s["entry_ns"] + 10**9}, *FIRST),
            "van-a: faster than allowed on depot_road_east",
        ),
        (
            put(lambda s: {**s, "exit_ns": s["entry_ns"]}, *FIRST),
            "van-a: faster than allowed on depot_road_east",
        ),
        (put(lambda m: m - 100.0, 0, "distance_m"), "van-a: distance is 7356 m, not 7256 m"),
        (put(lambda m: m - 1.5, 0, "distance_m"), "van-a: distance is 7356 m, not 7354 m"),
        (
            lambda p: p[0].update(valid_until_ns=p[0]["issued_ns"]),
            "van-a: is valid until before it is issued",
        ),
        (
            put(1.5, *A, "gap_m"),
            "van-a on avenue_east: a gap is for followers, and for each of them",
        ),
        (
            put(None, *B, "gap_m"),
            "van-b on avenue_east: a gap is for followers, and for each of them",
        ),
        (
            put(lambda s: {**s, "platoon": None, "place": None, "gap_m": None}, *B),
            "platoon c1-p1 on avenue_east: fewer than two vehicles, or one of them twice",
        ),
        (put(None, *B, "platoon"), "van-b on avenue_east: a place or gap without a platoon"),
        (
            put(1, 1, "segments", 0, "place"),
            "van-b on depot_road_east: a place or gap without a platoon",
        ),
        (
            put(1.5, 1, "segments", 0, "gap_m"),
            "van-b on depot_road_east: a place or gap without a platoon",
        ),
        (
            put(0.5, 1, "segments", 0, "drafting_share"),
            "van-b on depot_road_east: drafting without a platoon",
        ),
        (
            put(lambda s: s | LEADER, *B),
            "platoon c1-p1 on avenue_east: places are not 0, 1, 2 ...",
        ),
        (NO_PLACE, "platoon c1-p1 on avenue_east: places are not 0, 1, 2 ..."),
        (
            both(put(lambda s: s | FOLLOWER, *A), put(lambda s: s | LEADER, *B)),
            "platoon c1-p1 on avenue_east: places are not in the order of entry",
        ),
    ],
)
def test_every_broken_rule_is_found(
    demo: RoutingProblem,
    plans: tuple[VehiclePlan, ...],
    spoil: Callable[[Plain], None],
    fault: str,
) -> None:
    """A plan set that breaks one rule is refused for it, in a line that says so."""
    assert fault in faults(demo, spoilt(plans, spoil)).splitlines()


def test_a_member_without_a_place_stands_before_all_others(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """Its entry is then not in their order either."""
    found = faults(demo, spoilt(plans, NO_PLACE)).splitlines()
    assert "platoon c1-p1 on avenue_east: places are not in the order of entry" in found


@pytest.mark.parametrize("own", ["van-a", "van-b"])
def test_each_vehicle_starts_and_ends_at_a_depot_of_its_own(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...], own: str
) -> None:
    """Plans of one depot are refused for a vehicle of another one, and for no other vehicle."""
    fleet = Fleet(
        depots=(*demo.fleet.depots, Depot(id="yard", node="west")),
        stops=demo.fleet.stops,
        vehicles=tuple(
            v.model_copy(update={"depot": "yard"}) if v.id == own else v
            for v in demo.fleet.vehicles
        ),
    )
    assert verify(replace(demo, fleet=fleet), plans) == (
        f"{own}: does not start at its depot",
        f"{own}: does not end at its depot",
    )


@pytest.mark.parametrize(("first", "unserved"), [(None, ()), ("c2", ("c2",))])
def test_any_stop_may_be_first_where_none_has_to_be(
    demo: RoutingProblem,
    plans: tuple[VehiclePlan, ...],
    first: str | None,
    unserved: tuple[str, ...],
) -> None:
    """No first stop is asked for, or the one that is has been left out."""
    fleet = demo.fleet
    vehicles = (fleet.vehicles[0].model_copy(update={"first_stop": first}), fleet.vehicles[1])
    free = Fleet(depots=fleet.depots, stops=fleet.stops, vehicles=vehicles)
    found = verify(replace(demo, fleet=free), plans, unserved=unserved)
    assert not [fault for fault in found if "first" in fault]


def two_at_one_place(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> tuple[RoutingProblem, Plain]:
    """The same plans with half of c1's service for another stop at its node: a leg without way."""
    fleet = demo.fleet
    half = fleet.stops[0].model_copy(update={"service_s": 30.0})
    stops = (half, half.model_copy(update={"id": "c1-too"}), *fleet.stops[1:])
    problem = replace(demo, fleet=Fleet(depots=fleet.depots, stops=stops, vehicles=fleet.vehicles))

    def split(p: Plain) -> None:
        c1 = p[0]["stops"][1]
        between_ns = c1["arrival_ns"] + 30 * 10**9
        p[0]["stops"].insert(2, {**c1, "stop": "c1-too", "arrival_ns": between_ns})
        c1["departure_ns"] = between_ns
        for segment in p[0]["segments"]:
            segment["leg"] += segment["leg"] > 0

    return problem, spoilt(plans, split)


def test_two_stops_at_one_place_have_no_way_between_them(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """Such a leg is sound, takes no time, and what is wrong behind it is found all the same."""
    problem, sound = two_at_one_place(demo, plans)
    assert faults(problem, sound) == ""
    late = [{**sound[0], "stops": [dict(stop) for stop in sound[0]["stops"]]}, sound[1]]
    late[0]["stops"][2]["arrival_ns"] += 1
    late[0]["stops"] = tuple(late[0]["stops"])
    late[0]["segments"] = tuple(
        {**s, "segment": "mill_street_west"} if s["segment"] == "dock_street_west" else s
        for s in sound[0]["segments"]
    )
    hole = [*late[0]["segments"][:-1], {**late[0]["segments"][-1]}]
    hole[-1]["entry_ns"] += 1
    late[0]["segments"] = tuple(hole)
    assert faults(problem, late).splitlines() == [
        "van-a: leg 3 does not join its stops",
        "van-a: takes time for leg 1, which has no way",
        "van-a: the times of leg 3 do not join up",
    ]


def test_a_way_from_a_stop_to_itself_may_be_driven(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """Segments of a leg between two stops at one node are a leg like any other."""
    problem, sound = two_at_one_place(demo, plans)
    around = {**sound[0]["segments"][4], "leg": 1}
    sound[0]["segments"] = (*sound[0]["segments"][:4], around, *sound[0]["segments"][4:])
    found = faults(problem, sound)
    assert "van-a: leg 1 does not join its stops" in found
    assert "one after another" not in found


TOLERANCE_NS = 1_000_000
BEGIN_S = DispatcherSettings().deadline_s


@pytest.mark.parametrize(
    ("stop", "vehicle", "where", "limit_s", "fault"),
    [
        ({}, {"depart_by_s": 30.0}, ("depart_ns",), -2.0, "leaves outside its window"),
        ({}, {"depart_by_s": 30.0}, ("depart_ns",), 30.0, "leaves outside its window"),
        ({}, {}, ("depart_ns",), 2.0, "leaves outside its window"),
        ({}, {"return_by_s": 640.0}, ("stops", -1, "arrival_ns"), 640.0, "is back too late"),
        (
            {"earliest_s": 480.0},
            {},
            ("stops", 2, "departure_ns"),
            -(480.0 + 60.0),
            "serves c2 before its window",
        ),
        (
            {"latest_s": 480.0},
            {},
            ("stops", 2, "arrival_ns"),
            480.0,
            "comes to c2 after its window",
        ),
    ],
)
def test_windows_end_a_millisecond_behind_their_limits(
    demo: RoutingProblem,
    plans: tuple[VehiclePlan, ...],
    stop: dict[str, float],
    vehicle: dict[str, float],
    where: tuple[str | int, ...],
    limit_s: float,
    fault: str,
) -> None:
    """For rounding, and no nanosecond more; a limit below 0 stands for an earliest time."""
    fleet = demo.fleet
    problem = replace(
        demo,
        fleet=Fleet(
            depots=fleet.depots,
            stops=(fleet.stops[0], fleet.stops[1].model_copy(update=stop), *fleet.stops[2:]),
            vehicles=(fleet.vehicles[0], fleet.vehicles[1].model_copy(update=vehicle)),
        ),
    )
    edge_ns = round((BEGIN_S + abs(limit_s)) * 1e9)
    for beyond_ns in (0, 1):
        further_ns = TOLERANCE_NS + beyond_ns

        def move(p: Plain, further_ns: int = further_ns) -> None:
            place: Any = p[1]
            for key in where[:-1]:
                place = place[key]
            shift_ns = further_ns if limit_s > 0 else -further_ns
            place[where[-1]] = p[1]["issued_ns"] + edge_ns + shift_ns

        found = faults(problem, spoilt(plans, move)).splitlines()
        assert (f"van-b: {fault}" in found) == (beyond_ns == 1)


def test_times_count_from_the_issue_of_the_plans_unless_told_otherwise(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """A vehicle that is ready at once may leave at once, at the moment of issue itself."""

    def departs_at_issue(p: Plain) -> None:
        now_ns = p[0]["issued_ns"]
        p[0]["depart_ns"] = now_ns
        p[0]["stops"][0].update(arrival_ns=now_ns, departure_ns=now_ns)

    rebuilt = [VehiclePlan.model_validate(plan) for plan in spoilt(plans, departs_at_issue)]
    found = verify_plans(rebuilt, demo.network, demo.fleet, OPEN, 3.0)
    assert not [fault for fault in found if fault.startswith("van-a: leaves")]


@pytest.mark.parametrize(("stop", "needed_s"), [(0, 0.0), (1, 60.0)])
def test_service_may_be_short_by_rounding_alone(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...], stop: int, needed_s: float
) -> None:
    """By a millisecond and no nanosecond more; a depot needs no time."""
    name = plans[0].stops[stop].stop
    for short_ns in (TOLERANCE_NS, TOLERANCE_NS + 1):

        def hasten(p: Plain, short_ns: int = short_ns) -> None:
            visit = p[0]["stops"][stop]
            visit["arrival_ns"] = visit["departure_ns"] - round(needed_s * 1e9) + short_ns

        found = faults(demo, spoilt(plans, hasten))
        assert (f"van-a: leaves {name} before it is served" in found) == (short_ns > TOLERANCE_NS)


def test_the_speed_limit_itself_may_be_driven(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """With a thousandth for rounding, by the speed that is said and by the times; on a road that
    is passed within a second as well.
    """
    road = demo.network.segments["depot_road_east"]
    limit_mps = road.speed_limit_mps * (1 + 1e-3)
    for seconds, faster in ((40.0, False), (0.5, False), (40.0, True)):
        length_m = limit_mps * seconds + (0.001 if faster else 0.0)

        def drive(p: Plain, seconds: float = seconds) -> None:
            first = p[0]["segments"][0]
            first["speed_mps"] = limit_mps
            first["exit_ns"] = first["entry_ns"] + round(seconds * 1e9)

        segments = {**demo.network.segments, road.id: replace(road, length_m=length_m)}
        problem = replace(demo, network=replace(demo.network, segments=segments))
        found = faults(problem, spoilt(plans, drive))
        assert ("van-a: faster than allowed on depot_road_east" in found) == faster


def test_the_distance_may_be_off_by_a_metre(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """Not by more."""
    driven_m = sum(demo.network.segments[s.segment].length_m for s in plans[0].segments)

    def shorten(p: Plain) -> None:
        p[0]["distance_m"] = driven_m - 1.0

    assert faults(demo, spoilt(plans, shorten)) == ""


def test_a_vehicle_may_be_filled_up(demo: RoutingProblem, plans: tuple[VehiclePlan, ...]) -> None:
    """A load of just its capacity is none too many."""
    fleet = demo.fleet
    full = Fleet(
        depots=fleet.depots,
        stops=tuple(stop.model_copy(update={"demand": 4}) for stop in fleet.stops),
        vehicles=tuple(v.model_copy(update={"capacity": 8}) for v in fleet.vehicles),
    )
    assert verify(replace(demo, fleet=full), plans) == ()


@pytest.mark.parametrize("beyond_ns", [0, 1])
def test_platoon_members_may_be_the_whole_window_apart(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...], beyond_ns: int
) -> None:
    """And a millisecond for rounding."""

    def apart(p: Plain) -> None:
        leader_ns = p[0]["segments"][AVENUE]["entry_ns"]
        p[1]["segments"][AVENUE]["entry_ns"] = leader_ns + 3 * 10**9 + TOLERANCE_NS + beyond_ns

    line = "platoon c1-p1 on avenue_east: entry times more than 3 s apart"
    assert (line in faults(demo, spoilt(plans, apart)).splitlines()) == (beyond_ns == 1)


def test_platoon_on_a_closed_segment_is_refused(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """No close gap where the gate is closed, whatever the plan says."""
    plain = [plan.model_dump() for plan in plans]
    found = faults(demo, plain, {"avenue_east"})
    assert "van-b on avenue_west: platoon where the gate is closed" in found
    assert "avenue_east: platoon" not in found


def test_platoon_members_too_far_apart_are_refused(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """Entry times further apart than the window are no platoon: 2 s are not within 1.5 s."""
    found = verify(demo, plans, sync_window_s=1.5)
    assert any("more than 1.5 s apart" in fault for fault in found)


def test_no_plans_at_all_are_refused(demo: RoutingProblem) -> None:
    """An empty plan set serves nobody."""
    assert "stop c2: served 0 times" in faults(demo, [])


def test_stops_that_are_said_to_be_left_out_may_be_left_out(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """An idle vehicle and its stops are no fault if they are named, and one if they are not."""
    left = tuple(stop.stop for stop in plans[1].stops[1:-1])

    def of_stops(found: tuple[str, ...]) -> list[str]:
        return [fault for fault in found if fault.startswith("stop ")]

    assert of_stops(verify(demo, plans[:1], unserved=left)) == []
    assert "stop c3: served 0 times" in of_stops(verify(demo, plans[:1]))
    assert "stop c1: served 1 times" in verify(demo, plans, unserved=("c1",))


@pytest.mark.parametrize(
    ("stop", "vehicle", "fault"),
    [
        ({"latest_s": 1.0}, {}, "van-a: comes to c1 after its window"),
        ({"earliest_s": 5000.0}, {}, "van-a: serves c1 before its window"),
        ({"demand": 9}, {"capacity": 8}, "van-a: carries 9, more than its capacity of 8"),
        ({}, {"return_by_s": 10.0}, "van-a: is back too late"),
        ({}, {"ready_s": 5.0}, "van-a: leaves outside its window"),
    ],
)
def test_windows_and_loads_are_kept(
    demo: RoutingProblem,
    plans: tuple[VehiclePlan, ...],
    stop: dict[str, float],
    vehicle: dict[str, float],
    fault: str,
) -> None:
    """Plans made for an easier fleet are refused by one with windows and capacities."""
    fleet = demo.fleet
    stricter = Fleet(
        depots=fleet.depots,
        stops=(fleet.stops[0].model_copy(update=stop), *fleet.stops[1:]),
        vehicles=(fleet.vehicles[0].model_copy(update=vehicle), *fleet.vehicles[1:]),
    )
    assert fault in verify(replace(demo, fleet=stricter), plans)


def test_a_stop_of_another_carrier_is_a_fault(
    demo: RoutingProblem, plans: tuple[VehiclePlan, ...]
) -> None:
    """Each stop that names a carrier is served by that carrier's vehicles."""
    fleet = demo.fleet
    of = {stop.stop: plan.vehicle for plan in plans for stop in plan.service_stops}

    def owned(owner: str) -> RoutingProblem:
        parts = {name: getattr(fleet, name) for name in Fleet.model_fields}
        vehicles = [v.model_copy(update={"carrier": v.id}) for v in fleet.vehicles]
        first = fleet.stops[0].model_copy(update={"carrier": owner})
        changed = {"vehicles": tuple(vehicles), "stops": (first, *fleet.stops[1:])}
        return replace(demo, fleet=Fleet(**parts | changed))

    right = of[fleet.stops[0].id]
    wrong = next(vehicle.id for vehicle in fleet.vehicles if vehicle.id != right)
    assert verify(owned(right), plans) == ()
    assert verify(owned(wrong), plans) == (
        f"{right}: serves {fleet.stops[0].id}, which is for carrier {wrong}",
    )
