"""Places of a fleet: depots, stops, charging stops and hubs."""

from __future__ import annotations

from typing import Annotated, Final, Self
from zoneinfo import ZoneInfo

from pydantic import Field, PrivateAttr, model_validator

from dispatcher_daemon.fleet.clock import Clock, seconds_after
from slipstream.config import Settings
from slipstream.messages import Identifier

DEPOT: Final = "depot"
"""In the arc form this place stands for each vehicle's own depot; no stop may have its name."""
DAY_S: Final = 86400.0

Skills = Annotated[tuple[Identifier, ...], Field(max_length=50)]
"""Names of what a stop needs, or a vehicle has, such as "tail-lift"."""

_PowerKw = Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False)]


class _Point(Settings):
    """Where a place is, as a fleet's file may give it instead of a junction."""

    lat: float | None = Field(
        default=None, ge=-90, le=90, allow_inf_nan=False, description="Latitude, degrees (WGS 84)."
    )
    lon: float | None = Field(
        default=None, ge=-180, le=180, allow_inf_nan=False, description="Longitude, degrees."
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.lat is None) != (self.lon is None):
            raise ValueError("give lat and lon, or neither")
        return self


class Depot(_Point):
    """Where vehicles start and end."""

    id: Identifier = Field(default=DEPOT, description="Its name.")
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")
    charging_power_kw: _PowerKw | None = Field(
        default=None, description="Vehicles charge while they wait there; None: they cannot."
    )


class ChargingStop(_Point):
    """Where vehicles may charge on their way."""

    id: Identifier
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")
    power_kw: _PowerKw


class Hub(_Point):
    """Where vehicles may wait for each other on their way, such as a rest area."""

    id: Identifier
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")


class Stop(_Point):
    """One delivery. Stops may share a junction with each other and with a depot.

    Times in seconds count from the reference time of the cycle: when a vehicle that is ready at
    once leaves.
    """

    id: Identifier = Field(description="Its name, an order's: never used again for another one.")
    node: Identifier = Field(description="Junction of the road network; or `lat` and `lon`.")
    service_s: float = Field(
        default=60.0, ge=0, le=DAY_S, allow_inf_nan=False, description="Time that service takes."
    )
    demand: int = Field(
        default=0, ge=0, le=10**9, description="What it takes of a vehicle's capacity."
    )
    mass_kg: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="What it takes of a vehicle's payload.",
    )
    earliest_s: float = Field(
        default=0.0, ge=0, le=DAY_S, allow_inf_nan=False, description="Service starts no sooner."
    )
    latest_s: float | None = Field(
        default=None,
        ge=0,
        le=DAY_S,
        allow_inf_nan=False,
        description="Service starts no later; None: whenever.",
    )
    earliest: Clock | None = Field(
        default=None,
        description='Instead of `earliest_s`, in a fleet file: "08:30" of each day, or with a '
        'date, "2026-11-23T08:30:00+01:00".',
    )
    latest: Clock | None = Field(default=None, description="Instead of `latest_s`, likewise.")
    carrier: Identifier | None = Field(
        default=None, description="Only vehicles of this carrier serve it; None: any vehicle."
    )
    skills: Skills = Field(default=(), description="Only vehicles with all of these serve it.")
    vehicle: Identifier | None = Field(
        default=None, description="Only this vehicle serves it; None: any vehicle."
    )

    _utc_ns: dict[str, int] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _window_is_open(self) -> Self:
        if self.latest_s is not None and self.latest_s < self.earliest_s:
            raise ValueError(
                f"latest_s ({self.latest_s:g}) must not be below earliest_s ({self.earliest_s:g})"
            )
        return self

    @property
    def clocks(self) -> dict[str, str | None]:
        """Its clock times, in the order in which they follow each other."""
        return {"earliest": self.earliest, "latest": self.latest}

    def at(self, zone: ZoneInfo, reference_ns: int) -> Stop:
        """The stop with its clock times as seconds after a moment; a window that has closed closes
        then.
        """
        after = seconds_after(self.clocks, zone, reference_ns)
        times = {f"{name}_s": min(max(value, 0.0), DAY_S) for name, value in after.items()}
        earliest_s = times.get("earliest_s", self.earliest_s)
        if "latest_s" in times:
            times["latest_s"] = max(times["latest_s"], earliest_s)
        if not times:
            return self
        timed = self.model_copy(update=times)
        timed._utc_ns = {name: reference_ns + round(1e9 * value) for name, value in after.items()}
        return timed

    def window_ns(self, reference_ns: int) -> tuple[int | None, int | None]:
        """(begin, end) of its window, UTC: clock times as they are, also where they have passed."""

        def at(name: str, seconds: float) -> int:
            return self._utc_ns.get(name, reference_ns + round(1e9 * seconds))

        always_open = self.earliest is None and self.earliest_s == 0
        return (
            None if always_open else at("earliest", self.earliest_s),
            None if self.latest_s is None else at("latest", self.latest_s),
        )

    @property
    def requirement(self) -> tuple[str | None, frozenset[str]]:
        """Carrier and skills that it asks for."""
        return self.carrier, frozenset(self.skills)


Place = Depot | Stop | ChargingStop | Hub
