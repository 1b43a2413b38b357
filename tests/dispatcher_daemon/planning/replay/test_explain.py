"""A cycle in words."""

from __future__ import annotations

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.replay import InputEncoder, Trace
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic.snapshot import take_snapshot
from slipstream.explain import (
    Explanation,
    RefusalReason,
    RefusedPlatoon,
    VehicleAccount,
    as_text,
    refusal_line,
)
from slipstream.explain import explanation as explanation_of
from slipstream.explain.vehicles import explained_vehicles
from slipstream.messages import (
    CycleReport,
    PlannedSegment,
    PlannedStop,
    SolverReport,
    Unserved,
    VehiclePlan,
)
from slipstream.orders import utc
from storage import StoredCycle

START_NS = 1_790_000_000_000_000_000


def plan(vehicle: str, place: int) -> VehiclePlan:
    """Two segments in one platoon, then one alone."""
    segments = [
        PlannedSegment(
            segment=name,
            entry_ns=START_NS + at,
            exit_ns=START_NS + at + 1,
            speed_mps=10.0,
            platoon=None if at == 2 else "c7-p1",
            place=None if at == 2 else place,
            gap_m=8.0 if place and at < 2 else None,
            leg=0,
            length_m=100.0,
        )
        for at, name in enumerate(("north", "east", "south"))
    ]
    stops = [
        PlannedStop(stop=name, node="n", arrival_ns=START_NS, departure_ns=START_NS)
        for name in ("depot", "c1", "depot")
    ]
    return VehiclePlan(
        vehicle=vehicle,
        cycle=7,
        issued_ns=START_NS,
        valid_until_ns=START_NS + 9,
        depart_ns=START_NS,
        stops=tuple(stops),
        segments=tuple(segments),
        distance_m=300.0,
        energy_kwh=0.5,
    )


REPORT = CycleReport(
    cycle=7,
    started_ns=START_NS,
    wall_s=1.0,
    status="ok",
    reason=None,
    solver="exact",
    objective_kwh=1.5,
    variables=9,
    solvers=(
        SolverReport(
            solver="exact", status="optimal", objective_kwh=1.5, repaired=False, wall_s=0.25
        ),
        SolverReport(
            solver="tabu",
            status="timeout",
            objective_kwh=None,
            repaired=False,
            wall_s=5.0,
            reason="no answer within 5 s; worker replaced",
        ),
    ),
    gates=(),
    energy=None,
    plans=2,
    unserved=(Unserved(stop="c9", reason="no vehicle has room and time for it"),),
)
ACCOUNTS = (
    VehicleAccount("van-a", ("c1",), 0.5, 0.52, 100.0, 12.0, 200.0, ("c1", "c2"), 0.6, 130.0),
    VehicleAccount("van-b", ("c2",), 0.4, 0.4, 90.0, 0.0, 0.0, (), 0.0, 0.0),
    VehicleAccount("van-c", (), 0.0, 0.0, 0.0, 0.0, 0.0, ("c3",), 0.2, 60.0),
    VehicleAccount("van-d", ("c3",), 0.2, 0.2, 60.0, 0.0, 0.0, ("c3",), 0.2, 60.0),
)
REFUSED = RefusedPlatoon(("van-a", "van-d"), ("west",), "turbulent", "turbulent", 0.03, 0.5)


def stored(demo: RoutingProblem, made: tuple[str, ...] = ("van-a", "van-b")) -> StoredCycle:
    """Cycle 7 of the plans, accounts and refused platoons above."""
    plans = plan("van-a", 0), plan("van-b", 1)
    snapshot = take_snapshot(demo.network, (), START_NS, stale_after_s=5.0)
    settings = DispatcherSettings(solvers=("exact",))
    result = CycleResult(REPORT, plans, accounts=ACCOUNTS, refused=(REFUSED,))
    cycle = Cycle(demo, snapshot, settings, 7, START_NS, 1)
    return StoredCycle(REPORT, plans, InputEncoder().encode(cycle, Trace(), result))


def explanation(of: StoredCycle) -> Explanation:
    """The words of a stored cycle."""
    return explanation_of(of.report, of.plans, None if of.inputs is None else of.inputs.record)


