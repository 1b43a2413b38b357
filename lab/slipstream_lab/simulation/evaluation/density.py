"""One fleet at other densities: the law by which its orders and vehicles are scaled.

N vehicles a day are N / 29 times the corridor's 66 orders and 18 vehicles, which make 29 tours a
day (docs/scenarios.md); both rounded, at least one. Everything else of the fleet stays: places,
hours, waves, windows, services, capacity. Orders are drawn from the same seeds, so those of another
density are other orders.
"""

from __future__ import annotations

from typing import Final

from slipstream.errors import InputError
from slipstream_lab.simulation.scenarios.demand import FleetSettings

TOURS: Final = 29
"""A day, of the corridor's fleet."""


def scaled(settings: FleetSettings, vehicles: int, key: str) -> FleetSettings:
    """The corridor's fleet with so many tours a day. Raises InputError: more orders or vehicles
    than a fleet can have.
    """
    share = vehicles / TOURS
    counts = {
        "orders": max(1, round(share * settings.orders)),
        "vehicles": max(1, round(share * settings.vehicles)),
    }
    try:
        return FleetSettings.model_validate(settings.model_dump() | counts)
    except ValueError:
        raise InputError(
            "evaluate", f"{vehicles} vehicles a day are too many", "give fewer", key=key
        ) from None
