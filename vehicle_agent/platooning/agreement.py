"""The agreement of two vehicles that the front one waits for the rear one, from either side; its
terms are in docs/platooning.md, "Catching up".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from slipstream.messages import PlatoonManagement
from slipstream.spacing import MAX_SLOWDOWN
from vehicle_agent.platooning.neighbours import HOUR_NS, Sequences
from vehicle_agent.platooning.rendezvous import MAX_CLOSING_S

RENEW_NS: Final = 1_000_000_000
"""Between two requests of a vehicle that catches up."""

_MAX_CLOSING_NS: Final = round(MAX_CLOSING_S * 1e9)

MAX_REASON: Final = 200
"""Letters of a reason in a message."""

EXPIRY_NS: Final = 5 * RENEW_NS
"""Without a request for so long, nobody is waited for: four lost ones in a row."""


@dataclass
class Joined:
    """The front vehicle's side: whom it waits for, if anybody, and the share b of its speed that it
    takes off.
    """

    by: str | None = None
    slowdown: float = 0.0
    _until_ns: int = 0

    def ask(self, request: PlatoonManagement, now_ns: int) -> str | None:
        """Take a request; or why not, in words for people."""
        self.expire(now_ns)
        if self.by not in (None, request.vehicle):
            return f"{self.by} joins it"
        self.by = request.vehicle
        self.slowdown = min(request.slowdown, MAX_SLOWDOWN)
        self._until_ns = now_ns + EXPIRY_NS
        return None

    def expire(self, now_ns: int) -> None:
        """End it if it was not renewed, or if the clock was set back."""
        if self.by is not None and not 0 <= self._until_ns - now_ns <= EXPIRY_NS:
            self.end()

    def end(self) -> None:
        """Wait for nobody."""
        self.by, self.slowdown, self._until_ns = None, 0.0, 0


@dataclass
class Waits:
    """For how long a vehicle has driven more slowly for others, whoever they were: within an hour
    from the first wait on, and anew once another vehicle than the last one has come, as the own
    sensing has it.
    """

    _spent_ns: int = 0
    _hour_began_ns: int = 0
    _come: str | None = None

    def are_spent(self, now_ns: int) -> bool:
        """Whether it has waited for as long as it does in an hour."""
        if self._spent_ns == 0 or not 0 <= now_ns - self._hour_began_ns < HOUR_NS:
            self._spent_ns, self._hour_began_ns = 0, now_ns
        return self._spent_ns >= _MAX_CLOSING_NS

    def add(self, seconds: float) -> None:
        """It waits for so long."""
        self._spent_ns += round(seconds * 1e9)

    def end_with(self, vehicle: str) -> None:
        """A vehicle has come close behind."""
        if vehicle != self._come:
            self._come, self._spent_ns = vehicle, 0


@dataclass
class Joining:
    """The rear vehicle's side: whom it catches up with.

    Attributes:
        front: the vehicle that it will follow; None: none.
        asked: front, or its leader; None: nobody is asked, it waits for another one or has refused.
        speedup: a, its own.
        slowdown: b, that it asks for.
    """

    front: str | None = None
    asked: str | None = None
    speedup: float = 0.0
    slowdown: float = 0.0
    _since_ns: int = 0
    _refused_by: str | None = None
    _refused_until_ns: int = 0

    def choose(
        self, front: str, asked: str | None, speedup: float, slowdown: float, now_ns: int
    ) -> None:
        """Catch up with a vehicle, or go on doing so."""
        if self.front != front:
            self._since_ns = now_ns
        self.front, self.asked = front, asked
        self.speedup, self.slowdown = speedup, slowdown

    def end(self) -> None:
        """Catch up with nobody."""
        self.front = self.asked = None
        self.speedup = self.slowdown = 0.0

    def refuse(self, by: str, now_ns: int, for_ns: int = EXPIRY_NS) -> None:
        """Do not ask a vehicle for a time: it has refused, or waited for long."""
        if by == self.asked:
            self._refused_by, self._refused_until_ns = by, now_ns + for_ns
            self.end()

    def may_ask(self, vehicle: str | None, now_ns: int) -> bool:
        """Whether a vehicle has not just refused, nor waited for as long as any may."""
        if vehicle is None:
            return False
        if vehicle == self.asked and now_ns - self._since_ns > _MAX_CLOSING_NS:
            self.refuse(vehicle, now_ns, _MAX_CLOSING_NS)
        return vehicle != self._refused_by or now_ns >= self._refused_until_ns


class Agreements:
    """A vehicle's agreements, and the management messages about them."""

    def __init__(self, vehicle: str) -> None:
        self.joined, self.joining, self.waits = Joined(), Joining(), Waits()
        self._vehicle = vehicle
        self._sequences = Sequences(RENEW_NS)
        self._sequence = 0
        self._outbox: list[PlatoonManagement] = []

    def admit(self, message: PlatoonManagement, now_ns: int) -> bool:
        """Whether a message is to this vehicle, in order and in time."""
        to_me = message.partner == self._vehicle != message.vehicle
        return to_me and self._sequences.admit(message, now_ns)

    def send(
        self,
        now_ns: int,
        kind: Literal["join_request", "join_response", "leave"],
        partner: str,
        *,
        accepted: bool | None = None,
        slowdown: float = 0.0,
        reason: str | None = None,
    ) -> None:
        """Put a message into the outbox."""
        message = PlatoonManagement(
            vehicle=self._vehicle,
            partner=partner,
            sequence=self._sequence,
            time_ns=now_ns,
            kind=kind,
            accepted=accepted,
            slowdown=slowdown,
            reason=None if reason is None else reason[:MAX_REASON],
        )
        self._sequence += 1
        self._outbox.append(message)

    def take(self) -> tuple[PlatoonManagement, ...]:
        """Empty the outbox."""
        messages = tuple(self._outbox)
        self._outbox.clear()
        return messages
