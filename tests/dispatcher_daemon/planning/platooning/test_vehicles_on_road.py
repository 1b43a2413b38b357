from __future__ import annotations

from dataclasses import replace

import pytest

from dispatcher_daemon.fleet import Fleet, RoadUser, on_road
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from slipstream.messages import VehiclePlan
from slipstream_lab.research.cities.generator import CityShape, generate_city
from slipstream_lab.research.instances.instance import Instance

SETTINGS = DispatcherSettings(
    form="route",
    solvers=("exact",),
    city=CitySettings(
        search=SearchSettings(rounds=1, iterations_per_stop=5, workers=1),
        second_rounds=0,
        max_sweeps=1,
    ),
)
LATER_NS = 10_000_000_000


def part(city: Instance, number: int) -> Instance:
    """A city with one half of its vehicles and stops."""
    fleet = city.problem.fleet
    half = Fleet(
        name=f"half-{number}",
        depots=fleet.depots,
        stops=fleet.stops[number::2],
        vehicles=fleet.vehicles[number::2],
    )
    return replace(city, problem=replace(city.problem, fleet=half))


def cycle(city: Instance, now_ns: int, users: tuple[RoadUser, ...] = ()) -> CycleResult:
    """One cycle."""
    snapshot = replace(city.snapshot, now_ns=now_ns)
    solve = solve_in_process([ExactSolver()])
    this = Cycle(
        city.problem, snapshot, SETTINGS, 2, now_ns, 1, reference_delay_s=0.0, on_road=users
    )
    result = run_cycle(this, solve)
    assert result.report.status != "failed", result.report
    return result


@pytest.fixture(scope="module")
def city() -> Instance:
    """Four vehicles at one depot, arterials open."""
    shape = CityShape(depots=1, open_share=1.0, ready_within_s=60.0)
    city = generate_city(8, vehicles=4, stops=16, segments=120, shape=shape)
    return city.under("paper")


@pytest.fixture(scope="module")
def sent(city: Instance) -> tuple[VehiclePlan, ...]:
    """Half of the fleet, sent a moment ago."""
    return cycle(part(city, 0), 0).plans


@pytest.mark.slow
def test_those_on_the_road_are_met(city: Instance, sent: tuple[VehiclePlan, ...]) -> None:
    """Told who is on the road, a cycle forms platoons with them and counts what these save; places
    in them are 0, 1, 2 ... over both.
    """
    other = part(city, 1)
    users = on_road(sent, LATER_NS)
    assert users
    alone, met = cycle(other, LATER_NS), cycle(other, LATER_NS, users)
    assert alone.joined == {}
    assert met.joined
    assert met.report.objective_kwh is not None
    assert alone.report.objective_kwh is not None
    assert met.report.objective_kwh < alone.report.objective_kwh - 1e-6
    by_name = {plan.vehicle: plan for plan in sent}
    groups: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for plan in met.plans:
        for s in plan.segments:
            if s.platoon is not None:
                groups.setdefault((s.segment, s.platoon), []).append((s.place or 0, s.entry_ns))
    for (vehicle, leg, position), place in met.joined.items():
        own = [s for s in by_name[vehicle].segments if s.leg == leg][position]
        assert other.snapshot.segments[own.segment].open
        groups[own.segment, place.platoon].append((place.number, own.entry_ns))
    for members in groups.values():
        ordered = sorted(members)
        assert [place for place, _ in ordered] == list(range(len(ordered)))
        entries = [entry for _, entry in ordered]
        assert entries == sorted(entries)
        assert entries[-1] - entries[0] <= 3_000_000_000 + 1_000_000


def test_only_what_lies_ahead_counts(sent: tuple[VehiclePlan, ...]) -> None:
    """Segments already entered are nobody's to meet on; who is late enters later; who is home is
    not on the road.
    """
    plan = sent[0]
    middle = plan.segments[len(plan.segments) // 2]
    (user,) = on_road([plan], middle.entry_ns)
    assert all(entry > 0 for _, (entry, _, _) in user.passages())
    assert len(user.ahead) == sum(s.entry_ns > middle.entry_ns for s in plan.segments)
    (late,) = on_road([plan], middle.entry_ns, {plan.vehicle: 20.0})
    first_ns = late.ahead[0][1].entry_ns
    assert first_ns == plan.segments[len(plan.segments) - len(late.ahead)].entry_ns + 20 * 10**9
    assert on_road([plan], plan.stops[-1].arrival_ns) == ()


def test_a_wait_ahead_makes_up_for_lateness(sent: tuple[VehiclePlan, ...]) -> None:
    """Who is 10 s late leaves a stop at which it was to wait 30 s as planned, who would wait 4 s
    leaves 6 s late; nobody leaves early.
    """
    plan = next(plan for plan in sent if len(plan.stops) > 3)
    place, rest = plan.stops[1], plan.stops[2:]

    def shifts_s(wait_s: float, late_s: float) -> list[float]:
        stops = (plan.stops[0], place.model_copy(update={"wait_s": wait_s}), *rest)
        waiting = plan.model_copy(update={"stops": stops})
        (user,) = on_road([waiting], plan.issued_ns, {plan.vehicle: late_s})
        planned = {s.entry_ns: s.leg for s in plan.segments}
        moved = [
            round((there.entry_ns - s.entry_ns) / 1e9, 6)
            for (_, there), s in zip(user.ahead, plan.segments[-len(user.ahead) :], strict=True)
            if planned[s.entry_ns] >= 1
        ]
        assert moved
        return sorted(set(moved))

    assert shifts_s(30.0, 10.0) == [0.0]
    assert shifts_s(4.0, 10.0) == [6.0]
    assert shifts_s(4.0, -10.0) == [0.0]
    assert shifts_s(0.0, -10.0) == [-10.0]


def test_those_on_the_road_are_on_the_roads(city: Instance, sent: tuple[VehiclePlan, ...]) -> None:
    """A cycle's roads begin with them, under numbers that no vehicle of its fleet has."""
    users = on_road(sent, 0)
    planner = Planner(city.problem, city.snapshot, [], 3.0, on_road=(*users, *users))
    (one, two) = planner.book.on_road[0], planner.book.on_road[len(users)]
    meetings = planner.book.meetings()
    # Everybody is there twice, so that they platoon; one less saves less, and the gain comes back.
    lost = meetings.remove(two)
    assert lost < 0.0
    assert meetings.add(two) == pytest.approx(-lost)
    assert {p[2] for way in (one, two) for ps in way.values() for p in ps} == {
        (-1,),
        (-1 - len(users),),
    }
