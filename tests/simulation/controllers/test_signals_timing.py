"""What is broadcast of signals holds when it is due; stop lines lie where vehicles meet them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from simulation.controllers.signals.program import Green, Phase, Program
from simulation.scenarios.networks.fixed_time import write_fixed_time
from simulation.scenarios.scenario import load_scenario
from simulation.sumo.session import Session

libsumo = pytest.importorskip("libsumo")

World = Callable[[bool], AbstractContextManager[Session]]

SIGNAL = "burden_cross"
"""Six phases; one left turn goes in two of them, first giving way, then alone."""


@pytest.fixture
def world(tmp_path: Path) -> World:
    """Troy's roads without traffic, with its actuated signals or with fixed times."""
    net = load_scenario("troy").net

    @contextmanager
    def start(fixed: bool) -> Iterator[Session]:
        options = ["--net-file", str(net), "--step-length", "0.5", "--begin", "25200"]
        options += ["--no-step-log", "true", "--no-warnings", "true"]
        if fixed:
            path = tmp_path / "fixed.add.xml"
            write_fixed_time(net, path)
            options += ["--additional-files", str(path)]
        with Session(options, (net,)) as session:
            yield session

    return start


def test_fixed_times_are_told_as_they_come(world: World) -> None:
    """A movement may go at a moment if and only if it lies in a window told half a minute ago."""
    from simulation.controllers.signals.timing import Signals

    with world(True) as session:
        signals = Signals()
        session.advance()
        timing = {link: signals.upcoming(SIGNAL, link, session.time_s) for link in range(13)}
        assert all(green.certain for greens in timing.values() for green in greens)
        assert [green.protected for green in timing[6]] == [False, False]
        assert timing[3][0].protected
        for _ in range(240):
            begun_s = session.time_s
            session.advance()
            state = libsumo.trafficlight.getRedYellowGreenState(SIGNAL)
            for link, greens in timing.items():
                inside = any(g.begin_s <= begun_s < g.end_s for g in greens)
                assert inside == (state[link] in "Gg"), (link, begun_s)


def test_an_actuated_green_is_never_later_taken_back(world: World) -> None:
    """No green ends before its told end, and none begins before its told begin."""
    from simulation.controllers.signals.timing import Signals

    with world(False) as session:
        signals = Signals()
        session.advance()
        bounds: dict[int, list[Green]] = {link: [] for link in range(13)}
        for _ in range(240):
            now_s = session.time_s
            for link, greens in bounds.items():
                greens += signals.upcoming(SIGNAL, link, now_s)
            session.advance()
            state = libsumo.trafficlight.getRedYellowGreenState(SIGNAL)
            for link, greens in bounds.items():
                last = greens[-1]
                assert not last.certain
                if last.begin_s <= now_s < last.end_s:
                    assert state[link] in "Gg", (link, now_s)
                if now_s < last.begin_s:
                    assert state[link] not in "Gg", (link, now_s)
        assert len({green.begin_s for green in bounds[0]}) > 1


def test_stop_lines_lie_where_vehicles_meet_them(world: World) -> None:
    """The distance that a vehicle has driven is the begin of its segment and its place on it."""
    from simulation.controllers.signals.crossings import Movements

    with world(True) as session:
        movements = Movements()
        path = ("10th_oakwood-hoosick_10th", "hoosick_10th-hoosick_8th", "hoosick_8th-hoosick_6th")
        first, second = movements.crossings(path)
        assert (first.number, first.tls) == (0, "hoosick_10th")
        assert (second.number, second.tls) == (1, "hoosick_8th")
        assert dict(second.links) == {0: 6}
        assert second.link(7) == 6
        begins_m = movements.begins_m(path)
        libsumo.route.add("way", path)
        libsumo.vehicle.add("probe", "way", departPos="0")
        session.advance()
        segment = path[0]
        while "probe" in libsumo.vehicle.getIDList():
            road = libsumo.vehicle.getRoadID("probe")
            driven_m = libsumo.vehicle.getDistance("probe")
            if road in path:
                place_m = begins_m[path.index(road)] + libsumo.vehicle.getLanePosition("probe")
                assert driven_m == pytest.approx(place_m, abs=0.1)
                segment = road
            elif segment == path[0]:
                assert driven_m >= first.line_m
            session.advance()
        assert segment == path[-1]


def _program(*states: str, fixed: bool = True) -> Program:
    """Phases of 10 s (fixed times) or 5 s at least, one behind the other."""
    min_s = 8.0 if fixed else 5.0
    return Program(
        tuple(
            Phase(state, 10.0, min_s, ((i + 1) % len(states),)) for i, state in enumerate(states)
        ),
        fixed,
    )


def test_a_phase_settles_what_it_owes_at_its_next_turns() -> None:
    """Three seconds too long: two given back at the next turn, one at the turn behind it."""
    course = list(_program("Gr", "rG").course(1, 113.0, {1: 3.0}))
    assert course == [(1, 113.0), (0, 123.0), (1, 131.0), (0, 141.0), (1, 150.0), (0, 160.0)]


def test_a_movement_that_is_never_stopped_is_green_for_ever() -> None:
    """Its green has no end, and is protected only if it is so in every phase."""
    (green,) = _program("Gr", "gG").greens(0, 0, 100.0, 110.0)
    assert (green.end_s, green.certain, green.protected) == (math.inf, True, False)


def test_nothing_is_told_beyond_an_open_choice_of_phases() -> None:
    """Where two phases may follow, a movement that must wait for one of them has no green yet."""
    program = _program("Gr", "rG", fixed=False)
    branching = Program((Phase("Gr", 10.0, 5.0, (0, 1)), program.phases[1]), False)
    assert branching.greens(1, 0, 100.0, 105.0) == ()
    assert branching.greens(0, 0, 100.0, 105.0) == (Green(100.0, 105.0, False, True),)
