"""What RSUs send: states, checked, counted, kept for cycles and roll-ups; the vehicles that they
counted; and their health.
"""

from __future__ import annotations

import logging
import threading
import time

from dispatcher_daemon import metrics
from dispatcher_daemon.service.dispatcher.publishing import Announce
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import (
    HARMLESS,
    MAX_RSUS,
    LatestStates,
    TrafficSnapshot,
    Verdict,
    traffic_by,
)
from slipstream.errors import InputError
from slipstream.freshness import age_s, is_ahead
from slipstream.messages import (
    RsuHealth,
    SegmentCounts,
    SegmentState,
    counts_key,
    decode,
    rsu_health_key,
    state_key,
)
from slipstream.roads import RoadNetwork
from slipstream.roads.admission import implausibility, refusal
from slipstream.service import LogLimiter
from slipstream.service.tracing import is_on, note, sparse_span, traced
from storage import Database, RollUpBuffer

log = logging.getLogger(__name__)

FORGOTTEN_S = 86_400.0
"""An unlisted RSU that has been silent for so long is none any more, s."""
COUNTS_OLD_S = 86_400.0
"""Counts that ended longer ago are refused: an RSU keeps those of an hour, s."""
MAX_COUNTS = 20_000
"""Quarter hours that wait to be stored, and RSUs and segments whose last one is known."""
_NAMED_STATES = 1000
"""States that a trace names."""


