"""Breaks of vehicles: between stops, in their windows and whole, or no plan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from dispatcher_daemon.fleet import Break, Fleet, Vehicle, fleet_from
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, form_of, run_cycle
from dispatcher_daemon.planning.plans import Cycle, verify_plans
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.errors import InputError
from slipstream.messages import PlannedStop, VehiclePlan
from tests.dispatcher_daemon.fleet.tracking.fleet_drive import SETTINGS, SOLVE

S = 10**9
Town = tuple[RoutingProblem, TrafficSnapshot]


@pytest.fixture
def plan_for(town: Callable[..., Town]) -> Callable[..., tuple[Town, CycleResult]]:
    """The cycle of a van with three stops; its breaks and what else it has, and the stops'
    windows, are given.
    """

    def make(
        breaks: list[dict[str, float]], windows: dict[str, float] | None = None, **van: Any
    ) -> tuple[Town, CycleResult]:
        stops = [
            {"id": f"s{i}", "node": node, "service_s": 20.0, **(windows or {})}
            for i, node in enumerate(("11", "22", "33"))
        ]
        problem, snapshot = town(stops, [{"breaks": breaks, **van}])
        cycle = Cycle(problem, snapshot, SETTINGS, 1, snapshot.now_ns, 1)
        return (problem, snapshot), run_cycle(cycle, SOLVE)

    return make


def breaks_of(plan: VehiclePlan) -> list[PlannedStop]:
    """Its breaks."""
    return [stop for stop in plan.stops if stop.kind == "break"]


def seconds(plan: VehiclePlan, time_ns: int) -> float:
    """A time of a plan as the fleet counts it."""
    return (time_ns - plan.issued_ns) / S - SETTINGS.deadline_s


def test_a_break_is_taken_between_stops(plan_for: Callable[..., Any]) -> None:
    """In its window and whole, where the vehicle has served a stop; all is served as without."""
    _, without = plan_for([])
    (whole,) = without.plans
    _, result = plan_for([{"duration_s": 60.0, "earliest_s": 50.0, "latest_s": 150.0}])
    (plan,) = result.plans
    (pause,) = breaks_of(plan)
    at = plan.stops.index(pause)
    assert 0 < at < len(plan.stops) - 1
    assert plan.stops[at - 1].stop in {"s0", "s1", "s2"}
    assert pause.node == plan.stops[at - 1].node
    assert pause.break_s == 60.0
    assert 50.0 - 1e-6 <= seconds(plan, pause.departure_ns) - 60.0 <= 150.0 + 1e-6
    assert {s.stop for s in plan.service_stops} == {"s0", "s1", "s2"}
    longer_s = (plan.stops[-1].arrival_ns - whole.stops[-1].arrival_ns) / S
    assert longer_s == pytest.approx(60.0, abs=20.0)
    assert result.report.unserved == ()
    assert plan.valid_until_ns > plan.stops[-1].arrival_ns


def test_two_breaks_come_in_their_order(plan_for: Callable[..., Any]) -> None:
    """Each in its own window."""
    first = {"duration_s": 30.0, "earliest_s": 0.0, "latest_s": 120.0}
    second = {"duration_s": 45.0, "earliest_s": 200.0, "latest_s": 290.0}
    _, result = plan_for([first, second])
    (plan,) = result.plans
    assert [stop.break_s for stop in breaks_of(plan)] == [30.0, 45.0]
    # The first stop by the search's route is too far for the first break: another order is not.
    assert result.report.unserved == ()


def test_two_breaks_in_one_window_are_two(plan_for: Callable[..., Any]) -> None:
    """Equal ones too; a plan without either of them does not leave."""
    window = {"duration_s": 30.0, "earliest_s": 40.0, "latest_s": 250.0}
    (problem, _), result = plan_for([window, window])
    (plan,) = result.plans
    (van,) = problem.fleet.vehicles
    taken = breaks_of(plan)
    assert [stop.stop for stop in taken] == [van.break_id(0), van.break_id(1)]
    assert taken[0].departure_ns <= taken[1].arrival_ns
    assert result.report.unserved == ()
    roads, reference_s = problem.network, SETTINGS.deadline_s
    for missing in taken:
        stops = [s.model_copy(update={"break_s": 0.0}) if s == missing else s for s in plan.stops]
        spoilt = plan.model_copy(update={"stops": tuple(stops)})
        found = verify_plans((spoilt,), roads, problem.fleet, (), 4.0, reference_s=reference_s)
        assert any("no break of 30 s" in fault for fault in found)


@pytest.mark.parametrize(
    ("leaves_s", "back_s", "at_depot"),
    [
        (50.0, 500.0, set()),
        (70.0, 500.0, {0}),
        (130.0, 500.0, {0, 1}),
        (0.0, 80.0, {1}),
        (0.0, 30.0, {0, 1}),
        (70.0, 80.0, {0, 1}),
    ],
)
def test_the_depot_has_time_for_one_break_after_the_other(
    leaves_s: float, back_s: float, at_depot: set[int]
) -> None:
    """Two of a minute, both to begin within 100 s."""
    window = {"duration_s": 60.0, "earliest_s": 0.0, "latest_s": 100.0}
    van = Vehicle.model_validate({"id": "van", "breaks": [window, window]})
    assert van.breaks_at_depot(leaves_s, back_s) == at_depot


def test_a_tour_with_one_stop_has_room_for_two_breaks(town: Callable[..., Town]) -> None:
    """One after the other, at the only place where it stands."""
    window = {"duration_s": 30.0, "earliest_s": 0.0, "latest_s": 210.0}
    stops = [{"id": "s0", "node": "22", "service_s": 20.0}]
    problem, snapshot = town(stops, [{"breaks": [window, window]}])
    result = run_cycle(Cycle(problem, snapshot, SETTINGS, 1, snapshot.now_ns, 1), SOLVE)
    (plan,) = result.plans
    assert [stop.kind for stop in plan.stops[1:-1]] == ["stop", "break", "break"]


@pytest.mark.parametrize(
    ("pause", "van"),
    [
        ({"duration_s": 60.0, "earliest_s": 0.0, "latest_s": 9000.0}, {}),
        ({"duration_s": 60.0, "earliest_s": -500.0, "latest_s": -100.0}, {}),
        ({"duration_s": 60.0, "earliest_s": 0.0, "latest_s": 100.0}, {"ready_s": 200.0}),
    ],
    ids=["when it is back", "over", "before it leaves"],
)
def test_a_break_at_the_depot_is_not_planned(
    plan_for: Callable[..., Any], pause: dict[str, float], van: dict[str, float]
) -> None:
    """A tour that leaves it time there has none."""
    _, result = plan_for([pause], **van)
    (plan,) = result.plans
    assert breaks_of(plan) == []


def test_stops_that_leave_no_room_for_a_break_are_not_served(
    plan_for: Callable[..., Any],
) -> None:
    """The windows of stops and the break's cannot both be kept: the break is."""
    pause = {"duration_s": 600.0, "earliest_s": 30.0, "latest_s": 120.0}
    _, alone = plan_for([], {"latest_s": 270.0})
    assert alone.report.unserved == ()
    _, result = plan_for([pause], {"latest_s": 270.0})
    assert result.report.status == "ok"
    assert result.report.unserved != ()
    for plan in result.plans:
        assert breaks_of(plan) or seconds(plan, plan.stops[-1].arrival_ns) <= 120.0


