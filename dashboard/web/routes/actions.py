"""What an operator may do from the page, as calls of the dispatcher's HTTP API; pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal, Self
from urllib.parse import quote

from pydantic import Field, model_validator

from slipstream.config import Settings
from slipstream.messages import Identifier

Kind = Literal["pause", "resume", "solve", "pin", "release", "cancel", "acknowledge"]
_OF_DISPATCHER: Final = ("pause", "resume", "solve")
_OF_ORDER: Final = ("pin", "release", "cancel")


class Action(Settings):
    """What somebody asks for.

    Attributes:
        subject: `dispatcher`, `order/ID` or `alarm/ID`.
        vehicle: to pin an order to; None: the one whose plan has it.
    """

    action: Kind
    subject: Annotated[str, Field(min_length=1, max_length=300)]
    vehicle: Identifier | None = None
    reason: Annotated[str, Field(max_length=500)] | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        kind, _, name = self.subject.partition("/")
        if self.action in _OF_DISPATCHER:
            if self.subject != "dispatcher":
                raise ValueError(f"{self.action} is for the subject 'dispatcher'")
        elif (kind, bool(name)) != ("order" if self.action in _OF_ORDER else "alarm", True):
            wanted = "order/ID" if self.action in _OF_ORDER else "alarm/ID"
            raise ValueError(f"{self.action} is for a subject {wanted!r}")
        if self.vehicle is not None and self.action != "pin":
            raise ValueError("vehicle is for pin only")
        return self

    @property
    def name(self) -> str:
        """Of the order or alarm; empty for the dispatcher."""
        return self.subject.partition("/")[2]


@dataclass(frozen=True)
class ActionCall:
    """One call of the API: method, path below its address, and JSON body."""

    method: str
    path: str
    body: dict[str, object] | None = None


def call_of(action: Action) -> ActionCall:
    """The call that does what is asked for."""
    method, path, _ = _CALLS[action.action]
    given = {"vehicle": action.vehicle, "reason": action.reason}
    body: dict[str, object] = {k: v for k, v in given.items() if v is not None}
    return ActionCall(method, path.format(quote(action.name, safe="")), body or None)


def told(action: Action) -> str:
    """What has been done, for people."""
    to = f"to {action.vehicle}" if action.vehicle else "to the vehicle whose plan has it"
    return _CALLS[action.action][2].format(action.name, to)


_CALLS: Final[dict[Kind, tuple[str, str, str]]] = {
    "pause": (
        "POST",
        "/v1/control/pause",
        "The dispatcher is paused: no new cycles until it is resumed.",
    ),
    "resume": ("POST", "/v1/control/resume", "The dispatcher goes on."),
    "solve": ("POST", "/v1/control/cycle", "A cycle begins now."),
    "pin": ("POST", "/v1/orders/{}/pin", "Order {} is locked {}."),
    "release": ("POST", "/v1/orders/{}/release", "Order {} may go to any vehicle."),
    "cancel": ("DELETE", "/v1/orders/{}", "Order {} is cancelled."),
    "acknowledge": ("POST", "/v1/alarms/{}/acknowledge", "The alarm is acknowledged."),
}
"""Method and path of each call, and what it did: of which order, and to which vehicle."""
