"""What the dispatcher publishes through: the bus, and the API's stream of events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

from slipstream.messages import Message
from slipstream.orders import OrderChange


class MessagePublisher(Protocol):
    """A declared publisher: the part of `slipstream.bus.session.Publisher` that is used here."""

    def put(self, message: Message | bytes) -> None:
        """Publish."""
        ...


class MessageBus(Protocol):
    """The part of `slipstream.bus.session.Bus` that is used here."""

    def publisher(self, key: str) -> MessagePublisher:
        """Declare a publisher."""
        ...


Announce = Callable[
    [Literal["plan", "state", "cycle", "order", "alarm"], Message | OrderChange], None
]
"""Tells callers of the API what has happened."""


def announce_nothing(kind: str, value: Message | OrderChange, /) -> None:
    """Without an API nobody listens."""
