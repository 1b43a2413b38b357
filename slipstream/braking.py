"""How hard and how fast vehicles brake: by class and by the state of the road.

A commanded deceleration comes after a dead time, and then as a first-order lag: it is `response_s`
late at most, the sum of both at their tolerance. Sources of the classes' values: docs/safety.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from slipstream.config import Settings

Road = Literal["dry", "wet", "snow"]
"""State of a road's surface."""

BrakingClass = Literal["ideal", "brake_by_wire", "car", "van", "truck"]
"""ideal: the paper's vehicle, which does at once what it is told. brake_by_wire: a car with
electromechanical brakes. car, van: hydraulic brakes. truck: pneumatic ones, up to 40 t."""

GREATEST_MPS2: Final = 11.0
"""No road vehicle brakes harder: tyres hold no more."""

UNKNOWN_ROAD: Final[Road] = "wet"
"""Taken where nobody says how the road is."""


@dataclass(frozen=True, slots=True)
class Braking:
    """What a vehicle's brakes do on a road as it is.

    Attributes:
        guaranteed_mps2: that full braking reaches at every permitted load.
        greatest_mps2: that it may reach at most.
        dead_s: from a command to the first change of the acceleration, nominal.
        lag_s: time constant of that change, nominal.
        tolerance: share by which either of both may be longer or shorter.
        error: share by which a commanded deceleration may be missed.
        sensing_s: age of a sensed gap when the agent has it.
        emergency_brake: whether the vehicle brakes by its own sensors where its agent does not.
    """

    guaranteed_mps2: float
    greatest_mps2: float
    dead_s: float
    lag_s: float
    tolerance: float
    error: float
    sensing_s: float
    emergency_brake: bool

    @property
    def nominal_s(self) -> float:
        """From a command to its effect, as expected."""
        return self.dead_s + self.lag_s

    @property
    def response_s(self) -> float:
        """The same at most."""
        return (1 + self.tolerance) * self.nominal_s


_PerRoad = Mapping[Road, Annotated[float, Field(gt=0, le=GREATEST_MPS2, allow_inf_nan=False)]]
_Seconds = Annotated[float, Field(ge=0, le=2, allow_inf_nan=False)]
_Tolerance = Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)]


class BrakingData(Settings):
    """Brakes of vehicles of one type. What is not given is the class's."""

    preset: BrakingClass = Field(
        default="truck", description="Class whose values hold for what is not given."
    )
    guaranteed_mps2: _PerRoad = Field(
        description="Deceleration that full braking reaches at every permitted load, by state of "
        "the road, m/s².",
    )
    greatest_mps2: _PerRoad = Field(description="The most that it may reach, likewise.")
    dead_s: _Seconds = Field(description="From a command to the first change, nominal.")
    lag_s: _Seconds = Field(description="Time constant of that change, nominal.")
    tolerance: _Tolerance = Field(
        description="Share by which dead time and time constant may be longer or shorter."
    )
    error: _Tolerance = Field(description="Share by which a commanded deceleration is missed.")
    sensing_s: _Seconds = Field(description="Age of a sensed gap when the agent has it.")
    emergency_brake: bool = Field(
        description="It brakes by its own sensors where its agent does not. Without it no close "
        "gap is kept."
    )

    @model_validator(mode="before")
    @classmethod
    def _begin_with_the_class(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        values = _CLASS_VALUES.get(data.get("preset", "truck"))
        return data if values is None else {**values, **data}

    @model_validator(mode="after")
    def _decelerations_are_in_order(self) -> Self:
        for road in _ROADS:
            if road not in self.guaranteed_mps2 or road not in self.greatest_mps2:
                raise ValueError(f"guaranteed_mps2 and greatest_mps2 need a value for {road}")
            if self.guaranteed_mps2[road] > self.greatest_mps2[road]:
                raise ValueError(
                    f"guaranteed_mps2.{road} ({self.guaranteed_mps2[road]:g}) must not be above "
                    f"greatest_mps2.{road} ({self.greatest_mps2[road]:g})"
                )
        return self

    def on(self, road: Road) -> Braking:
        """What they do on a road."""
        return Braking(
            self.guaranteed_mps2[road],
            self.greatest_mps2[road],
            self.dead_s,
            self.lag_s,
            self.tolerance,
            self.error,
            self.sensing_s,
            self.emergency_brake,
        )


_ROADS: Final[tuple[Road, ...]] = ("dry", "wet", "snow")


def _class(
    guaranteed: tuple[float, float, float],
    greatest: tuple[float, float, float],
    dead_s: float,
    lag_s: float,
    error: float,
    *,
    tolerance: float = 0.2,
    sensing_s: float = 0.1,
) -> Mapping[str, Any]:
    return {
        "guaranteed_mps2": dict(zip(_ROADS, guaranteed, strict=True)),
        "greatest_mps2": dict(zip(_ROADS, greatest, strict=True)),
        "dead_s": dead_s,
        "lag_s": lag_s,
        "tolerance": tolerance,
        "error": error,
        "sensing_s": sensing_s,
        "emergency_brake": True,
    }


HARDEST_MPS2: Final[Mapping[Road, float]] = MappingProxyType({"dry": 9.8, "wet": 8.0, "snow": 4.0})
"""The most that any vehicle of a road brakes with."""

_CLASS_VALUES: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "ideal": _class(
            (9.0, 9.0, 9.0), (9.0, 9.0, 9.0), 0.0, 0.0, 0.0, tolerance=0.0, sensing_s=0.0
        ),
        "brake_by_wire": _class((7.0, 5.0, 1.5), (9.8, 8.0, 4.0), 0.05, 0.05, 0.03),
        "car": _class((6.4, 4.5, 1.5), (9.8, 8.0, 4.0), 0.2, 0.2, 0.05),
        "van": _class((5.8, 4.2, 1.5), (9.5, 7.5, 4.0), 0.2, 0.2, 0.05),
        "truck": _class((5.0, 3.5, 1.2), (7.5, 6.5, 3.5), 0.25, 0.25, 0.08),
    }
)

BRAKING: Final[Mapping[BrakingClass, BrakingData]] = MappingProxyType(
    {name: BrakingData(preset=name) for name in ("ideal", "brake_by_wire", "car", "van", "truck")}  # type: ignore[call-arg]
)
"""Brakes by class."""
