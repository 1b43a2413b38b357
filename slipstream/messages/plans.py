"""What the dispatcher tells a vehicle: route, stops, platoons, and how to drive."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from slipstream.messages.base import (
    ROOT,
    Count,
    Finite,
    Identifier,
    Model,
    NonNegative,
    Positive,
    TimeNs,
    chunk,
)


class PlannedCrossing(Model):
    """The junction at a planned segment's end, on the way to the next one."""

    length_m: NonNegative = Field(description="Of the lanes through the junction.")
    speed_mps: Positive = Field(description="Allowed there: the turn's.")
    yields: bool = Field(description="Gives way by the rules of the road, without signals.")
    intersection: Identifier | None = Field(
        default=None, description="Whose signals it obeys; None: none."
    )
    signal_groups: tuple[tuple[Count, Count], ...] = Field(
        default=(), description="(lane, signal group) of each lane that leads there."
    )

    @model_validator(mode="after")
    def _groups_have_an_intersection(self) -> Self:
        if (self.intersection is None) != (not self.signal_groups):
            raise ValueError("signal_groups are given exactly when intersection is")
        return self


class PlannedSegment(Model):
    """One road segment of a vehicle's route."""

    segment: Identifier
    entry_ns: TimeNs
    exit_ns: TimeNs
    speed_mps: NonNegative
    platoon: Identifier | None = Field(description="Platoon to drive in here; None: alone.")
    place: Count | None = Field(description="0 is the leader.")
    gap_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        description="Advised gap to the vehicle ahead; None for the leader and for vehicles alone."
    )
    drafting_share: Annotated[float, Field(ge=0, le=1)] | None = Field(
        default=None,
        description="Share of the segment on which the platoon is expected to be close; null: "
        "alone.",
    )
    leg: Count = Field(description="Which leg between two stops it belongs to.")
    length_m: Positive | None = Field(default=None, description="Of the segment.")
    speed_limit_mps: Positive | None = Field(default=None, description="Allowed on it.")
    lanes: Count | None = Field(default=None, description="Of the segment.")
    crossing: PlannedCrossing | None = Field(
        default=None, description="None at a leg's end, and where the network does not know it."
    )


class PlannedStop(Model):
    """One stop of a vehicle's route."""

    stop: Identifier
    node: Identifier
    arrival_ns: TimeNs
    departure_ns: TimeNs
    latest_ns: TimeNs | None = Field(
        default=None, description="Service begins no later; null: whenever."
    )
    charge_kwh: NonNegative | None = Field(
        default=None,
        description="Planned charge of the battery on arrival, at the first stop at departure; "
        "null: not planned.",
    )
    charged_kwh: NonNegative = Field(
        default=0.0, description="To take in there before it goes on: a charging stop."
    )
    wait_s: NonNegative = Field(
        default=0.0,
        description="For other vehicles, at the end of its stay: it leaves no sooner than planned.",
    )
    is_hub: bool = Field(
        default=False,
        description="Nothing is served there: it waits for other vehicles, or takes a break.",
    )
    break_s: NonNegative = Field(
        default=0.0,
        description="Length of the break that the vehicle takes there, where the stop before is; "
        "0: none.",
    )

    @property
    def kind(self) -> Literal["stop", "hub", "break", "charging"]:
        """What it is there for; a depot counts as a stop."""
        if self.break_s > 0:
            return "break"
        if self.is_hub:
            return "hub"
        return "charging" if self.charged_kwh > 0 else "stop"


class DrivingAdvice(Model):
    """How to drive a plan's legs, beside where and when: each part a lever of its own. What a plan
    does not say is not done.
    """

    eco_approach: bool = Field(
        default=False, description="Time the approach to signals by what their RSU broadcasts."
    )
    coasting_budget: Annotated[float, Field(ge=0, le=0.5)] = Field(
        default=0.0,
        description="Share of a leg's planned time that coasting to turns and stops may add.",
    )
    signal_priority: bool = Field(
        default=False, description="Ask signals for green where the city allows it."
    )
    departure_window_s: Annotated[float, Field(ge=0, le=600)] = Field(
        default=0.0,
        description="A leg driven alone may begin so much later than planned, at the second that "
        "suits the signals best, s. Nine are tried, 4 s apart.",
    )
    value_of_time_kw: NonNegative | None = Field(
        default=None,
        description="Price of the time until it arrives, by which that second is chosen, kWh an "
        "hour; a plan with a departure window has one.",
    )

    @model_validator(mode="after")
    def _window_has_a_price(self) -> Self:
        if self.departure_window_s > 0 and self.value_of_time_kw is None:
            raise ValueError("departure_window_s needs value_of_time_kw")
        return self


class VehiclePlan(Model):
    """The advice that one vehicle gets from one dispatch cycle.

    Its version is its cycle: of two plans the one of the later cycle holds. A plan that continues
    another one begins with the place that the vehicle left last, and its first segment is the one
    that the vehicle was on.
    """

    vehicle: Identifier
    cycle: Count
    issued_ns: TimeNs
    valid_until_ns: TimeNs
    depart_ns: TimeNs
    stops: tuple[PlannedStop, ...]
    segments: tuple[PlannedSegment, ...]
    distance_m: NonNegative
    energy_kwh: Finite = Field(
        description="Of the way that is left; below 0 where braking to its stops gives back more."
    )
    advice: DrivingAdvice = DrivingAdvice()
    continues: Count | None = Field(
        default=None,
        description="Cycle of the plan that it replaces while the vehicle is under way; None: it "
        "begins at a depot.",
    )

    @property
    def service_stops(self) -> tuple[PlannedStop, ...]:
        """The stops to serve: those between the ends that are neither hubs nor for charging."""
        between = self.stops[1:-1]
        return tuple(stop for stop in between if stop.charged_kwh == 0 and not stop.is_hub)


def plan_key(vehicle: str) -> str:
    """Key of a VehiclePlan."""
    return f"{ROOT}/fleet/{chunk(vehicle)}/plan"


ALL_PLANS: Final = f"{ROOT}/fleet/*/plan"
