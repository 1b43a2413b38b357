"""Between a vehicle and its agent: what it senses, what its driver says, what it is advised."""

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
    TimeNs,
    chunk,
)
from slipstream.messages.fleet import Reason


class SensedVehicle(Model):
    """A vehicle directly ahead or behind on the own lane, as the own sensors measure it."""

    track: Identifier = Field(description="Of the sensor; stays while it sees the same vehicle.")
    vehicle: Identifier | None = Field(
        description="Of the fleet that it was recognised as, by its messages; null: any other."
    )
    gap_m: Finite = Field(description="From bumper to bumper.")
    speed_mps: NonNegative


class VehicleSensing(Model):
    """What a vehicle knows of itself, about ten times a second while it is on the road."""

    vehicle: Identifier
    time_ns: TimeNs
    clock_error_s: NonNegative = Field(
        default=0.0, description="What its clock may be off by, as its receiver estimates."
    )
    on_road: bool = Field(description="False: it stands at a stop or at its depot.")
    segment: Identifier = Field(
        description="That it is on, or has just left while it crosses a junction."
    )
    crossing: bool = Field(description="It is in the junction at that segment's end.")
    lane: Count
    front_m: NonNegative = Field(
        description="Of its front, along the segment, or along the lane through the junction."
    )
    speed_mps: NonNegative
    acceleration_mps2: Finite
    driven_m: NonNegative = Field(description="Odometer.")
    charge_kwh: NonNegative | None = None
    ahead: SensedVehicle | None
    behind: SensedVehicle | None


class DriverReport(Model):
    """What the driver, or the depot's software, says about a stop or a plan."""

    vehicle: Identifier
    time_ns: TimeNs
    event: Literal["arrived", "served", "failed", "refused"]
    stop: Identifier | None = Field(description="Null exactly for a refused plan.")
    reason: Reason | None = Field(description="Given exactly where something failed or is refused.")

    @model_validator(mode="after")
    def _the_event_is_explained(self) -> Self:
        if (self.event == "refused") != (self.stop is None):
            raise ValueError("stop is left out exactly for a refused plan")
        if (self.event in ("failed", "refused")) != (self.reason is not None):
            raise ValueError("reason is given exactly where something failed or is refused")
        return self


AdviceMode = Literal["none", "cruise", "speed", "follow", "open_gap"]
"""none: no advice, the driver drives as without an agent. cruise: drive by oneself, up to the
speed. speed: drive that speed. follow: keep or close the gap, at that speed. open_gap: open the
gap, at that speed."""


class VehicleAdvice(Model):
    """An agent's advice to its vehicle; it ends with `valid_until_ns`."""

    vehicle: Identifier
    time_ns: TimeNs
    valid_until_ns: TimeNs
    cycle: Count | None = Field(description="Of the plan that it comes from; null: no plan holds.")
    leg: Count | None = Field(description="Of that plan, driven or to be driven next.")
    mode: AdviceMode
    speed_mps: NonNegative | None = Field(description="Null exactly without advice.")
    acceleration_mps2: Finite | None = Field(
        default=None,
        description="To be driven from now on, in place of the speed by who takes accelerations; "
        "null: the speed alone is advised.",
    )
    least_mps2: Finite | None = Field(
        default=None,
        description="Lowest acceleration that others reckon with: it brakes harder only where its "
        "own safety asks for it; null: others reckon with whatever its brakes can do.",
    )
    fallback_mps2: NonNegative | None = Field(
        default=None,
        description="Deceleration from `valid_until_ns` on, if no other advice has come, until the "
        "driver or the vehicle's own control keeps the gap; null: the driver has it already.",
    )
    gap_m: NonNegative | None = Field(description="Wanted gap to the vehicle ahead; null: its own.")
    lane: Count | None = Field(description="Wanted lane; null: as the driver likes.")
    partner: Identifier | None = Field(description="Vehicle that it follows, joins or waits for.")
    depart_ns: TimeNs | None = Field(description="When to leave, while it stands; null: drives.")
    green_at: Identifier | None = Field(description="Intersection that it asks for green.")
    text: Annotated[str, Field(max_length=200)] = Field(description="For the driver.")
    reason: Annotated[str, Field(max_length=200)] | None = Field(
        description="Why there is no advice, or why it ended a platoon; null: neither."
    )

    @model_validator(mode="after")
    def _advice_has_a_speed(self) -> Self:
        if (self.mode == "none") != (self.speed_mps is None):
            raise ValueError("speed_mps is given exactly with advice")
        return self


def sensing_key(vehicle: str) -> str:
    """Key of a VehicleSensing."""
    return f"{ROOT}/vehicle/{chunk(vehicle)}/sensing"


def driver_key(vehicle: str) -> str:
    """Key of a DriverReport."""
    return f"{ROOT}/vehicle/{chunk(vehicle)}/driver"


def advice_key(vehicle: str) -> str:
    """Key of a VehicleAdvice."""
    return f"{ROOT}/vehicle/{chunk(vehicle)}/advice"
