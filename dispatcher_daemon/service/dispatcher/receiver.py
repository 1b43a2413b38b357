"""What RSUs send: states, checked, counted, kept for cycles and roll-ups; and their health."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from dispatcher_daemon import metrics
from dispatcher_daemon.service.dispatcher.publishing import Announce
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import HARMLESS, LatestStates, TrafficSnapshot, Verdict, traffic_by
from slipstream.errors import InputError
from slipstream.freshness import age_s
from slipstream.messages import RsuHealth, SegmentState, decode, rsu_health_key, state_key
from slipstream.roads import RoadNetwork
from slipstream.roads.admission import implausibility
from slipstream.service import LogLimiter
from slipstream.service.tracing import is_on, note, sparse_span, traced
from storage import RollUp, RollUpBuffer

log = logging.getLogger(__name__)

_NAMED_STATES = 1000
"""States that a trace names."""


class RollUpStore(Protocol):
    """What is needed of the database here."""

    def add_rollups(self, minutes: Sequence[RollUp]) -> None:
        """Store what was reported of segments, by minute."""
        ...


class StateReceiver:
    """Takes in states on the bus's thread; cycles take snapshots of them on theirs.

    Args:
        network: roads.
        settings: of the dispatcher.
        announce: told of accepted states.

    Attributes:
        latest: the latest states.
        received: states read.
        refused: states read and not admitted.
        bad_messages: messages that were not what their key promises.
        health_to: told of each RSU's health.
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
        self.health_to: list[Callable[[RsuHealth], None]] = []

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

    def on_health(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_RSU_HEALTH`, and tell who wants to know of it."""
        try:
            health = decode(RsuHealth, payload, key)
            if rsu_health_key(health.rsu) != key:
                raise InputError(key, "not the RSU of its key", "check the sender")
        except InputError as error:
            self.refuse(error)
            return
        for tell in self.health_to:
            tell(health)

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

    def store_rollups(self, store: RollUpStore, now_ns: int | None = None) -> None:
        """Store what was reported in the minutes that have ended; None: in those begun, too.

        Plans do not wait for it, and what cannot be stored is tried again after the next cycle.
        """
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
