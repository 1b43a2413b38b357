"""The latest state of each segment from each RSU that watches it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from dispatcher_daemon.traffic.reception import ReceptionTable
from slipstream import freshness
from slipstream.freshness import STALE_AFTER_S
from slipstream.messages import SegmentState
from slipstream.roads import RoadNetwork
from slipstream.roads.admission import refusal

MAX_RSUS_PER_SEGMENT: Final = 16
FORGOTTEN_AFTER: Final = 6.0
"""Times the age limit after which a silent RSU's place may be taken by another one."""


class Verdict(StrEnum):
    """Whether a received state is accepted, or why not."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
    OUT_OF_ORDER = "out_of_order"
    FUTURE = "future"
    UNKNOWN_SEGMENT = "unknown_segment"
    UNLISTED = "unlisted"
    IMPLAUSIBLE = "implausible"
    TOO_MANY_RSUS = "too_many_rsus"


HARMLESS: Final = frozenset({Verdict.ACCEPTED, Verdict.DUPLICATE, Verdict.OUT_OF_ORDER})
"""Verdicts on states that are in order, or that a repair of the bus has sent again."""

_OF_ITS_RSU: Final = frozenset(
    {Verdict.ACCEPTED, Verdict.OUT_OF_ORDER, Verdict.FUTURE, Verdict.IMPLAUSIBLE}
)
"""Verdicts on states that came from their RSU; so does one too many of a listed RSU.

The others may be anybody's: their sequence numbers count as missed.
"""


class LatestStates:
    """Latest state of each (segment, rsu); written by the bus's thread, read by the cycle's.

    States are ordered by their time, not by their sequence number, which starts again when an RSU
    does. Its size is bounded by the network's segments and `MAX_RSUS_PER_SEGMENT`.

    Args:
        rsus: the segments that each RSU may report on; None: any RSU may report on any segment.
    """

    def __init__(
        self,
        network: RoadNetwork,
        *,
        rsus: Mapping[str, tuple[str, ...]] | None = None,
        stale_after_s: float = STALE_AFTER_S,
    ) -> None:
        self._network = network
        # RSUs may watch hundreds of segments.
        self._rsus = None if rsus is None else {k: frozenset(ids) for k, ids in rsus.items()}
        self._forgotten_after_s = FORGOTTEN_AFTER * stale_after_s
        self.reception = ReceptionTable()
        self._lock = threading.Lock()
        self._latest: dict[str, dict[str, SegmentState]] = {}

    def accept(self, state: SegmentState, now_ns: int) -> Verdict:
        """Take in one state, unless a verdict speaks against it; count it for its RSU."""
        verdict = self._take(state, now_ns)
        if verdict is Verdict.DUPLICATE:
            self.reception.count_duplicate(state.rsu, state.sequence, state.time_ns)
        elif verdict in _OF_ITS_RSU or (
            verdict is Verdict.TOO_MANY_RSUS and self._rsus is not None
        ):
            self.reception.count(
                state.rsu,
                state.sequence,
                state.time_ns,
                freshness.age_s(state.time_ns, now_ns),
                out_of_order=verdict is Verdict.OUT_OF_ORDER,
            )
        return verdict

    def _take(self, state: SegmentState, now_ns: int) -> Verdict:
        refused = refusal(state, self._network, self._rsus)
        if refused is not None:
            return Verdict(refused.kind)
        if freshness.is_ahead(state.time_ns, now_ns):
            return Verdict.FUTURE
        with self._lock:
            rsus = self._latest.setdefault(state.segment, {})
            held = rsus.get(state.rsu)
            if held is None and len(rsus) >= MAX_RSUS_PER_SEGMENT:
                self._forget_silent(rsus, now_ns)
                if len(rsus) >= MAX_RSUS_PER_SEGMENT:
                    return Verdict.TOO_MANY_RSUS
            # A clock that was set back leaves a held state in the future; it must not block.
            if held is not None and not freshness.is_ahead(held.time_ns, now_ns):
                if (state.time_ns, state.sequence) == (held.time_ns, held.sequence):
                    return Verdict.DUPLICATE
                if state.time_ns <= held.time_ns:
                    return Verdict.OUT_OF_ORDER
            rsus[state.rsu] = state
            return Verdict.ACCEPTED

    def _forget_silent(self, rsus: dict[str, SegmentState], now_ns: int) -> None:
        for rsu, held in list(rsus.items()):
            old = freshness.age_s(held.time_ns, now_ns) > self._forgotten_after_s
            if old or freshness.is_ahead(held.time_ns, now_ns):
                del rsus[rsu]

    def latest(self) -> tuple[SegmentState, ...]:
        """All held states, for `dispatcher_daemon.traffic.snapshot.take_snapshot`."""
        with self._lock:
            return tuple(state for rsus in self._latest.values() for state in rsus.values())

    def of(self, segment: str) -> tuple[SegmentState, ...]:
        """The held states of one segment, by RSU."""
        with self._lock:
            rsus = self._latest.get(segment, {})
            return tuple(rsus[name] for name in sorted(rsus))

    def segments(self) -> tuple[str, ...]:
        """Segments that some RSU has reported on, by id."""
        with self._lock:
            return tuple(sorted(self._latest))
