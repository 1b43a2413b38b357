"""SPAT of a signal: what each movement shows, from the running phase on, and until when.

Programs of fixed times tell all phases of two cycles, exactly. Actuated ones tell the running phase
with its earliest end, and the next ones with their earliest begin and end, as controllers do by
minEndTime.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from slipstream.messages import MovementEvent, MovementState, PhaseState
from slipstream_lab.simulation.signals.program import NO_COMPENSATION, Program

_LASTING_NS: Final = 3_600_000_000_000
"""What is told of a movement that never changes: TimeMark, J2735's time, reaches an hour."""


def movement_states(
    program: Program,
    phase: int,
    begun_s: float,
    end_s: float,
    compensation_s: Mapping[int, float] = NO_COMPENSATION,
) -> tuple[MovementState, ...]:
    """The phases to come of all movements, numbered as SUMO's links. `end_s`: its end; the
    earliest one if it is actuated.
    """
    course = list(program.course(phase, end_s, compensation_s))
    ends_ns = [round(ends_s * 1e9) for _, ends_s in course]
    begins_ns = [max(0, round(begun_s * 1e9)), *ends_ns[:-1]]
    numbers = [number for number, _ in course]
    told: dict[tuple[PhaseState, ...], tuple[MovementEvent, ...]] = {}
    movements = []
    for group, column in enumerate(program.shown):
        events = told.get(column)
        if events is None:
            events = _events([column[n] for n in numbers], begins_ns, ends_ns, program.fixed)
            if len(set(column)) == 1:
                lasting_ns = begins_ns[0] + _LASTING_NS
                events = (
                    events[0].model_copy(update={"min_end_ns": lasting_ns, "max_end_ns": None}),
                )
            told[column] = events
        movements.append(MovementState(signal_group=group, events=events))
    return tuple(movements)


def _events(
    states: Sequence[PhaseState], begins_ns: Sequence[int], ends_ns: Sequence[int], fixed: bool
) -> tuple[MovementEvent, ...]:
    """The phases of one movement: those in a row that show the same are one."""
    runs: list[tuple[PhaseState, int, int]] = []
    for state, begin_ns, end_ns in zip(states, begins_ns, ends_ns, strict=True):
        if runs and runs[-1][0] == state:
            runs[-1] = (state, runs[-1][1], end_ns)
        else:
            runs.append((state, begin_ns, end_ns))
    if fixed and len(runs) > 1:
        # The last one goes on beyond what was looked at.
        runs.pop()
    return tuple(
        MovementEvent(
            state=state,
            start_ns=begin_ns,
            min_end_ns=end_ns,
            max_end_ns=end_ns if fixed else None,
        )
        for state, begin_ns, end_ns in runs
    )
