"""Vehicles of a fleet, their types and breaks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Self
from zoneinfo import ZoneInfo

from pydantic import Field, model_validator

from dispatcher_daemon.fleet.clock import (
    Clock,
    check_order,
    clock_moments,
    over_midnight,
    seconds_after,
)
from dispatcher_daemon.fleet.stops import DAY_S, Skills
from slipstream.config import Settings
from slipstream.messages import Identifier
from slipstream.vehicle_types import VehicleType


class NamedVehicleType(VehicleType):
    """A vehicle type of a fleet, for its vehicles to name."""

    id: Identifier


class Break(Settings):
    """A time in which a vehicle stands and nobody works, between two stops of a tour."""

    duration_s: float = Field(gt=0, le=DAY_S, allow_inf_nan=False, description="Its length.")
    earliest_s: float = Field(
        default=0.0, ge=-DAY_S, le=DAY_S, allow_inf_nan=False, description="Begins no sooner."
    )
    latest_s: float = Field(
        default=DAY_S, ge=-DAY_S, le=DAY_S, allow_inf_nan=False, description="Begins no later."
    )
    earliest: Clock | None = Field(
        default=None,
        description='Instead of `earliest_s`, in a fleet file: "11:30" of each day, or with a '
        "date.",
    )
    latest: Clock | None = Field(default=None, description="Instead of `latest_s`, likewise.")

    @model_validator(mode="after")
    def _window_is_open(self) -> Self:
        if self.latest_s < self.earliest_s:
            raise ValueError(
                f"latest_s ({self.latest_s:g}) must not be below earliest_s ({self.earliest_s:g})"
            )
        return self

    @property
    def clocks(self) -> dict[str, str | None]:
        """Its clock times, in the order in which they follow each other."""
        return {"earliest": self.earliest, "latest": self.latest}

    def at(self, after: Mapping[str, float]) -> Break:
        """The break with its clock times as seconds after a moment, below 0 before it."""
        times = {f"{name}_s": min(max(s, -DAY_S), DAY_S) for name, s in after.items()}
        return self.model_copy(update=times) if times else self

    @property
    def over(self) -> Break:
        """The break in a window that closed long ago: it keeps its place among the others."""
        return self.model_copy(update={"earliest_s": -DAY_S, "latest_s": -DAY_S})


class Vehicle(Settings):
    """One vehicle.

    A vehicle with a first stop has that parcel loaded and drives there first. Stops that are
    nobody's first stop are pooled: any vehicle may serve them, or any of their carrier. It leaves
    its depot within [``ready_s``, ``depart_by_s``], s after the reference time of the cycle.
    """

    id: Identifier = Field(description="Its name, as its agent's.")
    depot: Identifier | None = Field(
        default=None, description="Where it starts and ends; None: the first depot."
    )
    first_stop: Identifier | None = Field(
        default=None, description="The stop whose parcel it has loaded and drives to first."
    )
    capacity: int | None = Field(
        default=None, ge=0, le=10**9, description="Total demand it can carry; None: any."
    )
    ready_s: float = Field(
        default=0.0, ge=0, le=DAY_S, allow_inf_nan=False, description="Leaves no sooner."
    )
    depart_by_s: float | None = Field(
        default=None,
        ge=0,
        le=DAY_S,
        allow_inf_nan=False,
        description="Leaves no later; None: leaves when it is ready.",
    )
    return_by_s: float | None = Field(
        default=None,
        ge=0,
        le=2 * DAY_S,
        allow_inf_nan=False,
        description="Is back at its depot by then; None: whenever.",
    )
    ready: Clock | None = Field(
        default=None,
        description='Instead of `ready_s`, in a fleet file: "07:00" of each day, or with a date.',
    )
    depart_by: Clock | None = Field(default=None, description="Instead of `depart_by_s`, likewise.")
    return_by: Clock | None = Field(default=None, description="Instead of `return_by_s`, likewise.")
    type: Identifier | None = Field(
        default=None,
        description="A preset or one of `vehicle_types`; None: the paper's car.",
    )
    own_type: VehicleType | None = Field(
        default=None, description="Data of this vehicle alone, instead of `type`."
    )
    charge_kwh: float | None = Field(
        default=None,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="In its battery when the fleet's times begin; None: it is full.",
    )
    carrier: Identifier | None = Field(
        default=None,
        description="Who runs it. Vehicles without one count together as one carrier.",
    )
    skills: Skills = Field(default=(), description="It can serve stops that need any of these.")
    breaks: Annotated[tuple[Break, ...], Field(max_length=10)] = Field(
        default=(), description="In the order in which they are taken."
    )

    def break_id(self, number: int) -> str:
        """Name that the stop for one of its breaks has in plans."""
        return f"{self.id} break {number + 1}"

    def breaks_at_depot(self, leaves_s: float, back_s: float) -> frozenset[int]:
        """Numbers of the breaks that a tour leaves to the time at the depot, before it or after it.

        They follow one another there too, so that each takes a time of its own.
        """
        before, ended_s = 0, -math.inf
        for own in self.breaks:
            begins_s = max(own.earliest_s, ended_s)
            if begins_s + own.duration_s > leaves_s and own.latest_s >= leaves_s:
                break
            before, ended_s = before + 1, begins_s + own.duration_s
        # The last ones, as many as have room after it.
        after, begins_by_s = len(self.breaks), math.inf
        for own in reversed(self.breaks[before:]):
            begins_by_s = min(own.latest_s, begins_by_s - own.duration_s)
            if begins_by_s < max(back_s, own.earliest_s):
                break
            after -= 1
        return frozenset((*range(before), *range(after, len(self.breaks))))

    @property
    def clocks(self) -> dict[str, str | None]:
        """Its clock times, in the order in which they follow each other."""
        return {"ready": self.ready, "depart_by": self.depart_by, "return_by": self.return_by}

    def at(self, zone: ZoneInfo, reference_ns: int) -> Vehicle:
        """The vehicle with its clock times as seconds after a moment; what has passed is now."""
        after = seconds_after(self.clocks, zone, reference_ns)
        breaks = self.breaks_at(zone, reference_ns)
        if not after:
            return self if breaks == self.breaks else self.model_copy(update={"breaks": breaks})
        ready_s = min(max(after.get("ready", self.ready_s), 0.0), DAY_S)
        times = {f"{name}_s": max(value, ready_s) for name, value in after.items()}
        if "depart_by_s" in times:
            times["depart_by_s"] = min(times["depart_by_s"], DAY_S)
        if "return_by_s" in times:
            times["return_by_s"] = min(times["return_by_s"], 2 * DAY_S)
        return self.model_copy(update={**times, "ready_s": ready_s, "breaks": breaks})

    def breaks_at(self, zone: ZoneInfo, reference_ns: int) -> tuple[Break, ...]:
        """Its breaks with their clock times as seconds after a moment."""
        after: list[dict[str, float]] = [{} for _ in self.breaks]
        for (number, key), at in self.break_moments(zone, reference_ns).items():
            after[number][key] = at.timestamp() - 1e-9 * reference_ns
        return tuple(own.at(times) for own, times in zip(self.breaks, after, strict=True))

    def break_moments(self, zone: ZoneInfo, reference_ns: int) -> dict[tuple[int, str], datetime]:
        """The clock times of its breaks by number and key: they follow each other, in its shift
        where that is over midnight.
        """
        clocks = {
            f"{number} {key}": text
            for number, own in enumerate(self.breaks)
            for key, text in own.clocks.items()
        }
        shift = None
        if over_midnight(self.clocks):
            shift = next(iter(clock_moments(self.clocks, zone, reference_ns).values()))
        found = clock_moments(clocks, zone, reference_ns, shift)
        named = ((name.split(), at) for name, at in found.items())
        return {(int(number), key): at for (number, key), at in named}

    @model_validator(mode="after")
    def _clocks_are_in_order(self) -> Self:
        check_order(self.clocks)
        return self

    @model_validator(mode="after")
    def _one_type(self) -> Self:
        if self.type is not None and self.own_type is not None:
            raise ValueError("give type or own_type, not both")
        return self

    @model_validator(mode="after")
    def _times_are_in_order(self) -> Self:
        for name in ("depart_by_s", "return_by_s"):
            value: float | None = getattr(self, name)
            if value is not None and value < self.ready_s:
                raise ValueError(f"{name} ({value:g}) must not be below ready_s ({self.ready_s:g})")
        return self
