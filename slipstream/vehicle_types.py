"""Vehicles as they are: physical data, legal class, dimensions and battery, with presets.

Sources of the presets' values: docs/vehicles.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from slipstream.braking import BRAKING, UNKNOWN_ROAD, Braking, BrakingClass, BrakingData
from slipstream.config import Settings
from slipstream.energy.drafting import DragLaw
from slipstream.energy.traction import PAPER_CAR, VehicleParameters

VehicleClass = Literal[
    "passenger",
    "taxi",
    "delivery",
    "truck",
    "trailer",
    "bus",
    "coach",
    "motorcycle",
    "moped",
    "bicycle",
    "evehicle",
    "emergency",
    "authority",
]
"""Legal class of a road vehicle, by SUMO's names (vClass); a trailer is a truck with one."""

PresetName = Literal["paper_car", "van", "truck_40t"]

_CAR_BRAKING: Final = BRAKING["car"].on(UNKNOWN_ROAD)

_Positive = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
_NotNegative = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
_Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


@dataclass(frozen=True)
class RoutingProfile:
    """What of a vehicle decides by which ways it goes, and at what cost.

    Vehicles of one profile share paths, costs and travel times.

    Attributes:
        physics: for energies, with the load.
        vehicle_class: whose permissions it has.
        max_speed_mps: it drives no faster; None: as fast as the roads allow.
        height_m: None: not known, so that no limit of a road applies.
        width_m: likewise.
        length_m: likewise.
        gross_mass_kg: its permitted mass; likewise.
        drafting: by which law its drag falls in a platoon.
        braking: by which the gaps in a platoon follow.
    """

    physics: VehicleParameters = PAPER_CAR
    vehicle_class: VehicleClass = "passenger"
    max_speed_mps: float | None = None
    height_m: float | None = None
    width_m: float | None = None
    length_m: float | None = None
    gross_mass_kg: float | None = None
    drafting: DragLaw = "paper"
    braking: Braking = _CAR_BRAKING


