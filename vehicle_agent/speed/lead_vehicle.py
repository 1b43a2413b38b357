"""What the vehicle ahead tells of the road: the queue at a stop line, and whether to slow down."""

from __future__ import annotations

from typing import Final

from slipstream.messages import SensedVehicle

_STANDING_GAP_M: Final = 2.5
_CAR_M: Final = 4.6
_TIME_GAP_S: Final = 1.2
_QUEUED_MPS: Final = 1.0


def queue_length(lead: SensedVehicle | None, line_m: float) -> int:
    """Vehicles that wait at a stop line, estimated from the last one, the vehicle ahead."""
    if lead is None or lead.speed_mps > _QUEUED_MPS:
        return 0
    before_m = line_m - lead.gap_m - _CAR_M
    if before_m < -_CAR_M:
        return 0
    return 1 + max(0, round(before_m / (_CAR_M + _STANDING_GAP_M)))


def is_closing(lead: SensedVehicle, speed_mps: float, slowing_mps2: float) -> bool:
    """Whether it is time to slow down gently behind a slower vehicle."""
    faster = speed_mps - lead.speed_mps
    if faster <= 0:
        return False
    free_m = lead.gap_m - _STANDING_GAP_M - _TIME_GAP_S * lead.speed_mps
    return free_m <= 0.5 * faster * faster / slowing_mps2
