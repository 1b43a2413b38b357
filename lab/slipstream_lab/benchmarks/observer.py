"""The daemons' health and state messages, with their times of arrival."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.messages import (
    ALL_RSU_HEALTH,
    ALL_STATES,
    DISPATCHER_HEALTH_KEY,
    DispatcherHealth,
    RsuHealth,
    SegmentState,
    decode,
)


@dataclass(frozen=True)
class StateArrival:
    """Arrival of a SegmentState: time since the soak began, and its age then, s."""

    at_s: float
    age_s: float


@dataclass
class BusObserver:
    """Collects messages from `listen` on."""

    clock: Callable[[], float]
    states: dict[str, list[StateArrival]] = field(default_factory=dict)
    rsus: dict[str, list[tuple[float, RsuHealth]]] = field(default_factory=dict)
    dispatcher: list[tuple[float, DispatcherHealth]] = field(default_factory=list)
    bad_messages: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def listen(self, bus: Bus) -> None:
        """Subscribe."""
        for key in (ALL_STATES, ALL_RSU_HEALTH, DISPATCHER_HEALTH_KEY):
            # Without history: the age of earlier messages would count as delay.
            bus.subscribe(key, self.take, history=False, every=True)

    def take(self, key: str, payload: bytes) -> None:
        """Record one message; invalid ones are counted."""
        at_s, now_ns = self.clock(), time.time_ns()
        with self._lock:
            try:
                if key.endswith("/state"):
                    state = decode(SegmentState, payload, key)
                    arrival = StateArrival(at_s, 1e-9 * (now_ns - state.time_ns))
                    self.states.setdefault(f"{state.rsu}/{state.segment}", []).append(arrival)
                elif key == DISPATCHER_HEALTH_KEY:
                    self.dispatcher.append((at_s, decode(DispatcherHealth, payload, key)))
                else:
                    health = decode(RsuHealth, payload, key)
                    self.rsus.setdefault(health.rsu, []).append((at_s, health))
            except InputError:
                self.bad_messages += 1