class StateReceiver:
    """Takes in states on the bus's thread; cycles take snapshots of them on theirs.

    Attributes:
        bad_messages: messages that were not what their key promises.
    """

    def __init__(
        self, network: RoadNetwork, settings: DispatcherSettings, announce: Announce
    ) -> None:
        self._network, self._settings, self._announce = network, settings, announce
        self.latest = LatestStates(
            network, rsus=settings.rsus, stale_after_s=settings.stale_after_s
        )
        reception = self.latest.reception
        metrics.RECEPTION.figures = reception.figures
        metrics.RECEPTION.own = lambda: (reception.stops, reception.missed_here)
        self._counts = {verdict: metrics.STATES.labels(verdict.value) for verdict in Verdict}
        self._rollups = RollUpBuffer()
        self._limiter = LogLimiter()
        self.received = 0
        self.refused = 0
        self.bad_messages = 0
        # The one heard last at the end.
        self._healths: dict[str, tuple[int, RsuHealth]] = {}
        self._health_lock = threading.Lock()
        self._counted: dict[tuple[str, str], SegmentCounts] = {}
        self._unstored: list[SegmentCounts] = []
        self._counts_lock = threading.Lock()

    def on_state(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_STATES`; what is not a SegmentState is counted."""
        try:
            state = decode(SegmentState, payload, key)
            if state_key(state.rsu, state.segment) != key:
                raise InputError(key, "not the RSU or segment of its key", "check the sender")
        except InputError as error:
            self.refuse(error)
            return
        self.received += 1
        now_ns = time.time_ns()
        with sparse_span("receive", rsu=state.rsu, segment=state.segment, sequence=state.sequence):
            verdict = self.latest.accept(state, now_ns)
        self._counts[verdict].inc()
        if verdict is Verdict.ACCEPTED:
            metrics.STATE_AGE.observe(max(0.0, age_s(state.time_ns, now_ns)))
            self._announce("state", state)
            self._rollups.add(state)
        if verdict not in HARMLESS:
            self.refused += 1
            what = verdict.value.replace("_", " ")
            if verdict is Verdict.IMPLAUSIBLE:
                what += f", {implausibility(state, self._network.segments[state.segment])}"
            self._limiter.warn(log, verdict.value, f"{key}: state refused: {what}")

    def on_counts(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_COUNTS`."""
        try:
            counts = decode(SegmentCounts, payload, key)
            if counts_key(counts.rsu, counts.segment) != key:
                raise InputError(key, "not the RSU or segment of its key", "check the sender")
            if not counts.complete:
                raise InputError(key, "its quarter hour is not over", "check the sender")
        except InputError as error:
            self.refuse(error)
            return
        now_ns = time.time_ns()
        refused = refusal(counts, self._network, self._settings.rsus)
        why = None if refused is None else refused.text
        if is_ahead(counts.until_ns, now_ns):
            why = "its quarter hour lies ahead"
        elif age_s(counts.until_ns, now_ns) > COUNTS_OLD_S:
            why = "its quarter hour is long over"
        if why is not None:
            metrics.COUNTS.labels("refused").inc()
            self._limiter.warn(log, "counts", f"{key}: counts refused: {why}")
            return
        metrics.COUNTS.labels("accepted").inc()
        place = counts.segment, counts.rsu
        with self._counts_lock:
            held = self._counted.get(place)
            if held is None or counts.began_ns >= held.began_ns or is_ahead(held.until_ns, now_ns):
                self._counted[place] = counts
            self._unstored.append(counts)
            del self._unstored[:-MAX_COUNTS]
            if len(self._counted) > MAX_COUNTS:
                del self._counted[next(iter(self._counted))]

    def counts(self) -> tuple[SegmentCounts, ...]:
        """The last complete quarter hour of each segment by each RSU."""
        with self._counts_lock:
            return tuple(self._counted.values())

    def on_health(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_RSU_HEALTH`."""
        try:
            health = decode(RsuHealth, payload, key)
            if rsu_health_key(health.rsu) != key:
                raise InputError(key, "not the RSU of its key", "check the sender")
        except InputError as error:
            self.refuse(error)
            return
        rsus = self._settings.rsus
        if rsus is not None and health.rsu not in rsus:
            return
        with self._health_lock:
            self._healths.pop(health.rsu, None)
            self._healths[health.rsu] = time.time_ns(), health
            if len(self._healths) > MAX_RSUS:
                del self._healths[next(iter(self._healths))]

    def healths(self) -> dict[str, tuple[int, RsuHealth]]:
        """When each RSU was heard last, UTC, and what it said; unlisted ones are forgotten after
        `FORGOTTEN_S`.
        """
        oldest_ns = time.time_ns() - round(FORGOTTEN_S * 1e9)
        with self._health_lock:
            if self._settings.rsus is None:
                self._healths = {r: one for r, one in self._healths.items() if one[0] > oldest_ns}
            return dict(self._healths)

    def refuse(self, error: InputError) -> None:
        """Count a message that is not what its key promises."""
        self.bad_messages += 1
        metrics.BAD_MESSAGES.inc()
        self._limiter.warn(log, "bad message", str(error))

    @traced("snapshot")
    def snapshot(self, now_ns: int) -> TrafficSnapshot:
        """The traffic of a cycle."""
        snapshot = traffic_by(self._settings, self._network, self.latest.latest(), now_ns)
        metrics.GATES_OPEN.set(sum(gate.open for gate in snapshot.gates()))
        if is_on():
            # What the spans of the edge that published them are found by.
            named = [f"{s.rsu} {s.segment} {s.sequence}" for s in snapshot.states[:_NAMED_STATES]]
            note(states=named)
        return snapshot

    def store_rollups(self, store: Database, now_ns: int | None = None) -> None:
        """Store what was reported in the minutes that have ended, None: in those begun, too; and
        the quarter hours that were counted.

        Plans do not wait for it, and what cannot be stored is tried again after the next cycle.
        """
        self._store_counts(store)
        minutes = self._rollups.take(now_ns)
        if not minutes:
            return
        try:
            store.add_rollups(minutes)
        except Exception as error:
            dropped = self._rollups.give_back(minutes)
            more = f", {dropped} of them are dropped" if dropped else ""
            line = f"{len(minutes)} roll-ups could not be stored{more}: {error}"
            self._limiter.warn(log, "rollups", line)

    def _store_counts(self, store: Database) -> None:
        with self._counts_lock:
            waiting, self._unstored = self._unstored, []
        if not waiting:
            return
        try:
            store.add_counts(waiting)
        except Exception as error:
            with self._counts_lock:
                self._unstored = [*waiting, *self._unstored][-MAX_COUNTS:]
            self._limiter.warn(
                log, "storing counts", f"{len(waiting)} counts could not be stored: {error}"
            )
