"""What keeps the database small: deletion by age and size, in small transactions."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from slipstream.errors import InputError
from storage import retention
from storage.models import CycleRow
from storage.records import energy_ledger, events, fleet, inputs, jobs
from storage.traffic import counts, gates, recent, rollup_table
from storage.writer import Writer

MIN_JOB_DAYS: Final = 2.0
"""Quantum jobs are kept for at least this long, days: a day's budget is computed from them."""
MAX_STEPS: Final = 4
"""Steps of `retention.BATCH_BYTES` in which the running dispatcher's file shrinks after a cycle."""
STATES_KEPT_H: Final = 24.0
"""States and gates of cycles are kept as they came for this long, h; then only as roll-ups of the
states and changes of the gates."""
MINUTES_KEPT_H: Final = 48.0
"""Roll-ups of minutes are kept for this long, h; those of hours as long as cycles."""

_HOUR_NS: Final = 3600e9


class Upkeep(Writer):
    """The part of the database that deletes. Where a method fails (`StorageError`), what it has
    deleted by then stays deleted.
    """

    _used_pages: int | None = None
    _segment = 0
    """Number of the last segment whose old gates were deleted."""
    _step = 0
    """Place of the kind of step that `tidy` begins with."""

    def trust_clock(self, now_ns: int) -> None:
        """Take ``now_ns``, UTC, for the time, however far ahead of the cycles it is."""
        with self._write_session() as session:
            retention.set_time(session, now_ns)

    def note_time(self, now_ns: int) -> None:
        """Move the trusted time on to ``now_ns``, UTC, as a cycle does, where none is recorded."""
        with self._write_session() as session:
            retention.note_time(session, now_ns)

    def prune(
        self,
        keep_days: float,
        now_ns: int,
        *,
        limit: int | None = None,
        budget_s: float | None = None,
    ) -> int:
        """Delete cycles that began more than ``keep_days`` before ``now_ns``; returns how many.

        The latest cycle always stays, so that cycle numbers never start again. Quantum jobs that
        finished before then are deleted too, but none of the last `MIN_JOB_DAYS`; so are orders
        that ended before then and are in no fleet file any more.

        Args:
            keep_days: age limit, days.
            limit: maximum number of cycles to delete, oldest first; None: no maximum.
            budget_s: after this time no transaction but the first begins; None: until all is done.

        Raises:
            InputError: ``keep_days`` is negative or not finite.
            UntrustedClockError: ``now_ns`` is too far ahead of the cycles; nothing is deleted.
        """
        self._check_limit("keep_days", keep_days, "number of days")
        ends = math.inf if budget_s is None else time.monotonic() + budget_s
        # No cycle began before 1970, and SQLite takes no number beyond 64 bits.
        before_ns = max(0, now_ns - int(min(keep_days * 86_400e9, 2.0**63)))
        jobs_before_ns = min(before_ns, max(0, now_ns - int(MIN_JOB_DAYS * 86_400e9)))
        with self._write_session() as session:
            retention.check_clock(session, now_ns, self._source)
            jobs.prune(session, jobs_before_ns)
            below = retention.first_kept(session, before_ns, now_ns)
        more = True
        while more:
            with self._write_session() as session:
                more = fleet.prune(session, before_ns, fleet.ORDERS_A_STEP)
            more = more and time.monotonic() < ends
        pruned, batch = 0, self._batch(self._pages() if self._is_sqlite else None)
        # One batch at least, so that none deleted means none left.
        while below is not None and pruned != limit and (not pruned or time.monotonic() < ends):
            wanted = batch if limit is None else min(batch, limit - pruned)
            with self._write_session() as session:
                count = retention.delete_cycles(session, wanted, below, before_ns)
            pruned += count
            if limit is None:
                self.shrink()
            if count < wanted:
                break
        return pruned

    def trim(self, keep_mb: float, *, limit: int | None = None) -> int:
        """Delete the oldest cycles until the database fits into ``keep_mb``; returns how many.

        What counts of SQLite is the file, a full write-ahead log and the reserve file; of
        PostgreSQL what the rows that are left take, about. The latest cycle always stays. An SQLite
        file itself shrinks in a few small steps a call if ``limit`` is given, else by `shrink`;
        PostgreSQL keeps the room of deleted rows for new ones.

        Args:
            keep_mb: limit of size, MB (10^6 bytes).
            limit: maximum number of cycles to delete; None: no maximum. Of an SQLite database more
                are deleted where that is less than twice of what was added since the last call.

        Raises:
            InputError: ``keep_mb`` is negative or not finite.
        """
        self._check_limit("keep_mb", keep_mb, "number of MB")
        pages = began = self._pages(keep_mb)
        grown = 0 if self._used_pages is None else began.used - self._used_pages
        wanted, trimmed, periods, batch = began.wanted(keep_mb), 0, 0, 0
        while pages.used > wanted:
            enough = limit is not None and max(trimmed, periods) >= limit
            if enough and began.used - pages.used >= 2 * grown:
                break
            with self._write_session() as session:
                outlived = _delete_before_first_cycle(session)
            periods += outlived
            if not outlived:
                batch = batch or min(self._batch(pages), limit or retention.PRUNE_BATCH)
                with self._write_session() as session:
                    latest = session.scalar(select(func.max(CycleRow.cycle))) or 0
                    count = retention.delete_cycles(session, batch, latest)
                if count == 0:
                    break
                trimmed += count
            if limit is None:
                self.shrink()
            pages = self._pages(keep_mb)
        if not self._is_sqlite:
            # What has come since is told by no estimate.
            return trimmed
        self._used_pages = pages.used
        if limit is not None:
            for _ in range(MAX_STEPS):
                few_free = pages.free <= 2 * retention.FREE_SHARE * pages.count
                if (few_free and pages.count <= began.limit(keep_mb)) or not self._give_back():
                    break
                pages = self._pages()
        return trimmed

    def tidy(self, now_ns: int, *, budget_s: float | None = None) -> bool:
        """Delete traffic that is too old, in small transactions.

        States as they came go after `STATES_KEPT_H`, minutes after `MINUTES_KEPT_H`, hours and
        changes of gates with the cycles, inputs of cycles after `inputs.KEEP_DAYS`.

        Args:
            budget_s: no step but the first begins after this time, and the next call goes on with
                the kind of step after the last one; None: until all is done.

        Returns:
            Whether the time was over before all that is too old was found deleted.

        Raises:
            UntrustedClockError: ``now_ns`` is too far ahead of the cycles; nothing is deleted.
        """
        ends = math.inf if budget_s is None else time.monotonic() + budget_s
        with self._write_session() as session:
            retention.check_clock(session, now_ns, self._source)
        states_ns, minutes_ns, inputs_ns = (
            max(0, now_ns - round(hours * _HOUR_NS))
            for hours in (STATES_KEPT_H, MINUTES_KEPT_H, 24 * inputs.KEEP_DAYS)
        )
        rows = rollup_table.ROWS_A_STEP
        steps: tuple[Callable[[Session], bool], ...] = (
            lambda session: rollup_table.delete_oldest_minute(session, minutes_ns, rows),
            _delete_before_first_cycle,
            lambda session: self._prune_gates(session) and budget_s is None,
            lambda session: recent.prune(session, states_ns, recent.CYCLES_A_STEP),
            lambda session: inputs.prune(session, inputs_ns, inputs.BATCH) == inputs.BATCH,
        )
        first, began, unfinished = self._step, False, False
        for place in range(first, first + len(steps)):
            more = True
            while more and (not began or time.monotonic() < ends):
                began = True
                # Before it is done: one that fails, or takes all the time, keeps no other from it.
                self._step = (place + 1) % len(steps)
                with self._write_session() as session:
                    more = steps[place % len(steps)](session)
            unfinished = unfinished or more
        return unfinished

    def _check_limit(self, key: str, value: float, what: str) -> None:
        if not (math.isfinite(value) and value >= 0):
            mend = f"give a {what}, 0 or more"
            raise InputError(self._source, f"{value} is no {what}", mend, key=key)

    def _prune_gates(self, session: Session) -> bool:
        """Delete what is too old of some segments; False after the last ones.

        The running dispatcher does so for some segments after each cycle.
        """
        first = session.scalar(select(func.min(CycleRow.cycle)))
        if first is not None:
            self._segment = gates.prune(session, first, self._segment, gates.SEGMENTS_A_STEP)
        return self._segment != 0 and first is not None

    def _forget(self) -> None:
        self._used_pages = None
        self._segment = 0


def _delete_before_first_cycle(session: Session) -> bool:
    """Delete the oldest roll-ups, hours of the energy ledger, counts and events before all cycles,
    some of each; False if there are none.
    """
    first_ns = session.scalar(select(func.min(CycleRow.started_ns)))
    if first_ns is None:
        return False
    deleted = [
        rollup_table.delete_all_oldest(session, first_ns, rollup_table.ROWS_A_STEP),
        energy_ledger.delete_oldest(session, first_ns, energy_ledger.ROWS_A_STEP),
        counts.delete_oldest(session, first_ns, counts.ROWS_A_STEP),
        events.delete_before(session, first_ns, events.BATCH),
    ]
    return any(deleted)
