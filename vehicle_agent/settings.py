"""All settings of the agents' process: ``agent.toml``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from slipstream import freshness
from slipstream.braking import UNKNOWN_ROAD, Road
from slipstream.config import BusSettings, ServiceSettings, Settings
from slipstream.messages import Identifier
from slipstream.vehicle_types import PRESETS, VehicleType


class AgentVehicle(Settings):
    """One vehicle that has its agent in this process (``[[vehicles]]``)."""

    id: Identifier = Field(description="As in the fleet's file.")
    type: VehicleType = Field(
        default=PRESETS["paper_car"], description="As in the fleet's file: a preset, and changes."
    )


class AgentSettings(Settings):
    """Settings of `slipstream agent`."""

    vehicles: tuple[AgentVehicle, ...] = Field(
        min_length=1, max_length=1000, description="One on a telematics box, or a depot's."
    )
    state: Path = Field(
        default=Path("/var/lib/slipstream/agent"),
        description="Folder in which each vehicle's tour is kept over a restart.",
    )
    stale_after_s: Annotated[float, Field(gt=0, le=600)] = Field(
        default=freshness.STALE_AFTER_S,
        description="Age above which a segment's state counts for nothing, s; as the dispatcher's.",
    )
    road: Road = Field(
        default=UNKNOWN_ROAD,
        description="State of the roads, by which gaps and limits of braking follow. wet: also "
        "where nobody knows; dry only where it is known.",
    )
    bus: BusSettings = BusSettings()
    service: ServiceSettings = ServiceSettings()

    @model_validator(mode="after")
    def _each_vehicle_once(self) -> Self:
        names = [vehicle.id for vehicle in self.vehicles]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"vehicle {name!r} is listed twice")
        return self
