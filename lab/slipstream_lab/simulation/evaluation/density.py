"""One fleet at other densities: the law by which its orders and vehicles are scaled.

A fleet that makes T tours a day (docs/scenarios.md; the corridor's: 29) has at N vehicles a day
N / T times its orders and vehicles; both rounded, at least one. Everything else of the fleet stays:
places, hours, waves, windows, services, capacity. Orders are drawn from the same seeds, so those of
another density are other orders.
"""

from __future__ import annotations

from slipstream.errors import InputError
from slipstream_lab.simulation.scenarios.demand import FleetSettings, draw_deliveries
from slipstream_lab.simulation.scenarios.scenario import Scenario
from slipstream_lab.simulation.scenarios.sizing import fleet_size

_SEED = 1


def tours(scenario: Scenario) -> int:
    """Tours of the scenario's fleet on the day of seed 1, on empty roads, without platooning.
    Raises InputError: it makes none.
    """
    deliveries = draw_deliveries(scenario.fleet, scenario.network, _SEED)
    found = fleet_size(deliveries, scenario.network).rounds
    if not found:
        problem = "no vehicle of the fleet can serve an order in time"
        raise InputError(scenario.name, problem, "give a fleet with more time", key="--fleet")
    return found


def scaled(settings: FleetSettings, vehicles: int, own: int, key: str) -> FleetSettings:
    """A fleet that makes `own` tours a day, with so many. Raises InputError: more orders or
    vehicles than a fleet can have.
    """
    share = vehicles / own
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
