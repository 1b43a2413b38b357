"""What a vehicle does now, by its plan and by what it reports."""

from __future__ import annotations

import pytest

from dashboard.view import progress
from slipstream.messages import PlannedStop, VehiclePosition

S = 1_000_000_000


@pytest.fixture
def plan(world, now_ns):
    """A round of two stops that begins and ends at the depot."""
    plan = world.plan("van-a", 1, now_ns)
    begin = PlannedStop(
        stop="depot", node="depot", arrival_ns=plan.depart_ns, departure_ns=plan.depart_ns
    )
    end_ns = plan.segments[-1].exit_ns
    end = begin.model_copy(update={"arrival_ns": end_ns, "departure_ns": end_ns})
    return plan.model_copy(update={"stops": (begin, *plan.stops, end)})


def _position(plan, part, share, late_s=0.0, **changes):
    """On a segment of the plan, so much later than planned."""
    segment = plan.segments[part]
    time_ns = segment.entry_ns + round(share * (segment.exit_ns - segment.entry_ns) + late_s * S)
    fields = {
        "vehicle": plan.vehicle,
        "time_ns": time_ns,
        "segment": segment.segment,
        "share": share,
        "speed_mps": 9.0,
        "on_road": True,
        "cycle": plan.cycle,
        "leg": segment.leg,
    }
    return VehiclePosition(**(fields | changes))


def test_a_round_by_plan(plan, now_ns):
    """Depot, road, stop, road back, depot, none of it heard; then the plan runs out."""
    first, last = plan.stops[1], plan.stops[-1]
    told = [
        progress.planned(plan, at_ns)
        for at_ns in (
            now_ns,
            plan.depart_ns + S,
            first.arrival_ns + S,
            last.arrival_ns - S,
            last.arrival_ns + S,
            plan.valid_until_ns + S,
        )
    ]
    assert [one.state for one in told] == [*["planned"] * 5, "expired"]
    assert [one.text.removeprefix("by plan: ") for one in told[:5]] == [
        *("waits to leave", f"drives to {first.stop}", f"at {first.stop}"),
        *("drives back", "is back"),
    ]
    assert [one.on_road for one in told] == [False, True, False, True, False, False]
    assert [one.stop for one in told] == [1, 1, 2, 3, None, None]
    assert not any(one.reported or one.delay_s for one in told)


def test_a_delay_is_told_in_steps_and_moves_the_arrival(plan):
    """To the nearest ten seconds; ahead of the plan is no earlier arrival."""
    for late_s, told_s in ((0.0, 0.0), (4.0, 0.0), (27.0, 30.0), (-27.0, -30.0)):
        position = _position(plan, 1, 0.5, late_s)
        done = progress.reported(plan, position, position.time_ns)
        assert done.delay_s == pytest.approx(told_s)
        assert done.part == 1
        moved_ns = (done.eta_ns(plan) or 0) - plan.stops[1].arrival_ns
        assert moved_ns == round(max(0.0, told_s) * S)


def test_a_vehicle_that_stands_on_its_road_has_stopped(plan):
    """It still is on its way."""
    position = _position(plan, 1, 0.5, speed_mps=0.1)
    done = progress.reported(plan, position, position.time_ns)
    assert (done.state, done.text) == ("stopped", f"stands, drives to {plan.stops[1].stop}")


def test_a_vehicle_that_leaves_a_stop_late(plan):
    """Its delay runs from the planned departure."""
    stop = plan.stops[1]
    position = _position(plan, 2, 0.0, on_road=False, leg=1, speed_mps=0.0)
    done = progress.reported(plan, position, stop.departure_ns + 41 * S)
    assert (done.state, done.text, done.delay_s) == ("waiting", f"at {stop.stop}", 40.0)
    assert done.stop == 2
