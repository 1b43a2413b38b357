"""Plans and sensing for tests of tours and agents: a depot, two customers, straight roads."""

from __future__ import annotations

from typing import Any

from slipstream.messages import (
    DriverReport,
    DrivingAdvice,
    PlannedSegment,
    PlannedStop,
    SensedVehicle,
    VehiclePlan,
    VehicleSensing,
)
from tests.vehicle_agent.road import crossing, ns, segment

VAN = "van"
ROADS = {0: ("out1", "out2"), 1: ("on1",), 2: ("home1", "home2")}
"""Segments of each leg: depot → a → b → depot."""


def stop(name: str, arrival_s: float, departure_s: float, **fields: Any) -> PlannedStop:
    """A stop of a plan."""
    return PlannedStop(
        stop=name,
        node=f"at {name}",
        arrival_ns=ns(arrival_s),
        departure_ns=ns(departure_s),
        **fields,
    )


def segments(*, leg: int, first: int = 0, **fields: Any) -> list[PlannedSegment]:
    """The segments of a leg, from one of them on."""
    names = ROADS[leg][first:]
    return [
        segment(name, 300.0, onward=None if name == names[-1] else crossing()).model_copy(
            update={"leg": leg, **fields}
        )
        for name in names
    ]


def plan(cycle: int = 1, **fields: Any) -> VehiclePlan:
    """Depot, a, b, depot."""
    told: dict[str, Any] = {
        "vehicle": VAN,
        "cycle": cycle,
        "issued_ns": ns(0),
        "valid_until_ns": ns(10_000),
        "depart_ns": ns(60),
        "stops": (
            stop("depot", 60, 60),
            stop("a", 120, 180),
            stop("b", 210, 270),
            stop("depot", 330, 330),
        ),
        "segments": (*segments(leg=0), *segments(leg=1), *segments(leg=2)),
        "distance_m": 1500.0,
        "energy_kwh": 0.2,
        "advice": DrivingAdvice(),
    }
    return VehiclePlan.model_validate(told | fields)


def continued(cycle: int, continues: int, number: int, **fields: Any) -> VehiclePlan:
    """The rest of `plan` from its leg of that number on."""
    whole = plan(cycle, continues=continues)
    rest = tuple(
        part.model_copy(update={"leg": part.leg - number})
        for part in whole.segments
        if part.leg >= number
    )
    return whole.model_copy(update={"stops": whole.stops[number:], "segments": rest, **fields})


def sensing(
    time_s: float, name: str = "out1", front_m: float = 0.0, *, on_road: bool = True, **fields: Any
) -> VehicleSensing:
    """What the vehicle senses."""
    told: dict[str, Any] = {
        "vehicle": VAN,
        "time_ns": ns(time_s),
        "on_road": on_road,
        "segment": name,
        "crossing": False,
        "lane": 0,
        "front_m": front_m,
        "speed_mps": 10.0 if on_road else 0.0,
        "acceleration_mps2": 0.0,
        "driven_m": 0.0,
        "ahead": None,
        "behind": None,
    }
    return VehicleSensing.model_validate(told | fields)


def ahead(gap_m: float, speed_mps: float, vehicle: str | None = None) -> SensedVehicle:
    """A vehicle in front."""
    return SensedVehicle(track="t", vehicle=vehicle, gap_m=gap_m, speed_mps=speed_mps)


def report(
    time_s: float, event: Any, stop_id: str | None, reason: str | None = None
) -> DriverReport:
    """What the driver says."""
    return DriverReport(vehicle=VAN, time_ns=ns(time_s), event=event, stop=stop_id, reason=reason)
