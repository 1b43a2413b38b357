"""The vehicle ahead as a radar measures it, and the queue that it implies at a stop line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

_RANGE_M: Final = 100.0
_STANDING_GAP_M: Final = 2.5
_CAR_M: Final = 4.6
_TIME_GAP_S: Final = 1.2
_QUEUED_MPS: Final = 1.0


class LeadVehicle(NamedTuple):
    """The vehicle ahead.

    Attributes:
        name: of its track.
        gap_m: from the own standing gap to its back.
        speed_mps: its.
    """

    name: str
    gap_m: float
    speed_mps: float


Radar = Callable[[str], LeadVehicle | None]


def lead_vehicle(name: str) -> LeadVehicle | None:
    """The vehicle ahead of one of the running simulation; None: none in range."""
    import libsumo

    found = libsumo.vehicle.getLeader(name, _RANGE_M)
    if not found or not found[0] or found[1] > _RANGE_M:
        return None
    return LeadVehicle(found[0], float(found[1]), float(libsumo.vehicle.getSpeed(found[0])))


def queue_length(lead: LeadVehicle | None, line_m: float) -> int:
    """Vehicles that wait at a stop line, estimated from the last one.

    Args:
        lead: the vehicle ahead.
        line_m: distance to the stop line.
    """
    if lead is None or lead.speed_mps > _QUEUED_MPS:
        return 0
    before_m = line_m - lead.gap_m - _STANDING_GAP_M - _CAR_M
    if before_m < -_CAR_M:
        return 0
    return 1 + max(0, round(before_m / (_CAR_M + _STANDING_GAP_M)))


def is_closing(lead: LeadVehicle, speed_mps: float, slowing_mps2: float) -> bool:
    """Whether it is time to slow down gently behind a slower vehicle."""
    faster = speed_mps - lead.speed_mps
    if faster <= 0:
        return False
    return lead.gap_m - _TIME_GAP_S * lead.speed_mps <= 0.5 * faster * faster / slowing_mps2
