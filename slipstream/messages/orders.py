"""Orders that callers submit, and what they are told of them."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from slipstream.iso_time import read_datetime
from slipstream.messages.base import ROOT, Count, Identifier, Model, NonNegative, TimeNs, chunk
from slipstream.messages.dispatch import OrderState

_DAY_S: Final = 86_400.0
_RFC_3339: Final = re.compile(
    r"(\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?([Zz]|[+-]\d\d:\d\d)", re.ASCII
)
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f]")


def _as_ns(value: Any) -> Any:
    """An RFC 3339 text as UTC nanoseconds; anything else as it is."""
    if not isinstance(value, str):
        return value
    parts = _RFC_3339.fullmatch(value)
    mend = "write it like 2026-11-23T08:00:00Z or 2026-11-23T09:00:00+01:00"
    if parts is None:
        raise ValueError(f"no time with its date and zone; {mend}")
    try:
        zone = parts[3].upper().replace("Z", "+00:00")
        whole = read_datetime(parts[1].upper() + zone)
        seconds = round(whole.timestamp())
    except (ValueError, OverflowError):
        raise ValueError(f"no such time; {mend}") from None
    return seconds * 10**9 + int((parts[2] or "0").ljust(9, "0"))


def _plain(name: str) -> str:
    if _CONTROL.search(name):
        raise ValueError("it has control characters; write it in one line")
    return name


def _in_one_line(text: str) -> str:
    return " ".join(_CONTROL.sub(" ", text).split())


def _sorted(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted(set(names)))


Moment = Annotated[
    TimeNs,
    BeforeValidator(_as_ns),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string", "format": "date-time"},
                {"type": "integer", "minimum": 0, "exclusiveMaximum": 2**63},
            ]
        },
        mode="validation",
    ),
]
"""UTC nanoseconds; an RFC 3339 text with its zone is read too."""

Name = Annotated[Identifier, AfterValidator(_plain)]

Reason = Annotated[
    str, AfterValidator(_in_one_line), Field(max_length=500, description="In words; null: none.")
]
"""Why somebody does something to an order or to the dispatcher: for its history and the log."""


class OrderRequest(Model):
    """One delivery that a caller asks for. Its id is the caller's: the same request with the same
    id is one order, however often it is sent.
    """

    id: Name
    node: Name | None = Field(
        default=None, description="Junction of the road network; or `lat` and `lon`."
    )
    lat: Annotated[float, Field(ge=-90, le=90)] | None = Field(
        default=None, description="Latitude, degrees (WGS 84)."
    )
    lon: Annotated[float, Field(ge=-180, le=180)] | None = Field(
        default=None, description="Longitude, degrees."
    )
    service_s: Annotated[float, Field(ge=0, le=_DAY_S)] = 60.0
    demand: Annotated[int, Field(ge=0, le=10**9)] = Field(
        default=0, description="What it takes of a vehicle's capacity."
    )
    mass_kg: Annotated[float, Field(ge=0, le=1e6)] = Field(
        default=0.0, description="What it takes of a vehicle's payload."
    )
    earliest: Moment | None = Field(
        default=None, description="Service starts no sooner; null: whenever."
    )
    latest: Moment | None = Field(
        default=None, description="Service starts no later; null: whenever."
    )
    carrier: Name | None = Field(
        default=None, description="Only vehicles of this carrier serve it; null: any vehicle."
    )
    skills: Annotated[tuple[Name, ...], AfterValidator(_sorted), Field(max_length=50)] = Field(
        default=(), description="Only vehicles with all of these serve it."
    )
    vehicle: Name | None = Field(
        default=None, description="Pinned to this vehicle; null: any vehicle."
    )

    @model_validator(mode="after")
    def _has_one_place(self) -> Self:
        if (self.lat is None) != (self.lon is None):
            raise ValueError("one of lat and lon is missing; give both, or neither")
        if (self.node is None) == (self.lat is None):
            lacks = "it has no place" if self.node is None else "it has two places"
            raise ValueError(f"{lacks}; give a junction as node, or lat and lon")
        return self

    @field_validator("latest")
    @classmethod
    def _window_is_open(cls, latest: int | None, info: ValidationInfo) -> int | None:
        earliest = info.data.get("earliest")
        if latest is not None and earliest is not None and latest < earliest:
            raise ValueError("its window ends before it begins; give a latest after earliest")
        return latest


class OrderReceipt(Model):
    """An order is stored, and is planned as long as it is open. All but its state is the same for
    each repetition of a request.
    """

    order: Identifier
    received_ns: TimeNs
    node: Identifier = Field(description="Junction where vehicles stop for it.")
    distance_m: NonNegative | None = Field(
        default=None,
        description="From the request's `lat` and `lon` to that junction, in a straight line; "
        "null: the request names the junction.",
    )
    state: OrderState = Field(
        default="open",
        description="Now: one that has ended, cancelled perhaps, is not planned for being sent "
        "again; a new order needs a new id.",
    )


class OrderStep(Model):
    """One change in an order's life."""

    time_ns: TimeNs
    state: OrderState
    reason: str
    vehicle: Identifier | None
    cycle: Count | None


class OrderStatus(Model):
    """An order as it is now."""

    order: Identifier
    source: Literal["file", "api"] = Field(description="The fleet's file, or a caller.")
    state: OrderState
    since_ns: TimeNs
    reason: str = Field(description="Of the last change.")
    vehicle: Identifier | None = Field(description="That has it; of an ended order, that had it.")
    cycle: Count | None = Field(description="Of that vehicle's plan.")
    pinned: Identifier | None = Field(description="Only this vehicle may serve it; null: any.")
    arrival_ns: TimeNs | None = Field(description="By that plan; null: none has it.")
    unplanned: str | None = Field(
        description="Why the last cycle did not plan it; null: it did, or has not seen it."
    )
    at_risk: str | None = Field(
        default=None,
        description="Why its arrival cannot be relied on, or why it is late: its vehicle is "
        "silent, was never heard or has not acknowledged its plan; it was to be served by now; or "
        "it is said to be served by a vehicle that is not believed. Null: none of these.",
    )
    node: Identifier
    service_s: NonNegative
    demand: Count
    earliest_ns: TimeNs | None
    latest_ns: TimeNs | None
    received_ns: TimeNs | None = Field(description="Null of an order of the file.")
    request: OrderRequest | None = Field(description="As it came; null of an order of the file.")


class OrderHistory(OrderStatus):
    """An order with its life, the oldest change first."""

    history: tuple[OrderStep, ...]


RefusalKind = Literal["invalid", "not_found", "conflict", "too_late", "unavailable"]


def _encodable(text: object) -> object:
    """A caller's JSON may have half a surrogate pair, which no answer could repeat."""
    return text.encode("utf-8", "replace").decode() if isinstance(text, str) else text


_Encodable = Annotated[str, BeforeValidator(_encodable)]


class OrderRefusal(Model):
    """Why nothing was done: invalid and conflict are the caller's to mend, too_late is not;
    unavailable: try again.
    """

    order: _Encodable | None
    kind: RefusalKind
    key: _Encodable | None = Field(description="Field of the request; null: none.")
    problem: _Encodable
    mend: _Encodable


def order_key(order: str, action: str) -> str:
    """Key on which an order is submitted, shown, cancelled, pinned, released or settled."""
    return f"{ROOT}/order/{chunk(order)}/{action}"


ALL_ORDERS: Final = f"{ROOT}/order/*/*"
