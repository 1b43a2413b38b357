"""What the vehicles near have told last, as far as it may still be believed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from slipstream.messages import PlatoonControl, PlatoonManagement

SILENT_NS: Final = 500_000_000
"""A partner that was not heard for longer is silent: five messages of a tenth of a second."""

MAX_AHEAD_NS: Final = 100_000_000
"""Dated farther ahead of the own clock, a message is not believed: one of the clocks is wrong."""

MAX_NEIGHBOURS: Final = 200
"""Vehicles that are remembered; those beyond are not heard."""

HOUR_NS: Final = 3600 * 1_000_000_000
"""Who was found to tell what is not so, or to cost more than it may, is not heard for so long."""

MOST_COST_S: Final = 50.0
"""So much later at most is a vehicle in an hour by one other, and some seconds until it is as fast
again."""


@dataclass(frozen=True, slots=True)
class Heard:
    """A vehicle's last message, and when it came by the own clock."""

    message: PlatoonControl
    received_ns: int

    def age_ns(self, now_ns: int) -> int | None:
        """By the message's own time and by that of its arrival, the older one; None: in doubt."""
        sent_ns = now_ns - self.message.time_ns
        arrived_ns = now_ns - self.received_ns
        if sent_ns < -MAX_AHEAD_NS or arrived_ns < -MAX_AHEAD_NS:
            return None
        return max(sent_ns, arrived_ns, 0)


class Neighbours:
    """Vehicles of the fleet that were heard lately, but the own one; each sends once a step."""

    def __init__(self, vehicle: str, interval_s: float) -> None:
        self._vehicle = vehicle
        # Partners are judged by `SILENT_NS`; who is behind comes one interval late in a step.
        self._kept_ns = SILENT_NS + round(interval_s * 1e9)
        self._heard: dict[str, Heard] = {}
        self._doubts: dict[str, tuple[int, str]] = {}

    def __len__(self) -> int:
        return len(self._heard)

    def __iter__(self) -> Iterator[Heard]:
        return iter(self._heard.values())

    def receive(self, message: PlatoonControl, now_ns: int) -> None:
        """Take a message, unless it is old, of the future, or older than the last one."""
        name, heard = message.vehicle, Heard(message, now_ns)
        age_ns = heard.age_ns(now_ns)
        if name == self._vehicle or age_ns is None or age_ns > self._kept_ns:
            return
        if self.doubt(name, now_ns) is not None:
            return
        before = self._heard.get(name)
        if before is None:
            if len(self._heard) >= MAX_NEIGHBOURS:
                return
        elif (
            message.sequence <= before.message.sequence or message.time_ns < before.message.time_ns
        ):
            return
        self._heard[name] = heard

    def forget(self, now_ns: int) -> None:
        """Drop who was not heard for long; a vehicle that starts anew is heard again then."""
        for name, heard in [*self._heard.items()]:
            age_ns = heard.age_ns(now_ns)
            if age_ns is None or age_ns > self._kept_ns:
                del self._heard[name]

    def ignore(self, vehicle: str, reason: str, now_ns: int) -> None:
        """Believe a vehicle nothing for an hour."""
        self._heard.pop(vehicle, None)
        if vehicle not in self._doubts and len(self._doubts) >= MAX_NEIGHBOURS:
            del self._doubts[min(self._doubts, key=lambda name: self._doubts[name][0])]
        self._doubts[vehicle] = now_ns, reason

    def doubt(self, vehicle: str | None, now_ns: int) -> str | None:
        """Why a vehicle is not believed; None: it is."""
        since_ns, reason = self._doubts.get(vehicle or "", (now_ns - HOUR_NS, ""))
        return reason if 0 <= now_ns - since_ns < HOUR_NS else None

    def get(self, vehicle: str | None) -> PlatoonControl | None:
        """A vehicle's last message, at most so old as messages are kept."""
        heard = None if vehicle is None else self._heard.get(vehicle)
        return None if heard is None else heard.message

    def fresh(self, vehicle: str | None, now_ns: int) -> tuple[PlatoonControl, float] | None:
        """A vehicle's last message and its age, s; None: it is silent."""
        heard = None if vehicle is None else self._heard.get(vehicle)
        age_ns = None if heard is None else heard.age_ns(now_ns)
        if heard is None or age_ns is None or age_ns > SILENT_NS:
            return None
        return heard.message, age_ns / 1e9


class CausedDelays:
    """By how much later a vehicle is, by which other one, within an hour from the first cost on."""

    def __init__(self) -> None:
        self._costs: dict[str, tuple[int, float]] = {}

    def add(self, vehicle: str, seconds: float, now_ns: int) -> bool:
        """Count it; whether that one has cost more than it may."""
        since_ns, cost_s = self._costs.get(vehicle, (now_ns, 0.0))
        if not 0 <= now_ns - since_ns < HOUR_NS:
            since_ns, cost_s = now_ns, 0.0
        if vehicle not in self._costs and len(self._costs) >= MAX_NEIGHBOURS:
            del self._costs[min(self._costs, key=lambda name: self._costs[name])]
        self._costs[vehicle] = since_ns, cost_s + seconds
        return cost_s + seconds > MOST_COST_S


class Sequences:
    """Whether management messages come in order and in time."""

    def __init__(self, max_age_ns: int) -> None:
        self._max_age_ns = max_age_ns
        self._last: dict[str, tuple[int, int]] = {}

    def admit(self, message: PlatoonManagement, now_ns: int) -> bool:
        """Whether a message is the newest of its sender, and neither old nor of the future."""
        age_ns = now_ns - message.time_ns
        if not -MAX_AHEAD_NS <= age_ns <= self._max_age_ns:
            return False
        self._last = {
            name: (sequence, received_ns)
            for name, (sequence, received_ns) in self._last.items()
            if abs(now_ns - received_ns) <= 2 * self._max_age_ns
        }
        before = self._last.get(message.vehicle)
        if before is not None and message.sequence <= before[0]:
            return False
        if before is None and len(self._last) >= MAX_NEIGHBOURS:
            return False
        self._last[message.vehicle] = message.sequence, now_ns
        return True
