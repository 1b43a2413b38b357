"""Gates and states of cycles that versions before schema 0013 stored: a row for each in each cycle.

They are read as they are while they are recent. Then, a cycle at a time, gates become changes and
states roll-ups of hours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from slipstream.messages import Gate
from storage.models import CycleRow, GateRow, StateRow
from storage.rows import gate, segment_state
from storage.traffic import gates, rollup_table
from storage.traffic.gates import GateState
from storage.traffic.rollups import HOUR_S, rollup

_NOT_CONVERTED: Final = GateState(open=False, y_e=None, reason="not converted")
"""Other than each gate of a cycle."""


def gates_of(session: Session, first: int, last: int) -> dict[int, tuple[Gate, ...]]:
    """Gates by cycle, of those of a range of numbers that are stored in the former way."""
    query = (
        select(GateRow)
        .where(GateRow.cycle >= first, GateRow.cycle <= last)
        .order_by(GateRow.cycle, GateRow.position)
    )
    of_cycles: dict[int, list[Gate]] = {}
    for row in session.scalars(query):
        of_cycles.setdefault(row.cycle, []).append(gate(row))
    return {cycle: tuple(of_cycle) for cycle, of_cycle in of_cycles.items()}


def known_after(session: Session, known: Mapping[str, GateState]) -> Mapping[str, GateState]:
    """What the first cycle after these is compared with, so that it has a row for each segment of
    theirs: changes between it and cycles that are converted later cannot be told yet.

    Args:
        session: of the transaction.
        known: the gates by the changes that are stored.
    """
    last = session.scalar(select(func.max(GateRow.cycle)))
    if last is None:
        return known
    names = set(session.scalars(select(GateRow.segment).where(GateRow.cycle == last)))
    names |= {name for name, state in known.items() if state.watched}
    return {**known, **dict.fromkeys(names, _NOT_CONVERTED)}


def convert_oldest(session: Session, before_ns: int) -> bool:
    """Convert the oldest cycle of these if it began before; False if there is none."""
    numbers = [
        number
        for number in (
            session.scalar(select(func.min(GateRow.cycle))),
            session.scalar(select(func.min(StateRow.cycle))),
        )
        if number is not None
    ]
    if not numbers:
        return False
    cycle = min(numbers)
    started_ns = session.scalar(select(CycleRow.started_ns).where(CycleRow.cycle == cycle))
    if started_ns is None or started_ns >= before_ns:
        return False
    present = gates.states_of(gates_of(session, cycle, cycle).get(cycle, ()))
    if present:
        gates.save(session, cycle, gates.changes(gates.at(session, cycle - 1), present))
    rows = session.scalars(select(StateRow).where(StateRow.cycle == cycle))
    rollup_table.put(session, [rollup(segment_state(row), HOUR_S) for row in rows])
    # Not by the rows that were read: that would be a statement for each of them.
    session.expunge_all()
    for model in (GateRow, StateRow):
        session.execute(delete(model).where(model.cycle == cycle))
    return True