class VehicleType(Settings):
    """Data of vehicles of one type. What is not given is the preset's."""

    preset: PresetName = Field(
        default="paper_car", description="Whose values hold for what is not given."
    )
    mass_kg: _Positive = Field(
        default=PAPER_CAR.mass_kg, description="Empty, with driver and battery."
    )
    load_kg: _NotNegative = Field(
        default=0.0, description="Load that energies are computed with, on the whole tour."
    )
    gross_mass_kg: _Positive | None = Field(
        default=None,
        description="Permitted mass with load; weight limits of roads count it. None: not known, "
        "so that neither payload nor road is limited.",
    )
    drag_coefficient: _Positive = Field(default=PAPER_CAR.drag_coefficient, description="C_d.")
    frontal_area_m2: _Positive = Field(default=PAPER_CAR.frontal_area_m2, description="A.")
    rolling_resistance: _Positive = Field(default=PAPER_CAR.rolling_resistance, description="f_r.")
    powertrain_efficiency: Annotated[_Positive, Field(le=1)] = Field(
        default=PAPER_CAR.powertrain_efficiency, description="η_elec, from battery to wheels."
    )
    recuperation_efficiency: _Share = Field(
        default=0.0, description="Share of braking work that comes back into the battery."
    )
    drafting: DragLaw = Field(
        default="paper",
        description="Drag reduction in platoons: the paper's constants, or measured by place and "
        "gap.",
    )
    braking: BrakingData | None = Field(
        default=None,
        description="Brakes, by which gaps in platoons follow; None: those of the worst of its "
        "vehicle_class.",
    )
    length_m: _Positive | None = Field(default=None, description="None: not known.")
    width_m: _Positive | None = Field(default=None, description="None: not known.")
    height_m: _Positive | None = Field(default=None, description="None: not known.")
    max_speed_mps: _Positive | None = Field(
        default=None, description="None: as fast as the roads allow."
    )
    vehicle_class: VehicleClass = Field(
        default="passenger", description="Legal class, by SUMO's names."
    )
    battery_kwh: _Positive | None = Field(
        default=None, description="Usable capacity; None: charge is not looked at."
    )
    battery_reserve: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = Field(
        default=0.1, description="Share of the capacity that plans leave untouched."
    )
    charging_power_kw: _Positive | None = Field(
        default=None, description="Most that it takes; None: what the place gives."
    )

    @model_validator(mode="before")
    @classmethod
    def _begin_with_the_preset(cls, data: Any) -> Any:
        # The default and whatever is no preset are left to the fields' own checks.
        preset = data.get("preset") if isinstance(data, Mapping) else None
        values = _PRESET_VALUES.get(preset) if isinstance(preset, str) else None
        return data if values is None else {**values, **data}

    @model_validator(mode="after")
    def _mass_is_permitted(self) -> Self:
        mass_kg = self.mass_kg + self.load_kg
        if self.gross_mass_kg is not None and mass_kg > self.gross_mass_kg:
            raise ValueError(
                f"mass_kg and load_kg ({mass_kg:g} together) must not be above "
                f"gross_mass_kg ({self.gross_mass_kg:g})"
            )
        return self

    @property
    def payload_kg(self) -> float | None:
        """What it may carry; None: not known."""
        return None if self.gross_mass_kg is None else self.gross_mass_kg - self.mass_kg

    @property
    def profile(self) -> RoutingProfile:
        """What decides by which ways it goes, and at what cost."""
        physics = VehicleParameters(
            mass_kg=self.mass_kg + self.load_kg,
            drag_coefficient=self.drag_coefficient,
            frontal_area_m2=self.frontal_area_m2,
            rolling_resistance=self.rolling_resistance,
            powertrain_efficiency=self.powertrain_efficiency,
            recuperation_efficiency=self.recuperation_efficiency,
        )
        return RoutingProfile(
            physics,
            self.vehicle_class,
            self.max_speed_mps,
            self.height_m,
            self.width_m,
            self.length_m,
            self.gross_mass_kg,
            self.drafting,
            self.brakes.on(UNKNOWN_ROAD),
        )

    @property
    def brakes(self) -> BrakingData:
        """Its brakes: as given, else those of the worst of its class."""
        return self.braking or BRAKING[_BRAKES.get(self.vehicle_class, "truck")]


_BRAKES: Final[Mapping[VehicleClass, BrakingClass]] = MappingProxyType(
    {
        "passenger": "car",
        "taxi": "car",
        "evehicle": "car",
        "authority": "van",
        "emergency": "van",
        "delivery": "van",
    }
)
"""Brakes by legal class; of all others: "truck"."""

_PRESET_VALUES: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "van": {
            "mass_kg": 2455.0,
            "load_kg": 520.0,
            "gross_mass_kg": 3500.0,
            "drag_coefficient": 0.45,
            "frontal_area_m2": 4.1,
            "rolling_resistance": 0.008,
            "powertrain_efficiency": 0.83,
            "recuperation_efficiency": 0.73,
            "drafting": "van",
            "length_m": 6.5,
            "width_m": 2.16,
            "height_m": 2.86,
            "max_speed_mps": 33.3,
            "vehicle_class": "delivery",
            "battery_kwh": 35.0,
            "charging_power_kw": 20.0,
        },
        "truck_40t": {
            "mass_kg": 18000.0,
            "load_kg": 11000.0,
            "gross_mass_kg": 40000.0,
            "drag_coefficient": 0.473,
            "frontal_area_m2": 10.0,
            "rolling_resistance": 0.0055,
            "powertrain_efficiency": 0.83,
            "recuperation_efficiency": 0.73,
            "drafting": "truck",
            "length_m": 16.5,
            "width_m": 2.55,
            "height_m": 4.0,
            "max_speed_mps": 25.0,
            "vehicle_class": "trailer",
            "battery_kwh": 621.0,
            "charging_power_kw": 400.0,
        },
    }
)

PRESETS: Final[Mapping[str, VehicleType]] = MappingProxyType(
    {
        "paper_car": VehicleType(),
        "van": VehicleType(preset="van"),
        "truck_40t": VehicleType(preset="truck_40t"),
    }
)
"""Vehicle types by name; the paper's car has no battery to run empty, nor dimensions."""
