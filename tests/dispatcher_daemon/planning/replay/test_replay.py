"""A stored cycle made again gives its plan; what it depends on beside its inputs is recorded."""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms.problem import Problem, RoutingProblem, routing_problem
from dispatcher_daemon.planning.cycle.cycle import CycleResult
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.replay import (
    InputEncoder,
    Replayed,
    Trace,
    cycle_record,
    replayed,
    restored_cycle,
)
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.service.dispatcher.reports import failed_report
from dispatcher_daemon.settings import (
    CitySettings,
    DispatcherSettings,
    LcQaoaSettings,
    SearchSettings,
)
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome, Solver
from dispatcher_daemon.solvers.registry import configured_solvers
from dispatcher_daemon.solvers.workers.pool import Solve, solve_in_process
from dispatcher_daemon.traffic.snapshot import Expectations, TrafficSnapshot
from slipstream.messages import (
    Message,
    PlanAcknowledgement,
    SegmentState,
    VehiclePosition,
    acknowledgement_key,
    position_key,
    state_key,
)
from slipstream.roads import Crossing, RoadNetwork
from slipstream.roads.access import Access
from slipstream.roads.projection import Projection
from slipstream_lab.research.cities.generator import CityShape, generate_city
from storage import CycleInputs, Part, StoredCycle, open_database, open_reader

State = Callable[..., SegmentState]
DAY_NS = 86_400 * 10**9
CITY = DispatcherSettings(
    form="route",
    solvers=("exact",),
    city=CitySettings(
        search=SearchSettings(rounds=2, iterations_per_stop=5, workers=2),
        second_rounds=1,
        max_sweeps=4,
        patience=2,
    ),
)


class Nowhere:
    """A bus that nobody listens to."""

    def publisher(self, key: str) -> Nowhere:
        """Itself."""
        return self

    def put(self, message: Message | bytes) -> None:
        """Lost."""


@dataclass
class Hasty:
    """The exact solver, that says it took all its time."""

    name: str = "exact"
    share: float = 1.0

    def warm_up(self) -> None:
        """Nothing to do."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """The exact answer to blocks of an even number of variables."""
        if problem.choices % 2:
            return Outcome(self.name, "timeout", None, deadline_s, reason="too slow")
        outcome = ExactSolver().solve(problem, deadline_s, seed)
        return replace(outcome, wall_s=self.share * deadline_s, status="feasible")


def stored(
    path: Path,
    network: RoadNetwork,
    fleet: Fleet,
    settings: DispatcherSettings,
    states: Sequence[SegmentState],
    solve: Solve | None = None,
    executor: Executor | None = None,
    cycles: int = 1,
) -> StoredCycle:
    """The last of some cycles of a dispatcher, as its database has it."""
    url = f"sqlite:///{path / 'slipstream.db'}"
    with open_database(url) as database:
        dispatcher = Dispatcher(
            settings,
            network,
            fleet,
            Nowhere(),
            database,
            solve or solve_in_process(configured_solvers(settings)),
            executor,
        )
        for _ in range(cycles):
            for state in states:
                fresh = msgspec.structs.replace(state, time_ns=time.time_ns())
                dispatcher.receiver.on_state(state_key(state.rsu, state.segment), fresh.to_bytes())
            dispatcher.run_cycle()
    with open_reader(url) as reader:
        found = reader.stored_cycle(cycles)
    assert found is not None
    assert found.report.status == "ok", found.report
    return found


def again(cycle: StoredCycle, settings: DispatcherSettings, solve: Solve | None = None) -> Replayed:
    """The same cycle made again, none of its vehicles on its way."""
    with ThreadPoolExecutor(1) as thread:
        return replayed(
            cycle,
            lambda *_: None,
            solve or solve_in_process(configured_solvers(settings)),
            thread,
        )


def changed(cycle: StoredCycle, name: str, change: Callable[[Any], object]) -> StoredCycle:
    """The same with another content of one part of its inputs."""
    assert cycle.inputs is not None
    content = json.loads(cycle.inputs.parts[name].content)
    part = Part.of(json.dumps(change(content)).encode())
    return replace(
        cycle, inputs=CycleInputs(cycle.inputs.record, {**cycle.inputs.parts, name: part})
    )


@pytest.mark.long
@pytest.mark.slow
def test_the_demo_fleet_s_cycle_is_made_again_the_same(
    tmp_path: Path, demo: RoutingProblem, state: State
) -> None:
    """With its default solvers; with a stop less it is another plan, and the differences say so."""
    settings = DispatcherSettings(lc_qaoa=LcQaoaSettings(shots=512))
    states = [state("avenue_east", 1), state("avenue_west", 1)]
    cycle = stored(tmp_path, demo.network, demo.fleet, settings, states)
    found = again(cycle, settings)
    assert (found.differences, found.vehicles) == ((), 2)
    assert [n for n in found.notes if "made by" in n] == []

    fewer = again(changed(cycle, "stops", lambda stops: stops[:-1]), settings)
    assert any("stops" in line for line in fewer.differences)


def city(
    seed: int, vehicles: int, stops: int, segments: int, state: State
) -> tuple[RoutingProblem, list[SegmentState]]:
    """A generated city, and states that give its gates."""
    shape = CityShape(depots=1, open_share=0.9)
    made = generate_city(seed, vehicles=vehicles, stops=stops, segments=segments, shape=shape)
    watched = [t for t in made.snapshot.segments.values() if t.watched]
    return made.problem, [state(t.segment, t.y_e, speed_mps=t.speed_mps) for t in watched]


def with_search(**changes: object) -> DispatcherSettings:
    """The city's settings with another search."""
    search = CITY.city.search.model_copy(update=changes)
    return CITY.model_copy(update={"city": CITY.city.model_copy(update={"search": search})})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "solver", "note"),
    [
        pytest.param(CITY, ExactSolver(), None, marks=pytest.mark.long),
        (with_search(time_limit_s=0.1, iterations_per_stop=5000), ExactSolver(), "were ended by"),
        (CITY, Hasty(), "taken as recorded"),
    ],
    ids=["in time", "search ended by time", "solver ended by time"],
)
def test_a_city_s_cycle_is_made_again_the_same_whatever_time_has_ended(
    tmp_path: Path, state: State, settings: DispatcherSettings, solver: Solver, note: str | None
) -> None:
    """Searches are repeated by number, and answers that time ended are kept; another cycle that
    starts from the first one's routes is no different.
    """
    problem, states = city(1, 8, 24, 100, state)
    solve = solve_in_process([solver])
    cycle = stored(tmp_path, problem.network, problem.fleet, settings, states, solve, cycles=2)
    found = again(cycle, settings)
    assert found.differences == ()
    assert found.vehicles > 0
    assert len(found.notes) == (0 if note is None else 1)
    assert all(note is not None and note in line for line in found.notes)


