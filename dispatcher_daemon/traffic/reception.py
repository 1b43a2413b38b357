"""How the states of each RSU arrive: missed, twice, late, and by which clock."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from statistics import quantiles
from typing import Final, NamedTuple

from slipstream.freshness import FUTURE_TOLERANCE_S

MAX_RSUS: Final = 10_000
"""RSUs that are counted; beyond them the one that has been silent for longest is forgotten."""
MAX_JUMP: Final = 100_000
"""A sequence number further ahead than this belongs to another run of the RSU."""
_TOLERANCE_NS: Final = round(FUTURE_TOLERANCE_S * 1e9)
STOPPED_S: Final = 5.0
"""Between two beats, which come each second: from so long on this process itself stood still, s."""
SETTLE_S: Final = 10.0
"""After that: what waited meanwhile arrives, or turns out to be missed, s."""
DELAYS: Final = 64
"""Latest states of an RSU that its delays are judged by."""


class Reception(NamedTuple):
    """What has become of one RSU's states since it was first heard.

    Attributes:
        received: states with a new sequence number.
        missed: sequence numbers that never came: dropped on the way, superseded by a later state
            of their segment before they were handled, or refused as perhaps not its own. Those of
            a time when this process stood still do not count.
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
class _ReceptionRecord:
    """Counts of one RSU; sequence numbers as in RFC 3550, A.3, anew after a restart."""

    first: int
    highest: int
    newest_ns: int
    received: int = 0
    missed_before: int = 0
    missed_here: int = 0
    received_before: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    delays_s: deque[float] = field(default_factory=lambda: deque(maxlen=DELAYS))
    told: Reception | None = None
    """Its figures; None: something has been counted since they were asked for."""

    @property
    def missed(self) -> int:
        return max(0, self.all_missed - self.missed_here)

    @property
    def all_missed(self) -> int:
        """With those that this process missed as it stood still."""
        return self.missed_before + max(0, self.highest - self.first + 1 - self.received)

    def figures(self) -> Reception:
        """What is told of it."""
        if self.told is None:
            self.told = Reception(
                self.received_before + self.received,
                self.missed,
                self.duplicates,
                self.out_of_order,
                *_median_and_spread(self.delays_s),
            )
        return self.told

    def count(self, sequence: int, time_ns: int) -> None:
        """Count a state that has not come before."""
        restarted = sequence <= self.highest and time_ns > self.newest_ns
        if restarted or abs(sequence - self.highest) > MAX_JUMP:
            self.missed_before = self.all_missed
            self.received_before += self.received
            self.first = self.highest = sequence
            self.received = 0
        self.highest = max(self.highest, sequence)
        self.newest_ns = max(self.newest_ns, time_ns)
        # One from before the first that was heard fills no gap.
        self.received += sequence >= self.first


def _believed_ns(time_ns: int, arrived_ns: int) -> int:
    """A state's time, as far as it is not ahead: a wrong clock must not hide restarts later.

    A clock that is ahead within the tolerance stays as it is: with its states cut to their arrival
    each late one would be a restart.
    """
    return min(time_ns, arrived_ns + _TOLERANCE_NS)


class ReceptionTable:
    """Reception of each RSU; safe for threads.

    Attributes:
        stops: times that this process stood still, as its beats show.
        missed_here: states that were missed because of that.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._lock = threading.Lock()
        self._clock = clock
        self._beat_s: float | None = None
        self._settled_s: float | None = None
        self.stops = 0
        self.missed_here = 0
        self._records: OrderedDict[str, _ReceptionRecord] = OrderedDict()

    def count(
        self, rsu: str, sequence: int, time_ns: int, delay_s: float, *, out_of_order: bool
    ) -> None:
        """Count a state that has come for the first time.

        Args:
            out_of_order: a later one of its segment has come before.
        """
        with self._lock:
            time_ns = _believed_ns(time_ns, time_ns + round(delay_s * 1e9))
            record = self._record(rsu, sequence, time_ns)
            before = record.all_missed
            record.count(sequence, time_ns)
            settling = self._is_settling()
            if settling:
                # A late state fills a gap that was counted as one of this process.
                more = max(record.all_missed - before, -record.missed_here)
                record.missed_here += more
                self.missed_here += more
            if out_of_order:
                record.out_of_order += 1
            elif not settling:
                record.delays_s.append(delay_s)

    def count_duplicate(self, rsu: str, sequence: int, time_ns: int) -> None:
        """Count a state that has come before."""
        with self._lock:
            self._record(rsu, sequence, time_ns).duplicates += 1

    def beat(self) -> None:
        """To be called each second: a longer gap says that this process stood still."""
        with self._lock:
            self._is_settling()
            self._beat_s = self._clock()

    def _is_settling(self) -> bool:
        """Whether what is missed now is perhaps missed because this process stood still."""
        if self._beat_s is None:
            return False
        now_s = self._clock()
        if now_s - self._beat_s >= STOPPED_S:
            # States may come before the next beat.
            self._beat_s, self._settled_s = now_s, now_s + SETTLE_S
            self.stops += 1
        return self._settled_s is not None and now_s < self._settled_s

    def _record(self, rsu: str, sequence: int, time_ns: int) -> _ReceptionRecord:
        record = self._records.get(rsu)
        if record is None:
            if len(self._records) >= MAX_RSUS:
                self._records.popitem(last=False)
            record = self._records[rsu] = _ReceptionRecord(sequence, sequence, time_ns)
        self._records.move_to_end(rsu)
        record.told = None
        return record

    def figures(self) -> Iterator[tuple[str, Reception]]:
        """(RSU, its reception) of all, by name; made anew of those that something came from."""
        with self._lock:
            names = list(self._records)
        for rsu in sorted(names):
            # Locked for one after the other: a scrape must not hold up states.
            with self._lock:
                record = self._records.get(rsu)
                found = None if record is None else record.figures()
            if found is not None:
                yield rsu, found


def _median_and_spread(delays_s: Sequence[float]) -> tuple[float | None, float | None]:
    """Median and interquartile range."""
    if len(delays_s) < 2:
        return (delays_s[0], 0.0) if delays_s else (None, None)
    lower_s, median_s, upper_s = quantiles(delays_s, n=4, method="inclusive")
    return median_s, upper_s - lower_s
