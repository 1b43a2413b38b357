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
electromechanical brakes. car, van: hydraulic brakes. truck: pneumatic ones, up to 40 t. A truck's
values are the fields' defaults."""

_ROADS: Final[tuple[Road, ...]] = ("dry", "wet", "snow")

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

    def commanded_mps2(self, most_mps2: float) -> float:
        """The deceleration to command where no more than `most_mps2` may come of it, m/s²."""
        return most_mps2 / (1 + self.error)


_Deceleration = Annotated[float, Field(gt=0, le=GREATEST_MPS2, allow_inf_nan=False)]
_Seconds = Annotated[float, Field(ge=0, le=2, allow_inf_nan=False)]
_Tolerance = Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)]


class DecelerationByRoad(Settings):
    """Deceleration of full braking by state of the road, m/s²."""

    dry: _Deceleration = Field(description="On dry asphalt.")
    wet: _Deceleration = Field(description="On wet asphalt, without aquaplaning.")
    snow: _Deceleration = Field(description="On packed snow.")

    def on(self, road: Road) -> float:
        """That of one state."""
        return {"dry": self.dry, "wet": self.wet, "snow": self.snow}[road]


class BrakingData(Settings):
    """Brakes of vehicles of one type. What is not given is the class's."""

    preset: BrakingClass = Field(
        default="truck", description="Class whose values hold for what is not given."
    )
    guaranteed_mps2: DecelerationByRoad = Field(
        default=DecelerationByRoad(dry=5.0, wet=3.5, snow=1.2),
        description="Deceleration that full braking reaches at every permitted load.",
    )
    greatest_mps2: DecelerationByRoad = Field(
        default=DecelerationByRoad(dry=7.5, wet=6.5, snow=3.5),
        description="The most that it may reach.",
    )
    dead_s: _Seconds = Field(
        default=0.25, description="From a command to the first change, nominal."
    )
    lag_s: _Seconds = Field(default=0.25, description="Time constant of that change, nominal.")
    tolerance: _Tolerance = Field(
        default=0.2,
        description="Share by which dead time and time constant may be longer or shorter.",
    )
    error: _Tolerance = Field(
        default=0.08, description="Share by which a commanded deceleration is missed."
    )
    sensing_s: _Seconds = Field(
        default=0.1, description="Age of a sensed gap when the agent has it."
    )
    emergency_brake: bool = Field(
        default=True,
        description="It brakes by its own sensors where its agent does not. Without it no close "
        "gap is kept.",
    )

    @model_validator(mode="before")
    @classmethod
    def _begin_with_the_class(cls, data: Any) -> Any:
        # What is no class is left to the field's own check.
        preset = data.get("preset") if isinstance(data, Mapping) else None
        values = _CLASS_VALUES.get(preset) if isinstance(preset, str) else None
        return data if values is None else {**values, **data}

    @model_validator(mode="after")
    def _decelerations_are_in_order(self) -> Self:
        for road in _ROADS:
            guaranteed, greatest = self.guaranteed_mps2.on(road), self.greatest_mps2.on(road)
            if guaranteed > greatest:
                raise ValueError(
                    f"guaranteed_mps2.{road} ({guaranteed:g}) must not be above "
                    f"greatest_mps2.{road} ({greatest:g})"
                )
        return self

    def on(self, road: Road) -> Braking:
        """What they do on a road."""
        return Braking(
            self.guaranteed_mps2.on(road),
            self.greatest_mps2.on(road),
            self.dead_s,
            self.lag_s,
            self.tolerance,
            self.error,
            self.sensing_s,
            self.emergency_brake,
        )


HARDEST_MPS2: Final[Mapping[Road, float]] = MappingProxyType({"dry": 9.8, "wet": 8.0, "snow": 4.0})
"""The most that any vehicle of a road brakes with."""

_CLASS_VALUES: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "ideal": {
            "guaranteed_mps2": {"dry": 9.0, "wet": 9.0, "snow": 9.0},
            "greatest_mps2": {"dry": 9.0, "wet": 9.0, "snow": 9.0},
            "dead_s": 0.0,
            "lag_s": 0.0,
            "tolerance": 0.0,
            "error": 0.0,
            "sensing_s": 0.0,
        },
        "brake_by_wire": {
            "guaranteed_mps2": {"dry": 7.0, "wet": 5.0, "snow": 1.5},
            "greatest_mps2": {"dry": 9.8, "wet": 8.0, "snow": 4.0},
            "dead_s": 0.05,
            "lag_s": 0.05,
            "error": 0.03,
        },
        "car": {
            "guaranteed_mps2": {"dry": 6.4, "wet": 4.5, "snow": 1.5},
            "greatest_mps2": {"dry": 9.8, "wet": 8.0, "snow": 4.0},
            "dead_s": 0.2,
            "lag_s": 0.2,
            "error": 0.05,
        },
        "van": {
            "guaranteed_mps2": {"dry": 5.8, "wet": 4.2, "snow": 1.5},
            "greatest_mps2": {"dry": 9.5, "wet": 7.5, "snow": 4.0},
            "dead_s": 0.2,
            "lag_s": 0.2,
            "error": 0.05,
        },
    }
)

BRAKING: Final[Mapping[BrakingClass, BrakingData]] = MappingProxyType(
    {
        "ideal": BrakingData(preset="ideal"),
        "brake_by_wire": BrakingData(preset="brake_by_wire"),
        "car": BrakingData(preset="car"),
        "van": BrakingData(preset="van"),
        "truck": BrakingData(),
    }
)
"""Brakes by class."""