def test_a_cycle_s_words_say_why_each_vehicle_goes_where_it_goes(demo: RoutingProblem) -> None:
    """Stops given and taken, energy against alone and the baseline, platoons, solvers, stops that
    nobody serves; one without a new plan, and one that stays.
    """
    found = explanation(stored(demo))
    lines = {one.vehicle: "\n".join(one.lines) for one in found.vehicles}
    assert list(lines) == ["van-a", "van-b", "van-c", "van-d"]
    assert lines["van-a"] == (
        "serves c1\n"
        "less than in the baseline: c2 (to van-b)\n"
        "needs 0.5000 kWh, alone on the same way 0.5200 kWh: platoons save 0.0200 kWh over 200 m\n"
        "that is 0.1000 kWh less than in the baseline; it drives for 1 min 40 s, there for "
        "2 min 10 s\n"
        "it waits 12.0 s longer than in the baseline, to meet others\n"
        "leads van-b in platoon c7-p1 on north, east, 200 m"
    )
    assert "more than in the baseline: c2 (from van-a)" in lines["van-b"]
    assert "in the baseline it stays where it is" in lines["van-b"]
    assert "is at place 2 with van-a in platoon c7-p1" in lines["van-b"]
    assert (
        "stays where it is; in the baseline it serves what others do now: c3 (van-d)"
        in (lines["van-c"])
    )
    assert "so none was sent" in lines["van-d"]
    assert found.solvers == (
        "exact (taken): optimal, objective 1.5000 kWh, 0.25 s",
        "tabu: timeout, 5.00 s, no answer within 5 s; worker replaced",
    )
    assert found.unserved == ("c9: no vehicle has room and time for it",)
    text = as_text(found)
    for line in (*found.solvers, *lines["van-a"].splitlines(), *found.unserved):
        assert f"\n  {line}" in text


def test_one_vehicle_s_words_have_its_refused_platoons_only(demo: RoutingProblem) -> None:
    """A vehicle that the cycle does not have has no words."""
    found = explanation(stored(demo))
    assert found.of_vehicle("van-z") is None
    for vehicle, number in (("van-d", 1), ("van-b", 0)):
        own = found.of_vehicle(vehicle)
        assert own is not None
        assert [one.vehicle for one in own.vehicles] == [vehicle]
        assert len(own.refused) == number


def test_a_cycle_without_inputs_is_told_as_far_as_it_is_stored(demo: RoutingProblem) -> None:
    """Its plans and solvers; and that the rest is not known."""
    found = explanation(StoredCycle(REPORT, stored(demo).plans, None))
    assert [one.account for one in found.vehicles] == [None, None]
    assert "serves c1" in found.vehicles[0].lines[0]
    assert len(found.notes) == 1
    assert "not stored" in as_text(found)


@pytest.mark.parametrize(
    ("reason", "detail", "cost_kwh", "words"),
    [
        ("turbulent", "turbulent", None, "traffic there was turbulent; 0.0300 kWh if it had been"),
        ("unknown", "too_few_vehicles", None, "was not known (too few vehicles); 0.0300 kWh"),
        ("apart", None, None, "not together in time, 12.5 s apart"),
        ("apart", "they are due to leave it 5 s apart", None, "but they are due to leave it 5 s"),
        ("not_worth", None, 0.2, "not worth it, 12.5 s apart: to meet would cost 0.2000 kWh and"),
        ("missed", None, 0.01, "missed, 12.5 s apart: to meet would cost 0.0100 kWh and save"),
    ],
)
def test_each_reason_of_a_refusal_has_its_words(
    reason: RefusalReason, detail: str | None, cost_kwh: float | None, words: str
) -> None:
    """Who, where, why, and what it is about."""
    segments = ("north", "east", "south", "west")
    line = refusal_line(
        RefusedPlatoon(("van-a", "van-b"), segments, reason, detail, 0.03, 12.5, cost_kwh)
    )
    assert line.startswith("van-a and van-b on north … west (4 segments): ")
    assert words in line


def test_a_break_is_told_with_its_place_and_time() -> None:
    """It is no stop that the vehicle serves."""
    own = plan("van-a", 0)
    at, begins_ns = own.stops[1], own.stops[1].departure_ns
    told = {"stop": "van-a break 1", "is_hub": True, "break_s": 1800.0, "arrival_ns": begins_ns}
    pause = at.model_copy(update={**told, "departure_ns": begins_ns + 1800 * 10**9})
    rested = own.model_copy(update={"stops": (*own.stops[:2], pause, *own.stops[2:])})
    (found,) = explained_vehicles((rested,), None)
    assert found.lines[0].startswith(f"serves {at.stop}, ")
    assert f"has its break of 30 min 0 s at {at.stop}, from {utc(begins_ns)} on" in found.lines
