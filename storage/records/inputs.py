"""What cycles were made from, compressed. A part that many cycles have, such as the roads, is
stored once, by the hash of its content, and deleted with the last cycle that has it.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

from sqlalchemy import delete, insert, select
from sqlalchemy.orm import Session

from storage.models import CycleRow, InputPartRow, InputRow, InputUseRow

KEEP_DAYS: Final = 7.0
"""Age from which the inputs of cycles are deleted, days; the cycles stay."""
BATCH: Final = 10
"""Cycles whose inputs are deleted in one transaction, at most."""


@dataclass(frozen=True)
class Part:
    """A part of inputs.

    Attributes:
        hash: SHA-256 of its content, in hex.
        data: its content, compressed.
    """

    hash: str
    data: bytes

    @classmethod
    def of(cls, content: bytes) -> Self:
        """The part of a content."""
        return cls(hashlib.sha256(content).hexdigest(), zlib.compress(content))

    @property
    def content(self) -> bytes:
        """What it was made of.

        Raises:
            ValueError: it is damaged.
        """
        content = unpacked(self.data, "a part of a cycle's inputs is damaged")
        if hashlib.sha256(content).hexdigest() != self.hash:
            raise ValueError("a part of a cycle's inputs is damaged: it has another content")
        return content


@dataclass(frozen=True)
class CycleInputs:
    """The inputs of one cycle.

    Attributes:
        record: what it does not share, such as its solvers' answers.
        parts: by name, what other cycles may have too.
    """

    record: bytes
    parts: Mapping[str, Part]


def save(session: Session, cycle: int, inputs: CycleInputs) -> None:
    """Store the inputs of a cycle that is stored, and those of its parts that are not yet."""
    session.execute(insert(InputRow), [{"cycle": cycle, "data": zlib.compress(inputs.record)}])
    parts = {part.hash: part.data for part in inputs.parts.values()}
    if not parts:
        return
    query = select(InputPartRow.hash).where(InputPartRow.hash.in_(parts))
    known = set(session.scalars(query))
    new = [{"hash": name, "data": data} for name, data in parts.items() if name not in known]
    if new:
        session.execute(insert(InputPartRow), new)
    uses = [
        {"cycle": cycle, "name": name, "hash": part.hash} for name, part in inputs.parts.items()
    ]
    session.execute(insert(InputUseRow), uses)


def load(session: Session, cycle: int) -> CycleInputs | None:
    """The inputs of a cycle; None: they are not stored, or not any more.

    Raises:
        ValueError: they are damaged.
    """
    own = record(session, cycle)
    if own is None:
        return None
    query = (
        select(InputUseRow.name, InputPartRow.hash, InputPartRow.data)
        .join(InputPartRow, InputPartRow.hash == InputUseRow.hash)
        .where(InputUseRow.cycle == cycle)
    )
    parts = {name: Part(hashed, part) for name, hashed, part in session.execute(query)}
    return CycleInputs(own, parts)


def record(session: Session, cycle: int) -> bytes | None:
    """What a cycle alone was made from and recorded (`CycleInputs.record`), without its parts.

    Raises:
        ValueError: it is damaged.
    """
    data = session.scalar(select(InputRow.data).where(InputRow.cycle == cycle))
    return None if data is None else unpacked(data, f"the inputs of cycle {cycle} are damaged")


def unpacked(data: bytes, problem: str) -> bytes:
    """Bytes that were compressed; what is damaged is a ValueError with the problem."""
    try:
        return zlib.decompress(data)
    except zlib.error as error:
        raise ValueError(f"{problem}: {error}") from None


def prune(session: Session, before_ns: int, number: int) -> int:
    """Delete the inputs of at most so many cycles, the oldest, that began before; of how many."""
    query = (
        select(InputRow.cycle)
        .join(CycleRow, CycleRow.cycle == InputRow.cycle)
        .where(CycleRow.started_ns < before_ns)
        .order_by(InputRow.cycle)
        .limit(number)
    )
    old = session.scalars(query).all()
    if old:
        session.execute(delete(InputRow).where(InputRow.cycle.in_(old)))
        drop_unused(session)
    return len(old)


def drop_unused(session: Session) -> None:
    """Delete the parts that no cycle has any more."""
    used = select(InputUseRow.hash).where(InputUseRow.hash == InputPartRow.hash)
    session.execute(delete(InputPartRow).where(~used.exists()))