def test_a_plan_that_breaks_a_break_does_not_leave(plan_for: Callable[..., Any]) -> None:
    """One that is missing, cut short, moved out of its window, or made up is found."""
    window = {"duration_s": 60.0, "earliest_s": 50.0, "latest_s": 150.0}
    (problem, snapshot), result = plan_for([window])
    (plan,) = result.plans
    (pause,) = breaks_of(plan)

    def faults(changed: VehiclePlan, fleet: Fleet = problem.fleet) -> tuple[str, ...]:
        roads, reference_s = problem.network, SETTINGS.deadline_s
        open_ = {name for name, of in snapshot.segments.items() if of.open}
        return verify_plans((changed,), roads, fleet, open_, 4.0, reference_s=reference_s)

    def with_pause(**changes: object) -> VehiclePlan:
        stops = [s if s != pause else s.model_copy(update=changes) for s in plan.stops]
        return plan.model_copy(update={"stops": tuple(stops)})

    def with_window(**changes: float) -> Fleet:
        (vehicle,) = problem.fleet.vehicles
        breaks = (Break(**{**window, **changes}),)
        parts = {"vehicles": (vehicle.model_copy(update={"breaks": breaks}),)}
        return Fleet(**problem.fleet.parts | parts)

    assert faults(plan) == ()
    assert any("no break of 60 s" in f for f in faults(with_pause(break_s=0.0)))
    assert any("no break of 60 s" in f for f in faults(with_pause(break_s=50.0)))
    short = with_pause(departure_ns=pause.arrival_ns + 59 * S)
    assert any("no break of 60 s" in f for f in faults(short))
    begins_s = seconds(plan, pause.departure_ns) - 60.0
    late = with_window(earliest_s=0.0, latest_s=begins_s - 5.0)
    assert any("no break of 60 s" in f for f in faults(plan, late))
    assert any("does not have" in f for f in faults(plan, with_window(duration_s=30.0)))
    elsewhere = with_pause(node=plan.stops[0].node)
    assert any("at node" in f for f in faults(elsewhere))


