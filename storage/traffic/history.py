"""The past of all segments: what a cycle used, and what was known at a moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from sqlalchemy import select
from sqlalchemy.orm import Session

from slipstream.messages import Gate
from storage.models import CycleRow
from storage.traffic import gates, recent, rollup_table
from storage.traffic.rollups import HOUR_S, MINUTE_S, RollUp, begin

GATES_HOLD_S: Final = 900.0
"""For this long after a cycle its gates count as those of the moment, s."""


@dataclass(frozen=True)
class SegmentAt:
    """A segment at a moment.

    Attributes:
        gate: as the last cycle before the moment that did not fail judged it, without age and speed
            unless that is recent; closed as "stale" where it began more than `GATES_HOLD_S` before.
        rollup: of the minute that the moment lies in, or of the hour where minutes are not kept any
            more; None: no state came in it.
    """

    gate: Gate
    rollup: RollUp | None


def gates_of(session: Session, cycles: Sequence[int]) -> dict[int, tuple[Gate, ...]]:
    """Gates of consecutive cycles, ascending; one that failed has none but those it told of."""
    if not cycles:
        return {}
    first, last = cycles[0], cycles[-1]
    stored = recent.gates(session, first, last)
    failed = session.scalars(
        select(CycleRow.cycle).where(
            CycleRow.cycle >= first, CycleRow.cycle <= last, CycleRow.status == "failed"
        )
    )
    # Changes do not tell that nothing was known in a cycle.
    stored = dict.fromkeys(failed, ()) | stored
    return gates.in_cycles(session, [n for n in cycles if n not in stored]) | stored


def segments_at(session: Session, time_ns: int) -> tuple[SegmentAt, ...]:
    """All watched segments at a moment, by segment."""
    found_cycle = session.execute(
        select(CycleRow.cycle, CycleRow.started_ns)
        .where(CycleRow.started_ns <= time_ns, CycleRow.status != "failed")
        .order_by(CycleRow.started_ns.desc())
        .limit(1)
    ).first()
    if found_cycle is None:
        return ()
    cycle, started_ns = found_cycle
    of_cycle = sorted(gates_of(session, [cycle])[cycle], key=lambda gate: gate.segment)
    if time_ns - started_ns > GATES_HOLD_S * 1e9:
        nothing = {"y_e": None, "reason": "stale", "age_s": None, "speed_mps": None, "open": False}
        of_cycle = [gate.model_copy(update=nothing) for gate in of_cycle]
    known: dict[str, RollUp] = {}
    for period_s in (MINUTE_S, HOUR_S):
        if any(gate.segment not in known for gate in of_cycle):
            found = rollup_table.at(session, period_s, begin(time_ns, period_s))
            known = {part.segment: part for part in found} | known
    return tuple(SegmentAt(gate, known.get(gate.segment)) for gate in of_cycle)
