"""Gates and states of recent cycles, as messages: nothing of them is left out."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Final

import msgspec
from pydantic import TypeAdapter
from sqlalchemy import delete, func, insert, select
from sqlalchemy.orm import Session

from slipstream.messages import Gate, SegmentState
from storage.models import CycleRow
from storage.records.inputs import unpacked
from storage.traffic.models import cycle_traffic

CYCLES_A_STEP: Final = 5
"""Cycles whose states are deleted in one transaction, at most."""
_GATES: Final = TypeAdapter(tuple[Gate, ...])
_STATES: Final = msgspec.json.Decoder(tuple[SegmentState, ...])
_T = cycle_traffic.c


def save(
    session: Session, cycle: int, gates: Sequence[Gate], states: Sequence[SegmentState]
) -> None:
    """Store what a cycle used."""
    ordered = sorted(states, key=lambda state: (state.segment, state.rsu))
    row = {
        "cycle": cycle,
        "gates": zlib.compress(_GATES.dump_json(tuple(gates))),
        "states": zlib.compress(msgspec.json.encode(ordered)),
    }
    session.execute(insert(cycle_traffic), row)


def gates(session: Session, first: int, last: int) -> dict[int, tuple[Gate, ...]]:
    """Gates by cycle, of those of a range of numbers that are recent."""
    query = select(_T.cycle, _T.gates).where(_T.cycle >= first, _T.cycle <= last)
    return {
        cycle: _GATES.validate_json(unpacked(packed, "damaged gates"))
        for cycle, packed in session.execute(query)
    }


def states(session: Session, cycle: int) -> tuple[SegmentState, ...]:
    """States of a cycle by segment and RSU; empty if it is not recent."""
    packed = session.scalar(select(_T.states).where(_T.cycle == cycle))
    return () if packed is None else _STATES.decode(unpacked(packed, "damaged states"))


def prune(session: Session, before_ns: int, number: int) -> bool:
    """Delete what is kept of the oldest cycles if they began before; False if there is none.

    Of ``number`` cycles at most. That of the latest cycle stays.
    """
    query = (
        select(_T.cycle)
        .join(CycleRow, CycleRow.cycle == _T.cycle)
        .where(
            CycleRow.started_ns < before_ns,
            CycleRow.cycle < select(func.max(CycleRow.cycle)).scalar_subquery(),
        )
        .order_by(_T.cycle)
        .limit(number)
    )
    cycles = session.scalars(query).all()
    if cycles:
        session.execute(delete(cycle_traffic).where(_T.cycle.in_(cycles)))
    return bool(cycles)
