"""Requests for green (SRM), once a second: signals that a free drive reaches within HORIZON_S, up
to the first that is not green. How a signal serves requests is its own affair.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from typing import Final

from slipstream.messages import SignalRequest
from vehicle_agent.free_drive import free_drive_s
from vehicle_agent.leg import Leg, StopLine, VehicleState
from vehicle_agent.signals.timings import SignalTimings

HORIZON_S: Final = 12.0
"""A vehicle asks when a free drive to the stop line takes no longer."""

PASSING_S: Final = 1.5
"""How long after its arrival the green should last."""

PASSING_MPS: Final = 8.0
"""At which the rest of its platoon follows."""

INTERVAL_S: Final = 1.0


class SignalRequests:
    """The requests of one vehicle, by what the intersections tell."""

    def __init__(self, vehicle: str, timings: SignalTimings) -> None:
        self._vehicle = vehicle
        self._timings = timings
        self._open: dict[tuple[str, str], SignalRequest] = {}
        self._requests = 0
        self._sequence = 0
        self._next_s = -math.inf

    def step(
        self, now_s: float, leg: Leg, state: VehicleState, tail_m: float = 0.0
    ) -> tuple[SignalRequest, ...]:
        """The requests to send now: new ones, updates, cancellations; at most once a second.

        A request for a line that lies behind, or is not on the way any more, is cancelled. `tail_m`
        is from the vehicle's front to the rear of its platoon's last one.
        """
        if now_s < self._next_s:
            return ()
        self._next_s = math.floor(now_s) + INTERVAL_S
        known, self._open = self._open, {}
        sent = []
        for line, arrival_s in self._ahead(now_s, leg, state):
            place = (line.intersection, leg.path[line.number])
            lane = state.lane if line.number == state.number else None
            through_s = arrival_s + PASSING_S + tail_m / PASSING_MPS
            message = self._message(
                line.intersection,
                line.group(lane),
                known.pop(place, None),
                now_s,
                arrival_s,
                through_s,
            )
            self._open[place] = message
            sent.append(message)
        return (*self._cancelled(known, now_s), *sent)

    def end(self, now_s: float) -> tuple[SignalRequest, ...]:
        """The cancellations of all that is open: the vehicle stops asking."""
        known, self._open = self._open, {}
        self._next_s = -math.inf
        return self._cancelled(known, now_s)

    def _ahead(
        self, now_s: float, leg: Leg, state: VehicleState
    ) -> Iterator[tuple[StopLine, float]]:
        """Lines in reach and when the vehicle can be there, up to the first that is not green."""
        place_m = leg.place_m(state)
        limit_mps = leg.limits_mps[state.number]
        first = bisect_right(leg.lines, place_m, key=lambda line: line.at_m)
        for line in leg.lines[first:]:
            drive_s = free_drive_s(line.at_m - place_m, state.speed_mps, limit_mps)
            if not drive_s <= HORIZON_S:
                return
            yield line, now_s + drive_s
            shown = self._timings.indication(line.intersection, line.group(None), now_s)
            if shown is None or not shown.may_go:
                return

    def _cancelled(
        self, known: Mapping[tuple[str, str], SignalRequest], now_s: float
    ) -> tuple[SignalRequest, ...]:
        cancelled = []
        for message in known.values():
            self._sequence += 1
            changes = {
                "kind": "priorityCancellation",
                "sequence": self._sequence,
                "time_ns": round(now_s * 1e9),
            }
            cancelled.append(message.model_copy(update=changes))
        return tuple(cancelled)

    def _message(
        self,
        intersection: str,
        group: int,
        before: SignalRequest | None,
        now_s: float,
        arrival_s: float,
        through_s: float,
    ) -> SignalRequest:
        self._sequence += 1
        if before is None:
            self._requests += 1
        return SignalRequest(
            vehicle=self._vehicle,
            request=self._requests if before is None else before.request,
            sequence=self._sequence,
            time_ns=round(now_s * 1e9),
            intersection=intersection,
            signal_group=group,
            kind="priorityRequest" if before is None else "priorityRequestUpdate",
            arrival_ns=round(arrival_s * 1e9),
            through_ns=round(through_s * 1e9),
        )
