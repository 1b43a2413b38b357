"""Vehicles counted in quarter hours: stored once each, read by time, deleted by age."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from sqlalchemy import Row, delete, select
from sqlalchemy.orm import Session

from slipstream.messages import QUARTER_HOUR_S, ClassCount, Estimate, SegmentCounts
from storage.records.sums import insert_into
from storage.traffic.models import COUNTED_CLASSES, segment_counts

ROWS_A_STEP: Final = 1000
"""Rows that are deleted in one transaction, about, at most."""
_QUARTER_NS: Final = round(QUARTER_HOUR_S * 1e9)
_T = segment_counts.c


def save(session: Session, counts: Sequence[SegmentCounts]) -> None:
    """Store complete quarter hours. Of one that is stored already stays what watched for longer:
    after a clock was set back an RSU tells of it twice.
    """
    rows: dict[tuple[object, ...], Mapping[str, object]] = {}
    for one in sorted(counts, key=lambda one: one.watched_s):
        values = _values(one)
        rows[values["began_ns"], values["segment"], values["rsu"]] = values
    if not rows:
        return
    statement = insert_into(session, segment_counts)
    key = list(segment_counts.primary_key.columns)
    changed = {c.name: c for c in statement.excluded if c.name not in {k.name for k in key}}
    session.execute(
        statement.on_conflict_do_update(
            index_elements=key,
            set_=changed,
            where=statement.excluded.watched_s > _T.watched_s,
        ),
        list(rows.values()),
    )


def of_segment(
    session: Session, segment: str, begin_ns: int, end_ns: int
) -> Iterator[SegmentCounts]:
    """Quarter hours of a segment that begin in a range of time, oldest first, then by RSU."""
    query = (
        select(segment_counts)
        .where(_T.began_ns >= begin_ns, _T.began_ns < end_ns, _T.segment == segment)
        .order_by(_T.began_ns, _T.rsu)
    )
    for row in session.execute(query):
        yield _read(row)


def delete_oldest(session: Session, before_ns: int, rows: int) -> bool:
    """Delete the oldest quarter hours that ended before; False if there are none.

    Some ``rows``, and one quarter hour at least.
    """
    oldest = select(_T.began_ns).where(_T.began_ns + _QUARTER_NS <= before_ns)
    upto_ns = session.scalars(oldest.order_by(_T.began_ns).limit(rows)).all()
    if not upto_ns:
        return False
    session.execute(delete(segment_counts).where(_T.began_ns <= upto_ns[-1]))
    return True


def _values(counts: SegmentCounts) -> dict[str, object]:
    flow = counts.flow_vph(counts.vehicles)
    values: dict[str, object] = {
        "began_ns": counts.began_ns,
        "segment": counts.segment,
        # PostgreSQL stores no such character.
        "rsu": counts.rsu.replace("\0", "\N{REPLACEMENT CHARACTER}"),
        "watched_s": counts.watched_s,
        "reason": counts.reason,
        "speeds": counts.speeds,
        **_pair("vehicles", counts.vehicles),
        **_pair("flow_vph", flow),
        **_pair("mean_speed_mps", counts.mean_speed_mps),
        **_pair("v85_mps", counts.v85_mps),
    }
    of_classes = {one.vehicle_class: one.vehicles for one in counts.classes}
    for name in COUNTED_CLASSES:
        values |= _pair(name, of_classes.get(name))
    return values


def _pair(name: str, estimate: Estimate | None) -> dict[str, float | None]:
    return {
        name: None if estimate is None else estimate.value,
        f"{name}_error": None if estimate is None else estimate.standard_error,
    }


def _read(row: Row[Any]) -> SegmentCounts:
    stored = row._mapping

    def estimate(name: str) -> Estimate | None:
        value = stored[name]
        return (
            None if value is None else Estimate(value=value, standard_error=stored[f"{name}_error"])
        )

    return SegmentCounts(
        rsu=stored["rsu"],
        segment=stored["segment"],
        began_ns=stored["began_ns"],
        until_ns=stored["began_ns"] + _QUARTER_NS,
        complete=True,
        watched_s=stored["watched_s"],
        reason=stored["reason"],
        vehicles=Estimate(value=stored["vehicles"], standard_error=stored["vehicles_error"]),
        classes=tuple(
            ClassCount(vehicle_class=name, vehicles=vehicles)
            for name in COUNTED_CLASSES
            if (vehicles := estimate(name)) is not None
        ),
        mean_speed_mps=estimate("mean_speed_mps"),
        v85_mps=estimate("v85_mps"),
        speeds=stored["speeds"],
    )
