from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from dispatcher_daemon.cycle import run_cycle
from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.plans.candidates import Cycle
from dispatcher_daemon.plans.verify import verify_plans
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.pool import solve_here
from dispatcher_daemon.traffic import TrafficSnapshot
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
    solve = solve_here([ExactSolver()])
    return run_cycle(Cycle(demo, snapshot, settings, 1, now_ns, 1), solve).plans


def verify(
    demo: RoutingProblem,
    plans: Sequence[VehiclePlan],
    open_segments: set[str] = OPEN,
    sync_window_s: float = 3.0,
    unserved: tuple[str, ...] = (),
) -> tuple[str, ...]:
    """Faults of plans of a cycle that was given its time to solve."""
    deadline_s = DispatcherSettings().deadline_s
    return verify_plans(
        plans,
        demo.network,
        demo.fleet,
        open_segments,
        sync_window_s,
        unserved=unserved,
        reference_s=deadline_s,
    )


def faults(demo: RoutingProblem, plans: Plain, open_segments: set[str] = OPEN) -> str:
    """All faults as one text."""
    rebuilt = [VehiclePlan.model_validate(plan) for plan in plans]
    return "\n".join(verify(demo, rebuilt, open_segments))


def test_sound_plans_pass(demo: RoutingProblem, plans: tuple[VehiclePlan, ...]) -> None:
    """The dispatcher's own plans have no fault."""
    assert verify(demo, plans) == ()


def _missing(p: Plain) -> None:
    del p[1]


def _twice(p: Plain) -> None:
    p.append(p[0])


def _stranger(p: Plain) -> None:
    p[0]["vehicle"] = "van-x"


def _other_cycle(p: Plain) -> None:
    p[0]["cycle"] = 2


def _stays_out(p: Plain) -> None:
    p[0]["stops"] = p[0]["stops"][:-1]


def _wrong_node(p: Plain) -> None:
    p[0]["stops"][1]["node"] = "west"


def _not_first(p: Plain) -> None:
    p[0]["stops"][1], p[0]["stops"][2] = p[0]["stops"][2], p[0]["stops"][1]


def _jump(p: Plain) -> None:
    del p[0]["segments"][1]


def _bad_turn(p: Plain) -> None:
    p[0]["segments"][1]["segment"] = "mill_street_east"


def _unknown_segment(p: Plain) -> None:
    p[0]["segments"][1]["segment"] = "moon_street"


def _wrong_leg(p: Plain) -> None:
    p[0]["segments"][0]["leg"] = 1


def _early(p: Plain) -> None:
    p[0]["depart_ns"] = p[0]["issued_ns"] - 1


def _hasty(p: Plain) -> None:
    p[0]["stops"][1]["departure_ns"] = p[0]["stops"][1]["arrival_ns"]


def _hole(p: Plain) -> None:
    p[0]["segments"][1]["entry_ns"] += 5_000_000


def _speeding(p: Plain) -> None:
    p[0]["segments"][0]["speed_mps"] = 30.0


def _too_fast(p: Plain) -> None:
    p[0]["segments"][0]["exit_ns"] = p[0]["segments"][0]["entry_ns"] + 10**9


def _short(p: Plain) -> None:
    p[0]["distance_m"] -= 100.0


def _expired(p: Plain) -> None:
    p[0]["valid_until_ns"] = p[0]["issued_ns"]


def _avenue(plan: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = next(s for s in plan["segments"] if s["segment"] == "avenue_east")
    return found


def _gap_for_leader(p: Plain) -> None:
    _avenue(p[0])["gap_m"] = 1.5


def _no_gap(p: Plain) -> None:
    _avenue(p[1])["gap_m"] = None


def _alone(p: Plain) -> None:
    _avenue(p[1])["platoon"] = _avenue(p[1])["place"] = _avenue(p[1])["gap_m"] = None


def _half(p: Plain) -> None:
    _avenue(p[1])["platoon"] = None


def _two_leaders(p: Plain) -> None:
    _avenue(p[1]).update(place=0, gap_m=None)


def _swapped(p: Plain) -> None:
    _avenue(p[0]).update(place=1, gap_m=1.5)
    _avenue(p[1]).update(place=0, gap_m=None)


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (_missing, "stop c3: served 0 times"),
        (_twice, "van-a: has more than one plan"),
        (_stranger, "van-x: not in the fleet"),
        (_other_cycle, "different cycles"),
        (_stays_out, "does not end at its depot"),
        (_wrong_node, "no stop c1 at node west"),
        (_not_first, "does not serve c1 first"),
        (_jump, "no turn from depot_road_east into avenue_east"),
        (_bad_turn, "no turn from mill_street_east into avenue_east"),
        (_unknown_segment, "unknown segments"),
        (_wrong_leg, "legs are not one after another"),
        (_early, "leaves before its plan is issued"),
        (_hasty, "leaves c1 before it is served"),
        (_hole, "the times of leg 0 do not join up"),
        (_speeding, "faster than allowed on depot_road_east"),
        (_too_fast, "faster than allowed on depot_road_east"),
        (_short, "distance is"),
        (_expired, "is valid until before it is issued"),
        (_gap_for_leader, "a gap is for followers"),
        (_no_gap, "a gap is for followers"),
        (_alone, "fewer than two vehicles"),
        (_half, "a place or gap without a platoon"),
        (_two_leaders, "places are not 0, 1, 2"),
        (_swapped, "places are not in the order of entry"),
    ],
)
def test_every_broken_rule_is_found(
    demo: RoutingProblem,
    plans: tuple[VehiclePlan, ...],
    spoil: Callable[[Plain], None],
    fault: str,
) -> None:
    """A plan set that breaks one rule is refused for it."""
    plain = [plan.model_dump() for plan in plans]
    for plan in plain:
        plan["stops"], plan["segments"] = list(plan["stops"]), list(plan["segments"])
    spoil(plain)
    for plan in plain:
        plan["stops"], plan["segments"] = tuple(plan["stops"]), tuple(plan["segments"])
    assert fault in faults(demo, plain)


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
