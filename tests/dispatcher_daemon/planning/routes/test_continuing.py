"""Waits of vehicles that are bound to a plan: kept, changed, and no longer than allowed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from dispatcher_daemon.fleet.commitments import Commitment, CommittedLeg
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.routes import Route, StopVisit
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.continuing import planned_waits_s
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.planning.routes.windows import MAX_WAIT_S
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.messages import PlannedStop, VehiclePlan

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
S = 10**9
REFERENCE_S = 10.0


def plan(now_ns: int, stops: Sequence[PlannedStop] = ()) -> VehiclePlan:
    """The plan that a van follows."""
    return VehiclePlan(
        vehicle="van-0",
        cycle=1,
        issued_ns=now_ns,
        valid_until_ns=now_ns + 600 * S,
        depart_ns=now_ns,
        stops=tuple(stops),
        segments=(),
        distance_m=0.0,
        energy_kwh=0.0,
    )


def standing(
    made: tuple[RoutingProblem, TrafficSnapshot],
    *,
    ends_s: float,
    departs_s: float,
    fixed: bool,
) -> Planner:
    """The planner of a van that stands at a stop that it has served at the depot's junction."""
    problem, snapshot = made
    travel = Travel(problem, roads_of(problem, snapshot))
    free = Planner(problem, snapshot, [travel], 3.0, REFERENCE_S)
    stops = tuple(stop.id for stop in problem.fleet.stops)
    legs = free.legs(0, stops)
    assert legs is not None
    own = Commitment(
        vehicle="van-0",
        plan=plan(snapshot.now_ns),
        place="served",
        node="00",
        arrived_ns=snapshot.now_ns - 400 * S,
        ends_ns=snapshot.now_ns + round(ends_s * S),
        departs_ns=snapshot.now_ns + round(departs_s * S),
        moving=None,
        legs=(CommittedLeg(legs[0].path[:1] if fixed else (), False),),
        stops=stops,
    )
    return Planner(problem, snapshot, [travel], 3.0, REFERENCE_S, commitments=[own])


def test_a_wait_goes_on_in_a_plan_that_is_out_before_it_ends(town: Town) -> None:
    """It leaves in 8 s and has its new plan before: without the wait it would leave at once."""
    planner = standing(town(["33"], [{}]), ends_s=-300.0, departs_s=8.0, fixed=True)
    assert planner.windows.of(0) == (8.0, 8.0)
    itinerary = planner.itinerary(0, ("s0",), planner.legs(0, ("s0",)))
    assert itinerary is not None
    assert itinerary.route is not None
    here = itinerary.route.visits[0]
    assert (here.arrival_s, here.departure_s, here.wait_s) == (0.0, 8.0, 8.0)


@pytest.mark.parametrize(
    ("ends_s", "last_s"), [(-300.0, MAX_WAIT_S - 300.0), (-700.0, 60.0), (30.0, MAX_WAIT_S + 30.0)]
)
def test_who_stands_may_stay_until_ten_minutes_after_service(
    town: Town, ends_s: float, last_s: float
) -> None:
    """And as long as planned; it leaves no sooner than its new plan is out, or service ends."""
    planner = standing(town(["33"], [{}]), ends_s=ends_s, departs_s=60.0, fixed=False)
    assert planner.windows.of(0) == pytest.approx((max(REFERENCE_S, ends_s), last_s))
    at_once = planner.itinerary(0, ("s0",), planner.legs(0, ("s0",)))
    assert at_once is not None
    assert at_once.depart_s == pytest.approx(max(REFERENCE_S, ends_s))


def test_a_wait_makes_no_other_stop_late_though_one_is(town: Town) -> None:
    """One stop is late whatever the van does; that is no leave for the other."""
    stops: list[dict[str, Any]] = [
        {"id": "s0", "node": "30", "service_s": 20.0, "latest_s": 1.0},
        {"id": "s1", "node": "33", "service_s": 20.0},
    ]
    planner = standing(town(stops, [{}]), ends_s=0.0, departs_s=20.0, fixed=False)
    legs = planner.legs(0, ("s0", "s1"))
    assert legs is not None
    at_once = planner.itinerary(0, ("s0", "s1"), legs)
    assert at_once is not None
    assert at_once.route is not None
    arrives_s = at_once.route.visits[2].arrival_s
    stops[1]["latest_s"] = arrives_s - REFERENCE_S + 5.0
    planner = standing(town(stops, [{}]), ends_s=0.0, departs_s=20.0, fixed=False)
    legs = planner.legs(0, ("s0", "s1"))
    assert planner.itinerary(0, ("s0", "s1"), legs, None, (4.0, 0.0)) is not None
    assert planner.itinerary(0, ("s0", "s1"), legs, None, (70.0, 0.0)) is None
    assert planner.itinerary(0, ("s0", "s1"), legs, 90.0) is None


def test_a_window_takes_up_what_was_waited_before_it(town: Town) -> None:
    """The second wait is kept whole: what the first one cost was waited for the window anyway."""
    stops = [
        {"id": "s0", "node": "30", "service_s": 20.0},
        {"id": "s1", "node": "33", "service_s": 20.0, "earliest_s": 390.0},
    ]
    problem, snapshot = town(stops, [{}])
    visits = (
        StopVisit("served", 0.0, 0.0),
        StopVisit("s0", 100.0, 120.0),
        StopVisit("s1", 200.0, 420.0),
        StopVisit("depot-0", 500.0, 500.0),
    )
    planned = [
        PlannedStop(
            stop=name,
            node="30",
            arrival_ns=snapshot.now_ns + arrival * S,
            departure_ns=snapshot.now_ns + departure * S,
            wait_s=wait_s,
        )
        for name, arrival, departure, wait_s in (("s0", 100, 420, 300.0), ("s1", 500, 640, 120.0))
    ]
    own = Commitment(
        vehicle="van-0",
        plan=plan(snapshot.now_ns, planned),
        place="served",
        node="00",
        arrived_ns=snapshot.now_ns,
        ends_ns=snapshot.now_ns,
        departs_ns=snapshot.now_ns,
        moving=None,
        legs=(CommittedLeg((), False),),
        stops=("s0", "s1"),
    )

    def waits_s(late_s: float) -> tuple[float, ...]:
        moved = tuple(
            StopVisit(v.place, v.arrival_s + late_s, v.departure_s + (late_s if n < 2 else 0.0))
            for n, v in enumerate(visits)
        )
        route = Route("van-0", moved, ())
        return planned_waits_s(problem, own, route, snapshot.now_ns, REFERENCE_S)

    assert waits_s(0.0) == pytest.approx((300.0, 120.0))
    assert waits_s(50.0) == pytest.approx((250.0, 120.0))
