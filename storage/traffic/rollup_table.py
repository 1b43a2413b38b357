"""The table of roll-ups: merged with what is stored, read by time, deleted by age."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from sqlalchemy import Row, Select, delete, func, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from storage.traffic import segments
from storage.traffic.models import FEATURES, SPREAD, segment_rollups
from storage.traffic.rollups import HOUR_S, MINUTE_S, RollUp, Spread, begin, merged

_MAX_VALUES: Final = 500
"""Values in one statement."""
_T: Final = segment_rollups.c
_PLAIN: Final = (
    "count",
    "stable",
    "turbulent",
    "measured",
    "gaps",
    "vehicles_mean",
    "vehicles_max",
)
_KEY: Final = ("period_s", "began_ns", "segment_id")


def add(session: Session, minutes: Sequence[RollUp]) -> None:
    """Store roll-ups of minutes, and merge them into their hours."""
    put(session, [*minutes, *(minute.over(HOUR_S) for minute in minutes)])


def put(session: Session, rollups: Iterable[RollUp]) -> None:
    """Store roll-ups; what is stored of the same segments and periods is merged with them."""
    new = merged(rollups)
    if not new:
        return
    numbers = segments.ids(session, {part.segment for part in new})
    rows = []
    for (period_s, began_ns), group in groupby(new, lambda part: (part.period_s, part.began_ns)):
        parts = {part.segment: part for part in group}
        stored = {known.segment: known for known in at(session, period_s, began_ns)}
        for segment, part in parts.items():
            known = stored.get(segment)
            whole = part if known is None else merged((known, part))[0]
            rows.append(_values(whole, numbers[segment]))
    assert session.bind is not None
    dialect = postgresql if session.bind.dialect.name == "postgresql" else sqlite
    statement = dialect.insert(segment_rollups)
    changed = {c.name: c for c in statement.excluded if c.name not in _KEY}
    session.execute(statement.on_conflict_do_update(index_elements=list(_KEY), set_=changed), rows)


def at(session: Session, period_s: int, began_ns: int) -> list[RollUp]:
    """Roll-ups of all segments in one period."""
    names = segments.names(session)
    query = select(segment_rollups).where(_T.period_s == period_s, _T.began_ns == began_ns)
    return [_read(row, names[row.segment_id]) for row in session.execute(query)]


def of_segment(
    session: Session, segment: str, begin_ns: int, end_ns: int, period_s: int
) -> Iterator[RollUp]:
    """Roll-ups of one segment whose periods begin in a range of time, oldest first."""
    number = segments.number_of(session, segment)
    if number is None:
        return
    of_period = _T.period_s == period_s
    least, largest = session.execute(
        select(func.min(_T.began_ns), func.max(_T.began_ns)).where(of_period)
    ).one()
    if least is None:
        return
    # Begins of periods are known, so that each row is found by its whole key.
    first = max(least, begin(begin_ns + period_s * 10**9 - 1, period_s))
    begins = range(first, min(largest + 1, end_ns), period_s * 10**9)
    for place in range(0, len(begins), _MAX_VALUES):
        some = begins[place : place + _MAX_VALUES]
        query = (
            select(segment_rollups)
            .where(of_period, _T.began_ns.in_(some), _T.segment_id == number)
            .order_by(_T.began_ns)
        )
        for row in session.execute(query):
            yield _read(row, segment)


def delete_oldest(session: Session, period_s: int, before_ns: int) -> bool:
    """Delete the roll-ups of the oldest period if it ended before; False if there is none."""
    oldest: Select[Any] = select(func.min(_T.began_ns)).where(_T.period_s == period_s)
    began_ns: int | None = session.scalar(oldest)
    if began_ns is None or began_ns + period_s * 10**9 > before_ns:
        return False
    session.execute(delete(segment_rollups).where(_T.period_s == period_s, _T.began_ns == began_ns))
    return True


def delete_all_oldest(session: Session, before_ns: int) -> bool:
    """`delete_oldest` of minutes and hours; False if there is neither."""
    deleted = [delete_oldest(session, period_s, before_ns) for period_s in (MINUTE_S, HOUR_S)]
    return any(deleted)


def _values(part: RollUp, number: int) -> Mapping[str, object]:
    values: dict[str, object] = {name: getattr(part, name) for name in _PLAIN}
    values |= {"period_s": part.period_s, "began_ns": part.began_ns, "segment_id": number}
    for feature in FEATURES:
        spread = part.features.get(feature, (None, None, None))
        values |= {f"{feature}_{name}": value for name, value in zip(SPREAD, spread, strict=True)}
    return values


def _read(row: Row[Any], segment: str) -> RollUp:
    values = row._mapping
    features = {}
    for feature in FEATURES:
        mean, least, largest = (values[f"{feature}_{name}"] for name in SPREAD)
        if mean is not None:
            features[feature] = Spread(mean, least, largest)
    return RollUp(
        segment=segment,
        period_s=row.period_s,
        began_ns=row.began_ns,
        features=features,
        **{name: values[name] for name in _PLAIN},
    )
