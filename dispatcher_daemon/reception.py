"""How the states of each RSU arrive: missed, twice, late, and by which clock."""

from __future__ import annotations

import statistics
import threading
from collections import OrderedDict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from slipstream.freshness import FUTURE_TOLERANCE_S

MAX_RSUS: Final = 10_000
"""RSUs that are counted; beyond them the one that has been silent for longest is forgotten."""
MAX_JUMP: Final = 100_000
"""A sequence number further ahead than this belongs to another run of the RSU."""
_TOLERANCE_NS: Final = round(FUTURE_TOLERANCE_S * 1e9)
DELAYS: Final = 64
"""Latest states of an RSU that its delays are judged by."""


@dataclass(frozen=True)
class Reception:
    """What has become of one RSU's states since it was first heard.

    Attributes:
        received: states with a new sequence number.
        missed: sequence numbers that never came: dropped on the way, superseded by a later state
            of their segment before they were handled, or refused as perhaps not its own.
        duplicates: states that came twice.
        out_of_order: states older than one of their segment that had come before.
        delay_s: median of arrival less the state's time, of the latest `DELAYS`; below 0: its clock
            is ahead. None: no state was in order.
        delay_spread_s: interquartile range of the same; None likewise.
    """

    received: int
    missed: int
    duplicates: int
    out_of_order: int
    delay_s: float | None
    delay_spread_s: float | None


@dataclass
class _Record:
    """Counts of one RSU; sequence numbers as in RFC 3550, A.3, anew after a restart."""

    first: int
    highest: int
    newest_ns: int
    received: int = 0
    missed_before: int = 0
    received_before: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    delays_s: deque[float] = field(default_factory=lambda: deque(maxlen=DELAYS))

    @property
    def missed(self) -> int:
        return self.missed_before + max(0, self.highest - self.first + 1 - self.received)

    def count(self, sequence: int, time_ns: int) -> None:
        """Count a state that has not come before."""
        restarted = sequence <= self.highest and time_ns > self.newest_ns
        if restarted or abs(sequence - self.highest) > MAX_JUMP:
            self.missed_before = self.missed
            self.received_before += self.received
            self.first = self.highest = sequence
            self.received = 0
        self.highest = max(self.highest, sequence)
        self.newest_ns = max(self.newest_ns, time_ns)
        # One from before the first that was heard fills no gap.
        self.received += sequence >= self.first


def _believed_ns(time_ns: int, arrived_ns: int) -> int:
    """A state's time, as far as it is not ahead: a clock wrong once must not hide restarts.

    A clock that is ahead within the tolerance stays as it is: with its states cut to their arrival
    each late one would be a restart.
    """
    return min(time_ns, arrived_ns + _TOLERANCE_NS)


class ReceptionTable:
    """Reception of each RSU; safe for threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._records: OrderedDict[str, _Record] = OrderedDict()

    def count(
        self, rsu: str, sequence: int, time_ns: int, delay_s: float, *, out_of_order: bool
    ) -> None:
        """Count a state that has come for the first time.

        Args:
            rsu: its sender.
            sequence: its number.
            time_ns: its time, UTC.
            delay_s: arrival less its time.
            out_of_order: a later one of its segment has come before.
        """
        with self._lock:
            time_ns = _believed_ns(time_ns, time_ns + round(delay_s * 1e9))
            record = self._record(rsu, sequence, time_ns)
            record.count(sequence, time_ns)
            if out_of_order:
                record.out_of_order += 1
            else:
                record.delays_s.append(delay_s)

    def count_duplicate(self, rsu: str, sequence: int, time_ns: int) -> None:
        """Count a state that has come before."""
        with self._lock:
            self._record(rsu, sequence, time_ns).duplicates += 1

    def _record(self, rsu: str, sequence: int, time_ns: int) -> _Record:
        record = self._records.get(rsu)
        if record is None:
            if len(self._records) >= MAX_RSUS:
                self._records.popitem(last=False)
            record = self._records[rsu] = _Record(sequence, sequence, time_ns)
        self._records.move_to_end(rsu)
        return record

    def figures(self) -> Iterator[tuple[str, Reception]]:
        """(RSU, its reception) of all, by name."""
        with self._lock:
            # Sorted outside: a scrape must not hold up states.
            copies = [
                (
                    rsu,
                    record.received_before + record.received,
                    record.missed,
                    record.duplicates,
                    record.out_of_order,
                    tuple(record.delays_s),
                )
                for rsu, record in self._records.items()
            ]
        for rsu, received, missed, duplicates, out_of_order, delays in sorted(copies):
            delay_s, spread_s = _median_and_spread(delays)
            yield rsu, Reception(received, missed, duplicates, out_of_order, delay_s, spread_s)


def _median_and_spread(delays: tuple[float, ...]) -> tuple[float | None, float | None]:
    if len(delays) < 2:
        return (delays[0], 0.0) if delays else (None, None)
    lower, median, upper = statistics.quantiles(delays, n=4, method="inclusive")
    return median, upper - lower
