"""Phases to come as messages: of fixed programs exactly, of actuated ones as far as is known."""

from __future__ import annotations

from slipstream.messages import MovementState, SignalPhaseAndTiming
from slipstream_lab.simulation.signals.program import Phase, Program
from slipstream_lab.simulation.signals.spat import movement_states
from vehicle_agent.signals import Green, SignalTimings

Event = tuple[str, float, float, float | None]


def _program(*states: str, fixed: bool = True) -> Program:
    """Phases of 10 s (fixed times) or 5 s at least, one behind the other."""
    min_s = 8.0 if fixed else 5.0
    return Program(
        tuple(
            Phase(state, 10.0, min_s, ((i + 1) % len(states),)) for i, state in enumerate(states)
        ),
        fixed,
    )


def _events(movement: MovementState) -> list[Event]:
    """In seconds."""
    return [
        (
            event.state,
            event.start_ns / 1e9,
            event.min_end_ns / 1e9,
            None if event.max_end_ns is None else event.max_end_ns / 1e9,
        )
        for event in movement.events
    ]


def _greens(movements: tuple[MovementState, ...], group: int) -> tuple[Green, ...]:
    """As a vehicle reads them at second 100."""
    heard = SignalTimings()
    heard.receive(
        SignalPhaseAndTiming(
            intersection="s", revision=0, time_ns=100_000_000_000, movements=movements
        )
    )
    return heard.upcoming("s", group, 100.0)


def test_a_phase_settles_what_it_owes_at_its_next_turns() -> None:
    """Three seconds too long: two given back at the next turn, one at the turn behind it."""
    course = list(_program("Gr", "rG").course(1, 113.0, {1: 3.0}))
    assert course == [(1, 113.0), (0, 123.0), (1, 131.0), (0, 141.0), (1, 150.0), (0, 160.0)]


def test_fixed_times_tell_two_cycles_exactly() -> None:
    """Each phase with its end; yellow is that of the green before it; equal phases are one."""
    first, second = movement_states(_program("Gr", "yr", "rg", "ry"), 0, 95.0, 105.0)
    assert _events(first) == [
        ("protected-Movement-Allowed", 95.0, 105.0, 105.0),
        ("protected-clearance", 105.0, 115.0, 115.0),
        ("stop-And-Remain", 115.0, 135.0, 135.0),
        ("protected-Movement-Allowed", 135.0, 145.0, 145.0),
        ("protected-clearance", 145.0, 155.0, 155.0),
        ("stop-And-Remain", 155.0, 175.0, 175.0),
    ]
    assert [event.state for event in second.events[:3]] == [
        "stop-And-Remain",
        "permissive-Movement-Allowed",
        "permissive-clearance",
    ]


def test_actuated_times_are_open_and_each_begin_the_earliest_one() -> None:
    """One turn of the program."""
    (movement, _) = movement_states(_program("Gr", "yr", "rG", fixed=False), 1, 95.0, 101.0)
    assert _events(movement) == [
        ("protected-clearance", 95.0, 101.0, None),
        ("stop-And-Remain", 101.0, 106.0, None),
        ("protected-Movement-Allowed", 106.0, 111.0, None),
    ]


def test_a_movement_that_is_never_stopped_is_green_for_an_hour_at_least() -> None:
    """It is protected only if it is so in every phase."""
    for fixed in (True, False):
        movements = movement_states(_program("Gg", "GG", fixed=fixed), 0, 95.0, 105.0)
        (green,) = _greens(movements, 0)
        assert (green.end_s, green.certain, green.protected) == (3695.0, False, True)
    (green, *_) = _greens(movement_states(_program("Gg", "GG"), 0, 95.0, 105.0), 1)
    assert (green.begin_s, green.protected) == (95.0, False)


def test_nothing_is_told_beyond_an_open_choice_of_phases() -> None:
    """Where two phases may follow, a movement that must wait for one of them has no green yet."""
    program = _program("Gr", "rG", fixed=False)
    branching = Program((Phase("Gr", 10.0, 5.0, (0, 1)), program.phases[1]), False)
    movements = movement_states(branching, 0, 100.0, 105.0)
    assert _greens(movements, 1) == ()
    assert _greens(movements, 0) == (Green(100.0, 105.0, False, True),)


def test_other_letters_stop_or_are_dark() -> None:
    """Red-yellow, a signal that is off, and one that SUMO lets turn after a stop."""
    states = [m.events[0].state for m in movement_states(_program("uOos", "Gggg"), 0, 95.0, 105.0)]
    assert states == ["pre-Movement", "dark", "dark", "stop-And-Remain"]


def test_a_phase_that_began_before_midnight_begins_at_midnight() -> None:
    """Times on the wire are not negative."""
    (movement, _) = movement_states(_program("Gr", "rG"), 0, -4.0, 6.0)
    assert movement.events[0].start_ns == 0
