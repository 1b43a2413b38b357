"""The schema of instance files that have matrices instead of roads.

For people: docs/instances.md.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from dispatcher_daemon.fleet import Fleet
from slipstream.config import Settings
from slipstream.messages import Identifier

MAX_PLACES = 2000

_Name = Annotated[str, StringConstraints(min_length=1, max_length=200)]
_Coordinate = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]
_Entry = Annotated[float, Field(ge=0, lt=2**32, allow_inf_nan=False)]
_Matrix = tuple[tuple[_Entry | None, ...], ...]
"""See `given_matrices` for where no way leads."""

Rounding = Literal["none", "nearest", "tenths"]
Measure = Literal["distance", "duration", "energy"]


class PlaceRow(Settings):
    """A place, which depots and stops name as their `node`."""

    id: Identifier
    x_m: _Coordinate = 0.0
    y_m: _Coordinate = 0.0


class MatrixTable(Settings):
    """What ways between places cost; rows are from, columns to, in the places' order."""

    places: Annotated[tuple[PlaceRow, ...], Field(min_length=1, max_length=MAX_PLACES)]
    euclidean: Rounding | None = Field(
        default=None,
        description="Distances are straight lines between the places: as they are, rounded to the "
        "nearest whole number, or cut to tenths.",
    )
    distances_m: _Matrix | None = Field(default=None, description="Instead of `euclidean`.")
    speed_mps: float | None = Field(
        default=None,
        gt=0,
        le=1e6,
        allow_inf_nan=False,
        description="Durations are distances at this speed.",
    )
    durations_s: _Matrix | None = Field(
        default=None, description="Instead of `speed_mps`; without either ways take no time."
    )
    energy_kwh: _Matrix | None = None
    minimise: Measure | None = Field(
        default=None,
        description="What routes minimise; left out: energy if it is given, else distance, else "
        "duration.",
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for one, other in (("euclidean", "distances_m"), ("speed_mps", "durations_s")):
            if getattr(self, one) is not None and getattr(self, other) is not None:
                raise ValueError(f"give {one} or {other}, not both")
        size = len(self.places)
        for name in ("distances_m", "durations_s", "energy_kwh"):
            rows: _Matrix | None = getattr(self, name)
            if rows is not None and (len(rows) != size or any(len(row) != size for row in rows)):
                raise ValueError(f"{name} has to have {size} rows of {size}, as there are places")
        has = self.known
        if not has:
            raise ValueError("no matrix: give euclidean, distances_m, durations_s or energy_kwh")
        if self.speed_mps is not None and "distance" not in has:
            raise ValueError("speed_mps needs distances")
        if self.minimise is not None and self.minimise not in has:
            raise ValueError(f"minimise is {self.minimise}, which is not given")
        return self

    @property
    def known(self) -> tuple[Measure, ...]:
        """What is known of ways, in the order of what is minimised."""
        distance = self.euclidean is not None or self.distances_m is not None
        duration = self.durations_s is not None or (distance and self.speed_mps is not None)
        found: tuple[tuple[Measure, bool], ...] = (
            ("energy", self.energy_kwh is not None),
            ("distance", distance),
            ("duration", duration),
        )
        return tuple(name for name, given in found if given)


class BestKnown(Settings):
    """The best solution that is known."""

    cost: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    source: _Name = Field(description="Where that is said.")
    comparable: bool = Field(
        default=True, description="Whether it counts the same distances as the instance."
    )
    note: str = Field(
        default="", max_length=200, description="How that is known, or why it is not."
    )


class MatrixFile(Settings):
    """A routing problem without roads."""

    format: Literal["slipstream-instance/1"]
    name: _Name
    provenance: str = Field(default="", max_length=2000, description="Where it comes from.")
    fleet: Fleet
    matrix: MatrixTable
    best_known: BestKnown | None = None
