"""What is told of signals holds when it is due, as vehicles read it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from slipstream_lab.simulation.scenarios.networks.fixed_time import write_fixed_time
from slipstream_lab.simulation.scenarios.scenario import load_scenario
from slipstream_lab.simulation.signals import SignalController
from slipstream_lab.simulation.sumo.session import SumoSession
from vehicle_agent.signals import Green, SignalTimings

libsumo = pytest.importorskip("libsumo")

World = Callable[[bool], AbstractContextManager[SumoSession]]

SIGNAL = "burden_cross"
"""Six phases; one left turn goes in two of them, first giving way, then alone."""


@pytest.fixture
def world(tmp_path: Path) -> World:
    """Troy's roads without traffic, with its actuated signals or with fixed times."""
    net = load_scenario("troy").net

    @contextmanager
    def start(fixed: bool) -> Iterator[SumoSession]:
        options = ["--net-file", str(net), "--step-length", "0.5", "--begin", "25200"]
        options += ["--no-step-log", "true", "--no-warnings", "true"]
        if fixed:
            path = tmp_path / "fixed.add.xml"
            write_fixed_time(net, path)
            options += ["--additional-files", str(path)]
        with SumoSession(options, (net,)) as session:
            yield session

    return start


def test_fixed_times_are_told_as_they_come(world: World) -> None:
    """A movement may go at a moment if and only if it lies in a window told half a minute ago."""
    with world(True) as session:
        controller, heard = SignalController([SIGNAL], False), SignalTimings()
        session.advance()
        heard.receive(controller.spat(SIGNAL, session.time_s))
        timing = {link: heard.upcoming(SIGNAL, link, session.time_s) for link in range(13)}
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
    with world(False) as session:
        controller, heard = SignalController([SIGNAL], False), SignalTimings()
        session.advance()
        bounds: dict[int, list[Green]] = {link: [] for link in range(13)}
        for _ in range(240):
            now_s = session.time_s
            heard.receive(controller.spat(SIGNAL, now_s))
            for link, greens in bounds.items():
                greens += heard.upcoming(SIGNAL, link, now_s)
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


@pytest.mark.parametrize("fixed", [True, False])
def test_what_shows_is_what_is_told_to_show(world: World, fixed: bool) -> None:
    """Fixed times: of the next step, also a second after sending. Actuated: of the last step."""
    with world(fixed) as session:
        controller, heard = SignalController([SIGNAL], False), SignalTimings()
        session.advance()
        seen: set[str] = set()
        for step in range(300):
            now_s = session.time_s
            if step % 3 == 0 or not fixed:
                heard.receive(controller.spat(SIGNAL, now_s))
            shown = [heard.indication(SIGNAL, link, now_s) for link in range(13)]
            if fixed:
                session.advance()
            state = libsumo.trafficlight.getRedYellowGreenState(SIGNAL)
            if not fixed:
                session.advance()
            for known, letter in zip(shown, state, strict=True):
                assert known is not None
                assert (known.may_go, known.clearing) == (letter in "gG", letter == "y"), now_s
                assert letter != "r" or known.red_s <= now_s
            seen.update(state)
        assert seen == {"r", "y", "g", "G"}


def test_a_message_is_made_once_and_dated_anew(world: World) -> None:
    """The same object within a second, the same content after it, another one at each change."""
    with world(True) as session:
        controller = SignalController([SIGNAL], False)
        session.advance(25201.0)
        first = controller.spat(SIGNAL, session.time_s)
        assert controller.spat(SIGNAL, session.time_s) is first
        session.advance()
        assert controller.spat(SIGNAL, session.time_s) is first
        session.advance()
        repeated = controller.spat(SIGNAL, session.time_s)
        assert repeated.time_ns == 25202_000_000_000
        assert repeated.movements is first.movements
        while libsumo.trafficlight.getPhase(SIGNAL) == 0:
            session.advance()
        changed = controller.spat(SIGNAL, session.time_s)
        assert changed.revision == first.revision + 1
        with pytest.raises(KeyError):
            controller.spat("elsewhere", session.time_s)
