"""Plans of vehicles on their way: what they are bound to is verified on the messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.commitments import Commitment
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.plans import RouteEnergy, plans_to_send, summarise, verify_plans
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.consumption import Energy, total
from slipstream.messages import VehiclePlan, decode
from slipstream.roads import RoadNetwork
from tests.dispatcher_daemon.fleet.tracking.fleet_drive import SETTINGS, Day, S, Van

Bound = tuple[RoadNetwork, Fleet, tuple[Commitment, ...], tuple[VehiclePlan, ...]]


@pytest.fixture(scope="module")
def bound(town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]]) -> Bound:
    """A cycle with one van on its way, with three stops left, and its new plan."""
    problem, snapshot = town(["22", "33", "30"], [{}])
    day = Day(problem, snapshot, {"van-0": Van("van-0", "00-01")}, problem.fleet)
    day.drive(1)
    day.run(1)
    day.vans["van-0"].late_s = 5.0
    day.drive(1)
    plans = day.cycle()
    assert day.situation is not None
    assert day.situation.fleet is not None
    assert len(plans) == 1
    return problem.network, day.situation.fleet, day.situation.commitments, plans


def faults(bound: Bound, **changes: Any) -> str:
    """All faults of the plan with changed fields."""
    network, fleet, commitments, (plan,) = bound
    return verify(network, fleet, commitments, [plan.model_copy(update=changes)])


def verify(
    network: RoadNetwork,
    fleet: Fleet,
    commitments: Sequence[Commitment],
    plans: Sequence[VehiclePlan],
) -> str:
    """All faults as one text."""
    found = verify_plans(
        plans, network, fleet, set(network.segments), 3.0, reference_s=10.0, commitments=commitments
    )
    return "\n".join(found)


def test_a_plan_from_where_the_van_is_passes(bound: Bound) -> None:
    """It begins before it is issued, on the segment that the van is on."""
    network, _, (own,), (plan,) = bound
    assert faults(bound) == ""
    assert plan.continues == own.plan.cycle
    assert own.moving is not None
    assert plan.segments[0].segment == own.legs[0].path[0]
    assert plan.depart_ns < plan.issued_ns
    assert network.segments[plan.segments[0].segment].start != own.node or own.place == "depot-0"


def test_each_broken_rule_is_named(bound: Bound) -> None:
    """A plan from the depot, another order of stops, another way, a lost parcel."""
    network, fleet, (own,), (plan,) = bound
    assert "continues the plan of cycle None" in faults(bound, continues=None)
    assert "is bound and has no plan" in verify(network, fleet, (own,), [])
    stops = plan.stops
    assert "left last" in faults(bound, stops=(stops[1], *stops[1:]))
    assert "or not in the order" in faults(bound, stops=(stops[0], stops[2], stops[1], *stops[3:]))
    assert "served 0 times" in faults(bound, stops=(*stops[:2], *stops[3:]))
    assert "leaves the fixed way" in faults(bound, segments=plan.segments[1:])
    assert "end at its depot" in faults(bound, stops=(*stops[:-1], stops[1]))
    standing = replace(own, moving=None)
    early = verify(network, fleet, (standing,), [plan])
    assert "leaves before its plan is issued" in early
    free = verify(network, fleet, (), [plan])
    assert "does not start at its depot" in free or "continues the plan" in free


def test_a_late_van_is_no_fault(bound: Bound) -> None:
    """What is loaded is delivered, in its window or not; a free van's plan would be refused."""
    network, fleet, commitments, plans = bound
    closed = tuple(stop.model_copy(update={"latest_s": 0.0}) for stop in fleet.stops)
    late = Fleet(depots=fleet.depots, stops=closed, vehicles=fleet.vehicles)
    assert verify(network, late, commitments, plans) == ""
    assert "after its window" in verify(network, late, (), plans)


def test_a_van_at_speed_before_its_stop_gives_energy_back(bound: Bound) -> None:
    """The rest of its way needs less than braking returns: a plan and a summary as any other."""
    plan = bound[3][0].model_copy(update={"energy_kwh": -0.016})
    assert decode(VehiclePlan, plan.model_dump_json().encode(), "plan") == plan
    physics = total([Energy(-0.016, 0.001, 0.002, -0.019)])
    rest = RouteEnergy(physics, physics, 0.0, 4.0, (), ())
    summary = summarise("alone", [rest], [rest], 2.0)
    assert (summary.baseline_kwh, summary.saved_kwh) == (pytest.approx(-0.016), 0.0)


def send(bound: Bound, own: Commitment) -> tuple[VehiclePlan, ...]:
    """What goes out to a van with this commitment."""
    plans = bound[3]
    return plans_to_send(plans, [own], SETTINGS.sync_window_s, SETTINGS.interval_s)


def test_a_plan_goes_out_where_something_changed(bound: Bound) -> None:
    """Not for a second; for times beyond the window, a lost plan, one about to lapse."""
    (own,), (plan,) = bound[2], bound[3]
    long = plan.model_copy(update={"valid_until_ns": plan.issued_ns + 600 * S})
    assert send(bound, replace(own, plan=long)) == ()
    assert send(bound, replace(own, plan=long, lost=True)) == (plan,)
    short = plan.model_copy(update={"valid_until_ns": plan.issued_ns + 40 * S})
    assert send(bound, replace(own, plan=short)) == (plan,)

    def moved(seconds: float) -> VehiclePlan:
        last = plan.stops[-1].model_copy(
            update={"arrival_ns": plan.stops[-1].arrival_ns + round(seconds * S)}
        )
        return long.model_copy(update={"stops": (*plan.stops[:-1], last)})

    assert send(bound, replace(own, plan=moved(2.0))) == ()
    assert send(bound, replace(own, plan=moved(4.0))) == (plan,)
    part = long.segments[-1].model_copy(update={"platoon": "c1-p1", "place": 0})
    platoon = long.model_copy(update={"segments": (*long.segments[:-1], part)})
    assert send(bound, replace(own, plan=platoon)) == (plan,)
