"""The open requests for green at the signals: which were heard, and until when they hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from slipstream.messages import SignalRequest

_LAPSED_S: Final = 2.5
"""A request that is not renewed for this time is given up: vehicles renew theirs once a second."""


@dataclass
class OpenRequest:
    """A vehicle before a signal. `number`: the vehicle's, of the request."""

    vehicle: str
    number: int
    group: int
    first_s: float
    heard_s: float
    arrival_s: float
    through_s: float
    served: bool = False


class OpenRequests:
    """The open requests by intersection; a vehicle has one of a number at each at most."""

    def __init__(self) -> None:
        self._open: dict[str, dict[tuple[str, int], OpenRequest]] = {}

    def receive(self, message: SignalRequest, now_s: float) -> bool:
        """Take in a request, an update or a cancellation; whether that opened a request.

        An update of a request that is not known opens it: the first message may have been lost.
        """
        requests = self._open.setdefault(message.intersection, {})
        name = (message.vehicle, message.request)
        if message.kind == "priorityCancellation":
            requests.pop(name, None)
            return False
        known = requests.get(name)
        is_new = known is None
        if known is None:
            known = requests[name] = OpenRequest(
                *name, message.signal_group, now_s, now_s, 0.0, 0.0
            )
        known.group, known.heard_s = message.signal_group, now_s
        known.arrival_s, known.through_s = message.arrival_ns / 1e9, message.through_ns / 1e9
        return is_new

    def at(self, now_s: float) -> dict[str, list[OpenRequest]]:
        """The requests that hold, by intersection; at each, those that were first to ask first."""
        found: dict[str, list[OpenRequest]] = {}
        for intersection in [*self._open]:
            requests = self._open[intersection]
            for name in [n for n, r in requests.items() if now_s - r.heard_s > _LAPSED_S]:
                del requests[name]
            if not requests:
                del self._open[intersection]
                continue
            found[intersection] = sorted(requests.values(), key=lambda r: (r.first_s, r.vehicle))
        return found