class Dying(ThreadPoolExecutor):
    """Every second call dies with its worker."""

    calls = 0

    def submit(self, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run it, or not."""
        self.calls += 1
        if self.calls % 2 == 0:
            raise RuntimeError("the worker died")
        return super().submit(*args, **kwargs)


@pytest.mark.slow
def test_a_search_whose_worker_died_dies_again(tmp_path: Path, state: State) -> None:
    """What was lost for good when the plan was made is not found when it is made again."""
    problem, states = city(1, 6, 18, 80, state)
    with Dying(1) as executor:
        solve = solve_in_process([ExactSolver()])
        cycle = stored(
            tmp_path, problem.network, problem.fleet, CITY, states, solve, executor=executor
        )
    assert cycle.inputs is not None
    assert None in cycle_record(cycle.inputs).trace.searches
    assert again(cycle, CITY).differences == ()


@pytest.mark.slow
def test_a_cycle_with_vehicles_on_their_way_is_made_again_the_same(
    tmp_path: Path, demo: RoutingProblem
) -> None:
    """What a vehicle is bound to is stored with the cycle, its present plan by reference."""
    settings = DispatcherSettings(solvers=("exact",))
    url = f"sqlite:///{tmp_path / 'a.db'}"
    solve = solve_in_process([ExactSolver()])
    with open_database(url) as database, open_reader(url) as reader:
        made = Dispatcher(settings, demo.network, demo.fleet, Nowhere(), database, solve)
        made.run_cycle()
        plan = reader.plan(1, "van-a")
        assert plan is not None
        now_ns = time.time_ns()
        answer = PlanAcknowledgement(
            vehicle="van-a", time_ns=now_ns, cycle=1, accepted=True, reason=None
        )
        made.fleet_watch.on_acknowledgement(acknowledgement_key("van-a"), answer.to_bytes())
        here = VehiclePosition(
            vehicle="van-a",
            time_ns=now_ns,
            segment=plan.segments[0].segment,
            share=0.4,
            speed_mps=10.0,
            on_road=True,
            cycle=1,
            leg=0,
        )
        made.fleet_watch.on_position(position_key("van-a"), here.to_bytes())
        made.run_cycle()
        cycle = reader.stored_cycle(2)
        assert cycle is not None
        restored = restored_cycle(cycle, reader.plan)
        assert [own.plan for own in restored.commitments] == [plan]
        with ThreadPoolExecutor(1) as thread:
            assert replayed(cycle, reader.plan, solve, thread).differences == ()
            with pytest.raises(ValueError, match="of cycle 1, is not stored"):
                replayed(cycle, lambda *_: None, solve, thread)


@pytest.mark.long
def test_a_cycle_is_made_again_as_long_as_its_inputs_are_kept(tmp_path: Path, state: State) -> None:
    """Its states go after a day and are not needed; its traffic goes with its other inputs."""
    problem, states = city(1, 8, 24, 100, state)
    solve = solve_in_process([ExactSolver()])
    last = stored(tmp_path, problem.network, problem.fleet, CITY, states, solve, cycles=2)
    began_ns, url = last.report.started_ns, f"sqlite:///{tmp_path / 'slipstream.db'}"
    with open_database(url) as database, open_reader(url) as reader:
        known = reader.states(1)
        assert any(gate.open for gate in last.report.gates)
        database.tidy(began_ns + 6 * DAY_NS)
        assert (len(known) > 0, reader.states(1)) == (True, ())
        cycle = reader.stored_cycle(1)
        assert cycle is not None
        assert again(cycle, CITY).differences == ()
        closed = changed(cycle, "traffic", lambda t: {**t, "open": [False] * len(t["open"])})
        assert again(closed, CITY).differences != ()

        database.tidy(began_ns + 7 * DAY_NS)
        assert reader.stored_cycle(1) == replace(cycle, inputs=None)
    with sqlite3.connect(tmp_path / "slipstream.db") as connection:
        query = "SELECT count(*), count(DISTINCT hash) FROM input_uses"
        uses, parts = connection.execute(query).fetchone()
        assert connection.execute("SELECT count(*) FROM input_parts").fetchone() == (parts,)
        assert uses == 8


def test_inputs_give_the_cycle_that_they_were_made_of(
    demo: RoutingProblem, traffic: Callable[..., TrafficSnapshot], state: State
) -> None:
    """Roads, fleet, traffic with what was learned, settings, start; and no password is in them."""
    settings = DispatcherSettings(
        database_url="postgresql://me:secret-word@host/db", solvers=("exact",), gap_m=9.5
    )
    fleet = demo.fleet.model_copy(
        update={
            "stops": (
                *demo.fleet.stops[:-1],
                demo.fleet.stops[-1].model_copy(update={"latest_s": 3000.0, "demand": 2}),
            )
        }
    )
    closed = Access(frozenset({"delivery", "bus"}), 3.5, None, 12.0, 7500.0, {"bus": 8.0})
    name, segment = next(iter(demo.network.segments.items()))
    (turn, *_) = ((a, b) for a, onto in demo.network.follows.items() for b in onto)
    network = replace(
        demo.network,
        segments=MappingProxyType({**demo.network.segments, name: replace(segment, access=closed)}),
        turn_classes=MappingProxyType({turn: frozenset({"bus"})}),
        crossings=MappingProxyType({turn: Crossing(12.0, 7.0, True, "j1", {0: 4, 1: 5})}),
        projection=Projection("+proj=utm +zone=33", (1.5, -2.0)),
    )
    snapshot = traffic(avenue_east=1, avenue_west=None)
    snapshot = snapshot.at_usual_speeds({"avenue_west": 7.25}).with_usual_gates(
        {"avenue_east": 0.4}
    )
    snapshot = replace(snapshot, expected=Expectations({turn: 0.1}, {turn: 3.3}, {turn: 0.25}))
    problem = routing_problem(network, fleet, settings)
    cycle = Cycle(problem, snapshot, settings, 7, snapshot.now_ns, 99, start={"van-a": ("c1",)})
    result = CycleResult(failed_report(7, snapshot.now_ns, 0.0, "none"), ())
    inputs = InputEncoder().encode(cycle, Trace(), result)
    record = StoredCycle(result.report, (), inputs)
    found = restored_cycle(record, lambda *_: None)
    assert found.problem == cycle.problem
    assert found.snapshot == replace(cycle.snapshot, states=())
    kept = {"bus", "service", "database_url", "rsus"}
    assert found.settings.model_dump(exclude=kept) == settings.model_dump(exclude=kept)
    assert found.settings.priced_advice == settings.priced_advice
    assert (found.number, found.now_ns, found.seed) == (7, snapshot.now_ns, 99)
    assert found.start == {"van-a": ("c1",)}
    everything = inputs.record + b"".join(part.content for part in inputs.parts.values())
    assert b"secret-word" not in everything


@pytest.mark.slow
def test_inputs_that_cannot_be_read_are_told(tmp_path: Path, demo: RoutingProblem) -> None:
    """A key of another version, and a part that is missing."""
    settings = DispatcherSettings(solvers=("exact",))
    cycle = stored(tmp_path, demo.network, demo.fleet, settings, ())
    newer = changed(cycle, "settings", lambda s: {**s, "warp_factor": 9})
    with pytest.raises(ValueError, match="warp_factor"):
        again(newer, settings)
    assert cycle.inputs is not None
    for gone in ("places", "traffic"):
        parts = {name: part for name, part in cycle.inputs.parts.items() if name != gone}
        fewer = CycleInputs(cycle.inputs.record, parts)
        with pytest.raises(ValueError, match="cannot be read"):
            again(replace(cycle, inputs=fewer), settings)
    with pytest.raises(ValueError, match="not that of its roads"):
        again(changed(cycle, "traffic", lambda _: {"y_e": [1]}), settings)
    with pytest.raises(ValueError, match="not stored"):
        again(replace(cycle, inputs=None), settings)
