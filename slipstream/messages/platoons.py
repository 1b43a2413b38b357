"""Between vehicles: platoon control and platoon management.

They follow the platoon control message (PCM) and the platoon management message (PMM) of the
ENSEMBLE project; position and motion those of a basic safety message. docs/wire.md has the table.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from slipstream.messages.base import (
    ROOT,
    Count,
    Finite,
    Identifier,
    Model,
    NonNegative,
    Positive,
    Share,
    TimeNs,
    chunk,
)

PlatoonMode = Literal["alone", "following", "leaving"]
"""alone: its driver or its own speed control keeps the gap. following: platooning does, in a close
gap or closing it. leaving: platooning does, until the gap is wide enough for the driver."""


class PlatoonControl(Model):
    """PCM: a vehicle's position and motion, ten times a second, for vehicles near it."""

    vehicle: Identifier
    sequence: Count
    time_ns: TimeNs
    path: Annotated[tuple[Identifier, ...], Field(min_length=1, max_length=64)] = Field(
        description="Segments that it will drive, from the one that it is on."
    )
    crossing: bool = Field(description="It is in the junction at the first segment's end.")
    lane: Count
    front_m: NonNegative = Field(
        description="Of its front, along the segment, or along the lane through the junction."
    )
    length_m: Positive
    speed_mps: NonNegative
    acceleration_mps2: Finite
    announced_mps: NonNegative = Field(description="Speed that it will have at the next message.")
    desired_mps: NonNegative = Field(description="Speed that it would drive here alone.")
    mode: PlatoonMode
    ahead: Identifier | None = Field(description="Vehicle that it follows; null: none.")
    leader: Identifier = Field(description="Of its platoon; itself where it follows none.")
    joined_by: Identifier | None = Field(description="Vehicle that it lets catch up; null: none.")
    tail_m: NonNegative = Field(description="From its front to the rear of its last follower.")
    greatest_mps2: Positive = Field(
        default=9.8, description="The most that it brakes with on the road as it is."
    )
    planned_mps2: Annotated[tuple[Finite, ...], Field(max_length=8)] = Field(
        default=(),
        description="Accelerations that it is commanded from this message on, for an interval "
        "each; a leader tells them before it drives them.",
    )
    limit_mps2: Positive | None = Field(
        default=None,
        description="It brakes no harder until its follower is apart; null: it promises nothing.",
    )
    needs_mps2: Positive | None = Field(
        default=None,
        description="Limit that `ahead` would have to promise for the wanted close gap; null: it "
        "keeps none.",
    )
    gap_m: Finite | None = Field(
        default=None, description="To `ahead`, as sensed; null: not sensed, or it follows none."
    )
    platoon: Identifier | None = Field(
        default=None, description="Of its plan, on the segment that it is on; null: none."
    )
    place: Count | None = Field(default=None, description="In that platoon; 0 is the leader.")


class PlatoonManagement(Model):
    """PMM: one vehicle asks, answers or tells another one."""

    vehicle: Identifier
    partner: Identifier = Field(description="To whom it is sent.")
    sequence: Count
    time_ns: TimeNs
    kind: Literal["join_request", "join_response", "leave"]
    accepted: bool | None = Field(description="Given exactly in a response.")
    slowdown: Share = Field(
        default=0.0, description="Share of its speed that the partner is asked to take off."
    )
    reason: Annotated[str, Field(max_length=200)] | None = None

    @model_validator(mode="after")
    def _a_response_answers(self) -> Self:
        if (self.kind == "join_response") != (self.accepted is not None):
            raise ValueError("accepted is given exactly in a response")
        return self


def platoon_control_key(segment: str, vehicle: str) -> str:
    """Key of a PlatoonControl: vehicles listen to the segments around them."""
    return f"{ROOT}/platoon/{chunk(segment)}/{chunk(vehicle)}"


def platoon_controls_on(segment: str) -> str:
    """Key expression of the PlatoonControls of all vehicles on a segment."""
    return f"{ROOT}/platoon/{chunk(segment)}/*"


def platoon_management_key(partner: str, vehicle: str) -> str:
    """Key of a PlatoonManagement from a vehicle to a partner."""
    return f"{ROOT}/fleet/{chunk(partner)}/platooning/{chunk(vehicle)}"


def platoon_managements_to(vehicle: str) -> str:
    """Key expression of the PlatoonManagements to a vehicle."""
    return f"{ROOT}/fleet/{chunk(vehicle)}/platooning/*"
