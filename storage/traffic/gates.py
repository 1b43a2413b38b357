"""Gates as changes: a row where a segment's gate is another one than in the cycle before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from sqlalchemy import delete, func, insert, select
from sqlalchemy.orm import Session

from slipstream.messages import Gate
from storage.traffic import segments
from storage.traffic.models import gate_changes
from storage.traffic.models import segments as segments_table

SEGMENTS_A_STEP = 100
"""Segments whose old changes are deleted in one transaction, at most."""
_T = gate_changes.c


@dataclass(frozen=True)
class GateState:
    """What counts as a change of a gate.

    Attributes:
        open: whether vehicles may platoon.
        y_e: the flag; None: unknown.
        reason: code of why it is closed.
        watched: False once no RSU reports on the segment any more.
    """

    open: bool
    y_e: Literal[0, 1] | None
    reason: str | None
    watched: bool = True


_UNWATCHED = GateState(open=False, y_e=None, reason=None, watched=False)


def states_of(gates: Sequence[Gate]) -> dict[str, GateState]:
    """The states of a cycle's gates by segment."""
    return {gate.segment: GateState(gate.open, gate.y_e, gate.reason) for gate in gates}


def changes(
    known: Mapping[str, GateState], present: Mapping[str, GateState]
) -> dict[str, GateState]:
    """What is other than before; segments that are missing now are not watched any more."""
    gone = {name for name, state in known.items() if state.watched} - present.keys()
    changed = {name: state for name, state in present.items() if known.get(name) != state}
    return changed | dict.fromkeys(gone, _UNWATCHED)


def save(session: Session, cycle: int, changed: Mapping[str, GateState]) -> None:
    """Store the changes of a cycle."""
    if not changed:
        return
    numbers = segments.ids(session, changed)
    rows = [
        {
            "segment_id": numbers[name],
            "cycle": cycle,
            "watched": state.watched,
            "open": state.open,
            "y_e": state.y_e,
            "reason": state.reason,
        }
        for name, state in changed.items()
    ]
    session.execute(insert(gate_changes), rows)


def at(session: Session, cycle: int) -> dict[str, GateState]:
    """The state of each gate in a cycle, by segment; those not watched any more included."""
    other = gate_changes.alias()
    latest = (
        select(func.max(other.c.cycle))
        .where(other.c.segment_id == segments_table.c.id, other.c.cycle <= cycle)
        .correlate(segments_table)
        .scalar_subquery()
    )
    query = (
        select(segments_table.c.segment, gate_changes)
        .select_from(segments_table)
        .join(gate_changes, (_T.segment_id == segments_table.c.id) & (_T.cycle == latest))
        .order_by(segments_table.c.segment)
    )
    return {
        row.segment: GateState(row.open, row.y_e, row.reason, row.watched)
        for row in session.execute(query)
    }


def in_cycles(session: Session, cycles: Sequence[int]) -> dict[int, tuple[Gate, ...]]:
    """The gates of cycles, ascending, without ages and speeds, which changes do not have."""
    if not cycles:
        return {}
    present = at(session, cycles[0])
    query = (
        select(segments_table.c.segment, gate_changes)
        .select_from(segments_table)
        .join(gate_changes, _T.segment_id == segments_table.c.id)
        .where(_T.cycle > cycles[0], _T.cycle <= cycles[-1])
        .order_by(_T.cycle)
    )
    rows = iter(session.execute(query) if len(cycles) > 1 else ())
    row = next(rows, None)
    gates = {}
    for cycle in cycles:
        while row is not None and row.cycle <= cycle:
            present[row.segment] = GateState(row.open, row.y_e, row.reason, row.watched)
            row = next(rows, None)
        gates[cycle] = as_gates(present)
    return gates


def as_gates(states: Mapping[str, GateState]) -> tuple[Gate, ...]:
    """Gates of the watched segments, by segment."""
    return tuple(
        Gate(
            segment=name,
            y_e=state.y_e,
            reason=state.reason,
            age_s=None,
            speed_mps=None,
            open=state.open,
        )
        for name, state in sorted(states.items())
        if state.watched
    )


def prune(session: Session, first: int, after: int, number: int) -> int:
    """Delete changes that no cycle from ``first`` on needs, of the next segments.

    Args:
        first: number of the first cycle that is kept.
        after: number of the segment after which to begin.
        number: of segments, at most.

    Returns:
        Number of the last segment that was looked at; 0 after the last one.
    """
    numbers = session.scalars(
        select(segments_table.c.id)
        .where(segments_table.c.id > after)
        .order_by(segments_table.c.id)
        .limit(number)
    ).all()
    if not numbers:
        return 0
    later = gate_changes.alias()
    replaced = (
        select(later.c.cycle)
        .where(
            later.c.segment_id == _T.segment_id, later.c.cycle > _T.cycle, later.c.cycle <= first
        )
        .exists()
    )
    session.execute(
        delete(gate_changes).where(_T.segment_id.in_(numbers), _T.cycle < first, replaced)
    )
    return int(numbers[-1])
