"""The table of roll-ups: merged with what is stored, read by time, deleted by age."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Insert,
    Row,
    Select,
    TextClause,
    delete,
    func,
    literal,
    select,
    text,
)
from sqlalchemy.orm import Session

from storage.records.sums import chunks, insert_into
from storage.traffic import segments
from storage.traffic.models import FEATURES, SPREAD, segment_rollups
from storage.traffic.rollups import HOUR_S, MINUTE_S, RollUp, Spread, begin, merge, merged

ROWS_A_STEP: Final = 1000
"""Roll-ups that are deleted in one transaction."""
_MIN_REAL: Final = 1e-37
_MAX_REAL: Final = 3e38
_T: Final = segment_rollups.c
_COUNTS: Final = ("count", "stable", "turbulent", "measured", "gaps")
_PLAIN: Final = (*_COUNTS, "vehicles_mean", "vehicles_max")
_KEY: Final = ("period_s", "began_ns", "segment_id")


def add(session: Session, minutes: Sequence[RollUp]) -> None:
    """Store roll-ups of minutes, and make those of the hours that have ended with them."""
    if not minutes:
        return
    last_ns = _extreme(session, func.max, MINUTE_S)
    _put(session, minutes, last_ns)
    touched = {begin(part.began_ns, HOUR_S) for part in minutes}
    present_ns = max(touched)
    if last_ns is not None:
        # Nothing may have come in an hour's last minutes, or no dispatcher was running. One that is
        # there was made before its minutes were deleted.
        if not _is_stored(session, HOUR_S, begin(last_ns, HOUR_S)):
            touched.add(begin(last_ns, HOUR_S))
        present_ns = max(present_ns, begin(last_ns, HOUR_S))
    for hour_ns in sorted(touched - {present_ns}):
        _make_hour(session, hour_ns)


def _put(session: Session, rollups: Iterable[RollUp], known_until_ns: int | None) -> None:
    """Store roll-ups; what is stored of the same segments and periods is merged with them.

    Args:
        rollups: of one length of period.
        known_until_ns: nothing is stored of periods that begin later; None: nothing at all.
    """
    new = merged(rollups)
    if not new:
        return
    numbers = segments.ids(session, {part.segment for part in new})
    rows = []
    for (period_s, began_ns), group in groupby(new, lambda part: (part.period_s, part.began_ns)):
        may_be_stored = known_until_ns is not None and began_ns <= known_until_ns
        stored = {
            known.segment: known
            for known in (at(session, period_s, began_ns) if may_be_stored else ())
        }
        for part in group:
            known = stored.get(part.segment)
            whole = part if known is None else merge((known, part))
            rows.append(_values(whole, numbers[part.segment]))
    session.execute(_upsert(session), rows)


def _make_hour(session: Session, began_ns: int) -> None:
    """Make the roll-ups of an hour from those of its minutes."""

    def mean(name: str, weight: str) -> ColumnElement[Any]:
        total = func.sum(_T[name] * _T[weight])
        return total / func.nullif(func.sum(_T[weight]), 0)

    values: dict[str, ColumnElement[Any]] = {
        "period_s": literal(HOUR_S),
        "began_ns": literal(began_ns, BigInteger),
        "segment_id": _T.segment_id,
        **{name: func.sum(_T[name]) for name in _COUNTS},
        "vehicles_mean": mean("vehicles_mean", "count"),
        "vehicles_max": func.max(_T.vehicles_max),
    }
    for feature in FEATURES:
        weight = "gaps" if feature == "mean_gap_m" else "measured"
        values[f"{feature}_mean"] = mean(f"{feature}_mean", weight)
        values[f"{feature}_min"] = func.min(_T[f"{feature}_min"])
        values[f"{feature}_max"] = func.max(_T[f"{feature}_max"])
    query = (
        select(*values.values())
        .where(
            _T.period_s == MINUTE_S,
            _T.began_ns >= began_ns,
            _T.began_ns < began_ns + HOUR_S * 10**9,
        )
        .group_by(_T.segment_id)
    )
    session.execute(_upsert(session, (list(values), query)))


def _upsert(session: Session, rows_of: tuple[Sequence[str], Select[Any]] | None = None) -> Insert:
    """An INSERT that takes the place of rows with the same key."""
    statement = insert_into(session, segment_rollups)
    changed = {c.name: c for c in statement.excluded if c.name not in _KEY}
    if rows_of is not None:
        statement = statement.from_select(*rows_of)
    found: Insert = statement.on_conflict_do_update(index_elements=list(_KEY), set_=changed)
    return found


def _extreme(session: Session, function: Any, period_s: int) -> int | None:
    """The least or largest begin of a period. One at a time, it is found by the key alone."""
    query: Select[Any] = select(function(_T.began_ns)).where(_T.period_s == period_s)
    found: int | None = session.scalar(query)
    return found


def _is_stored(session: Session, period_s: int, began_ns: int) -> bool:
    query = select(_T.segment_id).where(_T.period_s == period_s, _T.began_ns == began_ns).limit(1)
    return session.scalar(query) is not None


def at(session: Session, period_s: int, began_ns: int) -> list[RollUp]:
    """Roll-ups of all segments in one period."""
    names = segments.names(session)
    query = select(segment_rollups).where(_T.period_s == period_s, _T.began_ns == began_ns)
    return [_read(row, names[row[2]]) for row in session.execute(query)]


def of_segment(
    session: Session, segment: str, begin_ns: int, end_ns: int, period_s: int
) -> Iterator[RollUp]:
    """Roll-ups of one segment whose periods begin in a range of time, oldest first."""
    number = segments.number_of(session, segment)
    if number is None:
        return
    least = _extreme(session, func.min, period_s)
    largest = _extreme(session, func.max, period_s)
    if least is None or largest is None:
        return
    # Begins of periods are known, so that each row is found by its whole key.
    first = max(least, begin(begin_ns + period_s * 10**9 - 1, period_s))
    begins = range(first, min(largest + 1, end_ns), period_s * 10**9)
    for wanted in _each_of(session, begins):
        query = (
            select(segment_rollups)
            .where(_T.period_s == period_s, wanted, _T.segment_id == number)
            .order_by(_T.began_ns)
        )
        for row in session.execute(query):
            yield _read(row, segment)


def _each_of(session: Session, begins: range) -> Iterator[ColumnElement[bool] | TextClause]:
    """That a period begins at one of some times, for one statement or for several."""
    if begins and session.get_bind().dialect.name == "postgresql":
        # Times that the server counts: to send them costs more than to read their rows.
        yield text(
            "began_ns = ANY (ARRAY(SELECT generate_series(:first, :last, :step)))"
        ).bindparams(first=begins[0], last=begins[-1], step=begins.step)
        return
    for some in chunks(begins):
        yield _T.began_ns.in_(some)


def counts(session: Session, begin_ns: int, end_ns: int) -> dict[str, tuple[int, int]]:
    """States of each segment in the hours that begin in a range of time, and those with features.

    Of hours that have not ended yet it is what their stored minutes have.
    """
    names = segments.names(session)
    last_ns = _extreme(session, func.max, HOUR_S)
    minutes_from_ns = begin_ns if last_ns is None else max(begin_ns, last_ns + HOUR_S * 10**9)
    found: dict[str, tuple[int, int]] = {}
    for period_s, from_ns in ((HOUR_S, begin_ns), (MINUTE_S, minutes_from_ns)):
        query = (
            select(_T.segment_id, func.sum(_T["count"]), func.sum(_T.measured))
            .where(_T.period_s == period_s, _T.began_ns >= from_ns, _T.began_ns < end_ns)
            .group_by(_T.segment_id)
        )
        for number, came, measured in session.execute(query):
            before = found.get(names[number], (0, 0))
            found[names[number]] = before[0] + int(came), before[1] + int(measured)
    return found


def delete_oldest(session: Session, period_s: int, before_ns: int, rows: int) -> bool:
    """Delete the roll-ups of the oldest periods that ended before; False if there are none.

    Some ``rows`` of them: whole periods, or a part of the oldest one where it has more.
    """
    began_ns = _extreme(session, func.min, period_s)
    last_ns = before_ns - period_s * 10**9
    if began_ns is None or began_ns > last_ns:
        return False
    periods, of_period = rows // max(1, segments.count(session)), []
    upto_ns = min(last_ns, began_ns + max(0, periods - 1) * period_s * 10**9)
    if not periods:
        query = (
            select(_T.segment_id)
            .where(_T.period_s == period_s, _T.began_ns == began_ns)
            .order_by(_T.segment_id)
            .limit(rows)
        )
        of_period = [_T.segment_id <= session.scalars(query).all()[-1]]
    # PostgreSQL looks for the oldest one through all that is deleted and not yet cleared away.
    session.execute(
        delete(segment_rollups).where(
            _T.period_s == period_s, _T.began_ns >= began_ns, _T.began_ns <= upto_ns, *of_period
        )
    )
    return True


def delete_oldest_minute(session: Session, before_ns: int, rows: int) -> bool:
    """`delete_oldest` of minutes, with their hour made first if it is not: that is else done only
    when states come again.
    """
    began_ns = _extreme(session, func.min, MINUTE_S)
    if began_ns is not None and began_ns + MINUTE_S * 10**9 <= before_ns:
        hour_ns = begin(began_ns, HOUR_S)
        if not _is_stored(session, HOUR_S, hour_ns):
            _make_hour(session, hour_ns)
    return delete_oldest(session, MINUTE_S, before_ns, rows)


def delete_all_oldest(session: Session, before_ns: int, rows: int) -> bool:
    """`delete_oldest` of minutes and of hours; False if there are neither."""
    deleted = [delete_oldest(session, period_s, before_ns, rows) for period_s in (MINUTE_S, HOUR_S)]
    return any(deleted)


def _values(part: RollUp, number: int) -> Mapping[str, object]:
    values: dict[str, object] = {name: getattr(part, name) for name in _PLAIN}
    values |= {"period_s": part.period_s, "began_ns": part.began_ns, "segment_id": number}
    for feature in FEATURES:
        spread = part.features.get(feature)
        stored = (None, None, None) if spread is None else map(_real, spread)
        values |= {f"{feature}_{name}": value for name, value in zip(SPREAD, stored, strict=True)}
    return values


def _real(value: float) -> float:
    """The value in the range of REAL: PostgreSQL refuses what is nearer to 0, and larger ones."""
    return 0.0 if abs(value) < _MIN_REAL else max(-_MAX_REAL, min(_MAX_REAL, value))


def _read(row: Row[Any], segment: str) -> RollUp:
    """A roll-up from its row, whose columns come in the order of the table."""
    period_s, began_ns, _, *values = tuple(row)
    places = range(len(_PLAIN), len(values), len(SPREAD))
    features = {
        feature: Spread(*values[place : place + len(SPREAD)])
        for feature, place in zip(FEATURES, places, strict=True)
        if values[place] is not None
    }
    plain = dict(zip(_PLAIN, values, strict=False))
    return RollUp(segment, period_s, began_ns, **plain, features=features)
