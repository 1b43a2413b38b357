"""Vehicles of the scenarios.

All follow the IDM without noise: a noisy car-following model would make any smoother driving look
like a saving.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import quoteattr


@dataclass(frozen=True)
class SumoVehicleType:
    """A type of vehicle."""

    id: str
    vclass: str
    length_m: float
    max_speed_mps: float
    acceleration_mps2: float
    deceleration_mps2: float
    time_gap_s: float
    min_gap_m: float = 2.5

    def xml(self) -> str:
        """As SUMO reads it. Speed factors are each vehicle's own, none is drawn.

        Drivers choose their lane early (lcStrategic), else some never reach it in a queue.
        """
        return (
            f'<vType id={quoteattr(self.id)} vClass="{self.vclass}" carFollowModel="IDM" '
            f'length="{self.length_m:g}" minGap="{self.min_gap_m:g}" '
            f'maxSpeed="{self.max_speed_mps:g}" accel="{self.acceleration_mps2:g}" '
            f'decel="{self.deceleration_mps2:g}" emergencyDecel="9" tau="{self.time_gap_s:g}" '
            f'lcStrategic="3" speedFactor="1" speedDev="0"/>'
        )


TYPES: Final = {
    kind.id: kind
    for kind in (
        SumoVehicleType("car", "passenger", 4.6, 55.0, 1.8, 2.5, 1.2),
        SumoVehicleType("van", "delivery", 5.9, 40.0, 1.5, 2.5, 1.3),
        SumoVehicleType("truck", "truck", 10.0, 25.0, 0.9, 2.0, 1.6),
        SumoVehicleType("cav", "passenger", 4.6, 55.0, 1.8, 2.5, 1.2),
    )
}
"""The background's cars, vans and trucks, and the fleet's: a car like the others where it drives
alone."""

FLEET_TYPES: Final = ("cav", "cav-platoon", "cav-close")
"""Types of the fleet's vehicles that drive alone, that are in a platoon, and that follow closely by
their own brakes; no type of the background has these names."""

FLEET_PREFIX: Final = "cav/"
"""SUMO ids of the fleet's vehicles begin with it; no id of the background does."""
