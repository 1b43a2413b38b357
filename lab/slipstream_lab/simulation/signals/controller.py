"""The signal controllers of the running simulation as a whole: SPAT, requests, status."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

from slipstream.messages import (
    RequestStatus,
    SignalPhaseAndTiming,
    SignalRequest,
    SignalStatus,
)
from slipstream_lab.simulation.signals.open_requests import OpenRequest, OpenRequests
from slipstream_lab.simulation.signals.priority import Counts, Priority
from slipstream_lab.simulation.signals.priority_rules import PrioritySettings
from slipstream_lab.simulation.signals.timing import RunningSignals

_INTERVAL_S: Final = 1.0

_States = tuple[RequestStatus, ...]


class SignalController:
    """All signals of the running simulation; made when it runs.

    Each step: `spat` of the intersections that vehicles are near to, `receive` of what the
    vehicles sent, then `step`.

    Args:
        intersections: ids of the signals; requests to others are left out.
        grants: whether the city gives priority; if not, each request is rejected.
    """

    def __init__(
        self,
        intersections: Sequence[str],
        grants: bool,
        settings: PrioritySettings | None = None,
    ) -> None:
        self._intersections = frozenset(intersections)
        self._grants = grants
        self._signals = RunningSignals()
        self._requests = OpenRequests()
        self._priority = Priority(self._signals, settings)
        self._told: dict[str, _States] = {}
        self._sequences: dict[str, int] = {}
        self._next_s = -math.inf
        self._has_heard = False

    @property
    def counts(self) -> Counts:
        """Of requests and grants so far."""
        return self._priority.counts

    def spat(self, intersection: str, now_s: float) -> SignalPhaseAndTiming:
        """What an intersection tells at the simulation's time; call it for those that are needed.

        The same object as before needs no sending: it is younger than a second, and still holds.

        Raises:
            KeyError: no such intersection.
        """
        if intersection not in self._intersections:
            raise KeyError(intersection)
        return self._signals.spat(intersection, now_s)

    def receive(self, message: SignalRequest, now_s: float) -> None:
        """Take in a vehicle's request, update or cancellation."""
        if message.intersection in self._intersections:
            self.counts.requests += self._requests.receive(message, now_s)
            self._has_heard = True

    def step(self, now_s: float) -> tuple[SignalStatus, ...]:
        """Before each step: act on requests; the answers that have changed.

        It acts at once where something was heard, and a second after it acted last otherwise.
        """
        if now_s < self._next_s and not self._has_heard:
            return ()
        self._next_s, self._has_heard = now_s + _INTERVAL_S, False
        heard = self._requests.at(now_s)
        valid: dict[str, list[OpenRequest]] = {}
        if self._grants:
            for intersection, requests in heard.items():
                lanes = self._priority.detectors(intersection).lanes
                valid[intersection] = [r for r in requests if r.group in lanes]
            self._priority.step(now_s, valid)
        answers = []
        for intersection in sorted({*heard, *self._told}):
            paused = self._priority.is_paused(intersection, now_s)
            known = {id(request) for request in valid.get(intersection, ())}
            states = tuple(
                _status(request, id(request) in known, paused)
                for request in heard.get(intersection, ())
            )
            if states == self._told.get(intersection, ()):
                continue
            self._told[intersection] = states
            if not states:
                del self._told[intersection]
            sequence = self._sequences[intersection] = self._sequences.get(intersection, -1) + 1
            answers.append(
                SignalStatus(
                    intersection=intersection,
                    sequence=sequence,
                    time_ns=round(now_s * 1e9),
                    requests=states,
                )
            )
        return tuple(answers)


def _status(request: OpenRequest, valid: bool, paused: bool) -> RequestStatus:
    """Granted: the signal has changed its times for it. Locked: it pauses after a grant."""
    if not valid:
        return RequestStatus(vehicle=request.vehicle, request=request.number, status="rejected")
    status: Literal["granted", "reserviceLocked", "processing"] = "processing"
    if request.served:
        status = "granted"
    elif paused:
        status = "reserviceLocked"
    return RequestStatus(vehicle=request.vehicle, request=request.number, status=status)
