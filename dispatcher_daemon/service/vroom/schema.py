"""A request as VROOM's documentation describes it. As in VROOM, keys that are not listed here are
not read; `unread` says which.

Times are s, distances m, coordinates (longitude, latitude) in degrees.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from slipstream.config import Settings

_Whole = Annotated[int, Field(ge=0, lt=2**32)]
_Id = Annotated[int, Field(ge=0, lt=2**64)]
_Text = Annotated[str, Field(max_length=2000)]
_Longitude = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
_Latitude = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
Coordinates = tuple[_Longitude, _Latitude]
_Amount = Annotated[tuple[_Whole, ...], Field(max_length=50)]
_Matrix = Annotated[tuple[tuple[_Whole | None, ...], ...], Field(min_length=1, max_length=3000)]
_Skills = Annotated[tuple[_Whole, ...], Field(max_length=1000)]


class _Table(Settings):
    """A part of a request."""

    model_config = ConfigDict(extra="ignore")


class Window(_Table):
    """When something may begin; both ends are inclusive."""

    start: _Whole
    end: _Whole

    @model_validator(mode="before")
    @classmethod
    def _of_a_pair(cls, data: Any) -> Any:
        if isinstance(data, list | tuple) and len(data) == 2:
            return {"start": data[0], "end": data[1]}
        raise ValueError("a time window is a pair [start, end]")

    @model_validator(mode="after")
    def _is_open(self) -> Self:
        if self.end < self.start:
            raise ValueError(f"the window ends ({self.end}) before it starts ({self.start})")
        return self


_Windows = Annotated[tuple[Window, ...], Field(min_length=1, max_length=100)]


class TaskStep(_Table):
    """Where and when a task is performed; pickup and delivery of a shipment are one each."""

    id: _Id
    description: _Text | None = None
    location: Coordinates | None = None
    location_index: _Whole | None = None
    setup: _Whole = 0
    service: _Whole = 0
    setup_per_type: dict[str, _Whole] = Field(default_factory=dict)
    service_per_type: dict[str, _Whole] = Field(default_factory=dict)
    time_windows: _Windows | None = None


class VroomJob(TaskStep):
    """A single place to visit."""

    amount: _Amount | None = Field(default=None, description="Former name of `delivery`.")
    delivery: _Amount | None = None
    pickup: _Amount | None = None
    skills: _Skills = ()
    priority: int = Field(default=0, ge=0, le=100)


class Shipment(_Table):
    """What one vehicle picks up and delivers."""

    pickup: TaskStep
    delivery: TaskStep
    amount: _Amount | None = None
    skills: _Skills = ()
    priority: int = Field(default=0, ge=0, le=100)


class Costs(_Table):
    """What a vehicle costs; None: not given."""

    fixed: _Whole = 0
    per_hour: _Whole | None = None
    per_task_hour: _Whole = 0
    per_km: _Whole = 0


class VroomBreak(_Table):
    """A pause of the driver, anywhere."""

    id: _Id
    time_windows: _Windows | None = None
    service: _Whole = 0
    description: _Text | None = None
    max_load: _Amount | None = None


class VehicleStep(_Table):
    """A step of a route that the request describes."""

    type: Literal["start", "job", "pickup", "delivery", "break", "end"]
    id: _Id | None = None
    service_at: _Whole | None = None
    service_after: _Whole | None = None
    service_before: _Whole | None = None

    @model_validator(mode="after")
    def _names_its_task(self) -> Self:
        if (self.id is None) != (self.type in ("start", "end")):
            raise ValueError(f"a step of type {self.type!r} has an id, but for start and end")
        return self


class VroomVehicle(_Table):
    """One vehicle."""

    id: _Id
    profile: Annotated[str, Field(min_length=1, max_length=200)] = "car"
    description: _Text | None = None
    start: Coordinates | None = None
    start_index: _Whole | None = None
    end: Coordinates | None = None
    end_index: _Whole | None = None
    capacity: _Amount = ()
    costs: Costs = Costs()
    skills: _Skills = ()
    type: _Text = ""
    time_window: Window | None = None
    breaks: Annotated[tuple[VroomBreak, ...], Field(max_length=20)] = ()
    speed_factor: float = Field(default=1.0, gt=0, le=5, allow_inf_nan=False)
    max_tasks: _Whole | None = None
    max_travel_time: _Whole | None = None
    max_distance: _Whole | None = None
    steps: tuple[VehicleStep, ...] = ()

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        places = self.start, self.start_index, self.end, self.end_index
        if all(place is None for place in places):
            raise ValueError("no start or end")
        return self


class ProfileMatrices(_Table):
    """Matrices of one profile, (from, to); see `given_matrices` for where no way leads."""

    durations: _Matrix | None = None
    distances: _Matrix | None = None
    costs: _Matrix | None = None

    @model_validator(mode="after")
    def _are_square(self) -> Self:
        sizes = set()
        for name in ("durations", "distances", "costs"):
            matrix = getattr(self, name)
            if matrix is not None:
                sizes.add(len(matrix))
                if any(len(row) != len(matrix) for row in matrix):
                    raise ValueError(f"{name} is not square")
        if len(sizes) > 1:
            raise ValueError("matrices of different sizes")
        if self.distances is not None and self.durations is None:
            raise ValueError("distances need durations")
        return self


class Request(_Table):
    """A vehicle routing problem."""

    jobs: tuple[VroomJob, ...] = ()
    shipments: tuple[Shipment, ...] = ()
    vehicles: Annotated[tuple[VroomVehicle, ...], Field(min_length=1, max_length=2000)]
    matrices: dict[str, ProfileMatrices] | None = None
    matrix: _Matrix | None = Field(
        default=None, description="Former form of the durations of profile car."
    )

    @model_validator(mode="after")
    def _has_a_task(self) -> Self:
        if not self.jobs and not self.shipments:
            raise ValueError("no task: give jobs or shipments")
        return self

    @property
    def profile_matrices(self) -> dict[str, ProfileMatrices]:
        """Given matrices by profile."""
        if not self.matrices and self.matrix is not None:
            return {"car": ProfileMatrices(durations=self.matrix)}
        return dict(self.matrices or {})
