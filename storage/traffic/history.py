"""The past of all segments: what a cycle used, and what was known at a moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from slipstream.messages import Gate, SegmentState
from storage.models import CycleRow, StateRow
from storage.rows import segment_state
from storage.traffic import conversion, gates, recent, rollup_table
from storage.traffic.rollups import HOUR_S, MINUTE_S, RollUp, begin


@dataclass(frozen=True)
class SegmentAt:
    """A segment at a moment.

    Attributes:
        gate: as the cycle before the moment judged it; without age and speed unless it is recent.
        rollup: of the minute that the moment lies in, or of the hour where minutes are not kept any
            more; None: no state came in it.
    """

    gate: Gate
    rollup: RollUp | None


def gates_of(session: Session, cycles: Sequence[int]) -> dict[int, tuple[Gate, ...]]:
    """Gates of consecutive cycles, ascending."""
    if not cycles:
        return {}
    first, last = cycles[0], cycles[-1]
    stored = conversion.gates_of(session, first, last) | recent.gates(session, first, last)
    return gates.in_cycles(session, [n for n in cycles if n not in stored]) | stored


def states_of(session: Session, cycle: int) -> tuple[SegmentState, ...]:
    """States that a cycle used; empty if they are not kept any more."""
    query = select(StateRow).where(StateRow.cycle == cycle).order_by(StateRow.segment, StateRow.rsu)
    of_before = tuple(segment_state(row) for row in session.scalars(query))
    return of_before or recent.states(session, cycle)


def is_recent(session: Session, cycle: int) -> bool:
    """Whether a cycle's states are kept as they came."""
    return recent.has(session, cycle) or bool(states_of(session, cycle))


def segments_at(session: Session, time_ns: int) -> tuple[SegmentAt, ...]:
    """All watched segments at a moment, by segment."""
    cycle = session.scalar(
        select(CycleRow.cycle)
        .where(CycleRow.started_ns <= time_ns)
        .order_by(CycleRow.started_ns.desc())
        .limit(1)
    )
    if cycle is None:
        return ()
    of_cycle = sorted(gates_of(session, [cycle])[cycle], key=lambda gate: gate.segment)
    known: dict[str, RollUp] = {}
    for period_s in (MINUTE_S, HOUR_S):
        if any(gate.segment not in known for gate in of_cycle):
            found = rollup_table.at(session, period_s, begin(time_ns, period_s))
            known = {part.segment: part for part in found} | known
    return tuple(SegmentAt(gate, known.get(gate.segment)) for gate in of_cycle)
