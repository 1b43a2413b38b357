"""The schema of instance files: one routing problem in one moment's traffic, as JSON or TOML.

For people: docs/instances.md.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, Field, StringConstraints, model_validator

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.traffic import MIN_SPEED_MPS
from slipstream.config import Settings
from slipstream.energy.consumption import PAPER_CAR, VehicleParameters
from slipstream.energy.drive import DrivingStyle
from slipstream.messages import Identifier
from slipstream.vehicle_types import VehicleClass

FORMAT: Final = "slipstream-instance/1"

# Upper bounds keep a slip of the keyboard from becoming a road without end.
_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Coordinate = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]
_Speed = Annotated[float, Field(ge=0, le=200, allow_inf_nan=False)]
_NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_Rate = Annotated[float, Field(ge=0.01, le=20, allow_inf_nan=False)]
_Name = Annotated[str, StringConstraints(min_length=1, max_length=200)]


class JunctionRow(Settings):
    """A junction of the road network."""

    id: Identifier
    x_m: _Coordinate
    y_m: _Coordinate
    signal: bool = Field(default=False, description="It has traffic lights.")


class AccessTable(Settings):
    """Who may use a segment; left out: everybody."""

    classes: tuple[VehicleClass, ...] | None = Field(
        default=None, description="Vehicle classes that may; left out: all."
    )
    max_height_m: _NotNegative | None = None
    max_width_m: _NotNegative | None = None
    max_length_m: _NotNegative | None = None
    max_mass_kg: _NotNegative | None = Field(default=None, description="Of the permitted mass.")
    class_speeds_mps: dict[VehicleClass, Annotated[float, Field(gt=0, le=200)]] = Field(
        default={}, description="Speed limits of classes, where they differ from the segment's."
    )


class SegmentRow(Settings):
    """A directed road segment."""

    id: Identifier
    start: Identifier = Field(description="Junction that it leaves.")
    end: Identifier = Field(description="Junction that it enters.")
    length_m: float = Field(gt=0, le=1e6, allow_inf_nan=False)
    speed_limit_mps: float = Field(gt=0, le=200, allow_inf_nan=False)
    lanes: int = Field(default=1, ge=1, le=100)
    shape: Annotated[tuple[tuple[_Coordinate, _Coordinate], ...], Field(min_length=2)] | None = (
        Field(default=None, description="Points of its centre line, m; left out: straight.")
    )
    access: AccessTable = AccessTable()


class TurnClassesRow(Settings):
    """A turn that not all may take."""

    segment: Identifier
    onto: Identifier
    classes: tuple[VehicleClass, ...] = Field(description="Vehicle classes that may.")


class TurnRow(Settings):
    """Where a vehicle may drive on from a segment."""

    segment: Identifier
    onto: tuple[Identifier, ...]


class NetworkTable(Settings):
    """The roads: written out, or a SUMO net in a file of its own."""

    name: _Name | None = Field(default=None, description="Left out: the instance's.")
    sumo_net: str | None = Field(
        default=None,
        min_length=1,
        description="Path of a .net.xml or .net.xml.gz, relative to the instance file; or 'demo'.",
    )
    junctions: tuple[JunctionRow, ...] = ()
    segments: tuple[SegmentRow, ...] = ()
    turns: tuple[TurnRow, ...] = Field(
        default=(),
        description="Segments without a row allow every turn but the one onto the way back.",
    )
    turn_classes: tuple[TurnClassesRow, ...] = Field(
        default=(), description="Turns without a row are for all classes."
    )

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.sumo_net is None) != bool(self.segments):
            raise ValueError("give either sumo_net, or junctions and segments")
        if self.sumo_net is not None and (
            self.junctions or self.turns or self.turn_classes or self.name is not None
        ):
            raise ValueError("sumo_net has its own name, junctions and turns")
        return self


class TrafficRow(Settings):
    """One segment's traffic, as an RSU and expectation give it."""

    segment: Identifier
    speed_mps: Annotated[float, Field(ge=MIN_SPEED_MPS, allow_inf_nan=False)] | None = Field(
        default=None, description="Planning speed; left out: the speed limit."
    )
    y_e: Literal[0, 1] | None = Field(
        default=None, description="Calm enough for close gaps; left out: unknown."
    )
    reason: _Name | None = Field(
        default=None,
        description="Why the gate is closed. Left out: open where y_e is 1, turbulent where it is "
        "0, unwatched where it is unknown.",
    )
    age_s: _NotNegative | None = None
    measured_speed_mps: _Speed | None = None
    mean_acceleration_mps2: float = Field(default=0.0, ge=-20, le=20, allow_inf_nan=False)
    acceleration_variance_m2ps4: float = Field(default=0.0, ge=0, le=400, allow_inf_nan=False)
    stops: _NotNegative | None = Field(
        default=None,
        le=100,
        description="Expected full stops of a passage; left out: stops_at_signals or 0.",
    )


class TrafficTable(Settings):
    """The traffic at one moment; segments without a row flow freely and are unwatched."""

    now_ns: int = Field(default=0, ge=0, lt=2**63, description="The moment, UTC.")
    stops_at_signals: _NotNegative = Field(
        default=0.0,
        le=100,
        description="Expected stops on segments that end at traffic lights, where no row says.",
    )
    segments: tuple[TrafficRow, ...] = ()


class StyleTable(Settings):
    """How fast speed is changed, m/s²."""

    acceleration_mps2: _Rate = DrivingStyle.acceleration_mps2
    braking_mps2: _Rate = DrivingStyle.braking_mps2


class RouteRow(Settings):
    """One vehicle's stops in order; one that stays at its depot has none."""

    vehicle: Identifier
    stops: tuple[Identifier, ...] = ()


class OptimumTable(Settings):
    """A solution that is proven to be the best, or else the best known one."""

    form: Literal["arc", "route"]
    objective_kwh: _Finite
    proven: bool
    method: _Name = Field(description="What found it, and what proves it.")
    routes: tuple[RouteRow, ...] = ()


def _with_stops(fleet: Fleet) -> Fleet:
    if not fleet.stops:
        raise ValueError("stops must not be empty; name one at least")
    return fleet


class InstanceFile(Settings):
    """A routing problem, its traffic, and what is known of its solution."""

    format: Literal["slipstream-instance/1"]
    name: _Name
    provenance: str = Field(default="", max_length=2000, description="Where it comes from.")
    sync_window_s: _NotNegative = Field(
        default=3.0, description="Entries no further apart than this can platoon."
    )
    network: NetworkTable
    fleet: Annotated[Fleet, AfterValidator(_with_stops)]
    traffic: TrafficTable = TrafficTable()
    vehicle: VehicleParameters = PAPER_CAR
    style: StyleTable = StyleTable()
    objective: Literal["paper", "energy"] = Field(
        default="paper",
        description="What a path costs: its segments at planning speed, or its exact drive.",
    )
    optimum: OptimumTable | None = Field(default=None, description="By the paper's objective.")
    energy_optimum: OptimumTable | None = Field(default=None, description="By the exact drives.")