def test_the_arc_form_refuses_breaks(town: Callable[..., Town]) -> None:
    """By name; `auto` takes the route form."""
    stops = [{"id": "s0", "node": "11"}]
    problem, _ = town(stops, [{"breaks": [{"duration_s": 60.0}]}])
    assert form_of(DispatcherSettings(), problem.fleet) == "route"
    with pytest.raises(InputError, match="has breaks"):
        form_of(DispatcherSettings(form="arc"), problem.fleet)


def test_breaks_in_a_fleet_file(town: Callable[..., Town]) -> None:
    """In seconds or by the clock; faults name the row."""
    problem, _ = town([{"id": "s0", "node": "11"}], [{}])
    data = problem.fleet.model_dump(mode="json", exclude_none=True)
    pause = {"duration_s": 1800, "earliest": "11:30", "latest": "13:00"}
    data["vehicles"][0]["breaks"] = [pause]
    day_ns = 1_790_000_000 * S // (86_400 * S) * 86_400 * S

    def read() -> Fleet:
        return fleet_from(data, problem.network, "f.toml", may_have_clock_times=True)

    ten = read().at(day_ns + 10 * 3600 * S)
    (own,) = ten.vehicles[0].breaks
    assert (own.earliest_s, own.latest_s) == (5400.0, 10800.0)
    at_noon = read().at(day_ns + 12 * 3600 * S).vehicles[0].breaks[0]
    assert (at_noon.earliest_s, at_noon.latest_s) == (-1800.0, 3600.0)
    for changes, key in (
        ({"earliest_s": 7.0}, "breaks.0.earliest"),
        ({"duration_s": 0}, "breaks"),
        ({"latest_s": 5.0, "earliest_s": 6.0, "earliest": None, "latest": None}, "breaks"),
    ):
        data["vehicles"][0]["breaks"] = [
            {k: v for k, v in {**pause, **changes}.items() if v is not None}
        ]
        with pytest.raises(InputError, match=key):
            read()
    data["vehicles"][0]["breaks"] = [pause, {**pause, "latest": "11:50"}]
    with pytest.raises(InputError, match=r"breaks\.1: it cannot begin in its window") as refused:
        read()
    assert "list it before that one" in refused.value.mend
    data["vehicles"][0]["breaks"].reverse()
    assert len(read().vehicles[0].breaks) == 2
