"""What a vehicle tells the dispatcher: position, answer to a plan, progress of its visits."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from slipstream.messages.base import (
    ROOT,
    Count,
    Identifier,
    Model,
    NonNegative,
    Share,
    TimeNs,
    chunk,
)

Reason = Annotated[str, Field(min_length=1, max_length=500)]
"""Why, in words for people."""


class VehiclePosition(Model):
    """Where a vehicle's own telematics puts it, about once a second."""

    vehicle: Identifier
    time_ns: TimeNs
    segment: Identifier = Field(description="That it is on, or stands at one of the ends of.")
    share: Share = Field(description="Of that segment that lies behind it.")
    speed_mps: NonNegative
    on_road: bool = Field(description="False: it stands at a stop or at its depot.")
    cycle: Count | None = Field(
        description="Cycle of the plan that it follows; None: it is free for one."
    )
    leg: Count | None = Field(
        description="Leg of that plan that it drives, or will drive next; None: no plan."
    )
    charge_kwh: NonNegative | None = Field(
        default=None, description="Energy in its battery; null: not known."
    )
    braking_share: Share | None = Field(
        default=None,
        description="Of the deceleration that its type declares, what its brakes did of late; it "
        "keeps no close gap. Null: as declared, or not known.",
    )

    @model_validator(mode="after")
    def _leg_has_a_plan(self) -> Self:
        if (self.cycle is None) != (self.leg is None):
            raise ValueError("leg is given exactly when cycle is")
        return self


class PlanAcknowledgement(Model):
    """A vehicle's answer to a plan; sent once for each plan, and again when it is asked for."""

    vehicle: Identifier
    time_ns: TimeNs
    cycle: Count = Field(description="Of the plan.")
    accepted: bool
    reason: Reason | None = Field(description="Why it is refused; null: it is not.")

    @model_validator(mode="after")
    def _a_refusal_has_a_reason(self) -> Self:
        if self.accepted != (self.reason is None):
            raise ValueError("reason is given exactly when the plan is refused")
        return self


class Visit(Model):
    """What became of one stop of a vehicle's tour."""

    stop: Identifier
    status: Literal["arrived", "served", "failed"]
    arrived_ns: TimeNs
    ended_ns: TimeNs | None = Field(description="When it was served or given up; null: not yet.")
    reason: Reason | None = Field(description="Why it failed; null: it did not.")

    @model_validator(mode="after")
    def _the_status_is_explained(self) -> Self:
        if (self.status == "arrived") != (self.ended_ns is None):
            raise ValueError("ended_ns is given exactly when the visit has ended")
        if (self.status == "failed") != (self.reason is not None):
            raise ValueError("reason is given exactly when the visit failed")
        return self


class VehicleProgress(Model):
    """The visits of a vehicle's last tours, the oldest first.

    Each message repeats them, so that a dispatcher that missed some, or has just started, learns of
    each. It is sent at each change and every few seconds.
    """

    vehicle: Identifier
    time_ns: TimeNs
    cycle: Count | None = Field(description="Of the plan that it follows; null: none.")
    visits: Annotated[tuple[Visit, ...], Field(max_length=1000)]


def position_key(vehicle: str) -> str:
    """Key of a VehiclePosition."""
    return f"{ROOT}/fleet/{chunk(vehicle)}/position"


def acknowledgement_key(vehicle: str) -> str:
    """Key of a PlanAcknowledgement."""
    return f"{ROOT}/fleet/{chunk(vehicle)}/acknowledgement"


def progress_key(vehicle: str) -> str:
    """Key of a VehicleProgress."""
    return f"{ROOT}/fleet/{chunk(vehicle)}/progress"


ALL_POSITIONS: Final = f"{ROOT}/fleet/*/position"
ALL_ACKNOWLEDGEMENTS: Final = f"{ROOT}/fleet/*/acknowledgement"
ALL_PROGRESS: Final = f"{ROOT}/fleet/*/progress"
