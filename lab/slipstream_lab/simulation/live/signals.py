"""The signals of a live world on the bus: their timing, and answers to requests."""

from __future__ import annotations

import queue
from collections.abc import Iterable

from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.messages import (
    ALL_SIGNAL_REQUESTS,
    MovementEvent,
    MovementState,
    SignalPhaseAndTiming,
    SignalRequest,
    decode,
    signal_request_key,
    signal_status_key,
    spat_key,
)
from slipstream_lab.simulation.signals import SignalController


class LiveSignals:
    """Signals that tell their timing to whom it may concern.

    The simulation counts from midnight; on the bus times are UTC.
    """

    def __init__(
        self, bus: Bus, controller: SignalController, intersections: Iterable[str]
    ) -> None:
        self._controller = controller
        names = tuple(intersections)
        self._spat = {name: bus.publisher(spat_key(name), history=0) for name in names}
        self._status = {name: bus.publisher(signal_status_key(name), history=0) for name in names}
        self._told: dict[str, SignalPhaseAndTiming] = {}
        self._requests: queue.SimpleQueue[SignalRequest] = queue.SimpleQueue()
        bus.subscribe(ALL_SIGNAL_REQUESTS, self._on_request, history=False)

    def step(self, now_s: float, offset_ns: int) -> None:
        """Act on what was asked, and tell what has changed where somebody listens."""
        while not self._requests.empty():
            request = self._requests.get_nowait()
            self._controller.receive(_in_world_time(request, offset_ns), now_s)
        for status in self._controller.step(now_s):
            told = status.model_copy(update={"time_ns": status.time_ns + offset_ns})
            self._status[status.intersection].put(told)
        for name, outlet in self._spat.items():
            if outlet.has_subscribers():
                spat = self._controller.spat(name, now_s)
                if self._told.get(name) is not spat:
                    self._told[name] = spat
                    outlet.put(in_utc(spat, offset_ns))

    def _on_request(self, key: str, payload: bytes) -> None:
        try:
            request = decode(SignalRequest, payload, key)
        except InputError:
            return
        if signal_request_key(request.intersection, request.vehicle) == key:
            self._requests.put(request)


def in_utc(spat: SignalPhaseAndTiming, offset_ns: int) -> SignalPhaseAndTiming:
    """A SPAT of the simulation with its times in UTC."""

    def moved(time_ns: int) -> int:
        return max(0, time_ns + offset_ns)

    movements = tuple(
        MovementState(
            signal_group=movement.signal_group,
            events=tuple(
                MovementEvent(
                    state=event.state,
                    start_ns=moved(event.start_ns),
                    min_end_ns=moved(event.min_end_ns),
                    max_end_ns=None if event.max_end_ns is None else moved(event.max_end_ns),
                )
                for event in movement.events
            ),
        )
        for movement in spat.movements
    )
    return spat.model_copy(update={"time_ns": moved(spat.time_ns), "movements": movements})


def _in_world_time(request: SignalRequest, offset_ns: int) -> SignalRequest:
    times = ("time_ns", "arrival_ns", "through_ns")
    return request.model_copy(
        update={name: max(0, getattr(request, name) - offset_ns) for name in times}
    )
