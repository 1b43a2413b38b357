"""The value of time of a leg in W, by which speed advice trades time for energy.

Driving a leg at the limit without coasting reveals a smallest value of time: with a factor f on all
speeds, E(f) = Σ (r + k f²v²) L/η + Σ ½m ((f v)² − v_t²)/η over segments and places
where speed must be lower, and T(f) = Σ L/(f v). Driving at the limit is optimal only for

    p = −(dE/df) / (dT/df) at f = 1 = (Σ 2 k v² L + Σ m v²) / (η Σ L/v)

Coasting at that value saves more than driving slower everywhere in the same time. Where it would
take more time than the budget, the value is raised until it does not: one value for a whole leg is
optimal for a budget (it is the constraint's Lagrange multiplier).
"""

from __future__ import annotations

from typing import Final

from slipstream.energy.traction import PAPER_CAR, VehicleParameters
from vehicle_agent.leg import Leg
from vehicle_agent.speed.coasting import CoastingModel

_MAX_VALUE: Final = 64.0
"""Factor on the smallest value, at which coasting adds almost no time."""

_HALVINGS: Final = 20


def limit_before(leg: Leg, at_m: float) -> float:
    """The limit just before a place on a leg."""
    found = leg.limits_mps[0]
    for begin_m, limit in zip(leg.begins_m, leg.limits_mps, strict=True):
        if begin_m >= at_m:
            break
        found = limit
    return found


def revealed_value_of_time_w(leg: Leg, vehicle: VehicleParameters = PAPER_CAR) -> float:
    """The price of time at which driving at the limit is best, without rolling, W."""
    pieces = [
        (end - begin, limit)
        for begin, end, limit in zip(leg.begins_m, leg.ends_m, leg.limits_mps, strict=True)
    ]
    drag_j = sum(2 * vehicle.drag_factor_kgpm * v * v * length for length, v in pieces)
    braked_j = sum(vehicle.mass_kg * limit_before(leg, slow.at_m) ** 2 for slow in leg.slow)
    seconds = sum(length / v for length, v in pieces)
    return (drag_j + braked_j) / (vehicle.powertrain_efficiency * seconds)


def leg_value_of_time_w(
    leg: Leg,
    budget_s: float,
    coasting: CoastingModel,
    braking_mps2: float,
    vehicle: VehicleParameters = PAPER_CAR,
) -> float:
    """The price of time for a leg: the revealed one, or what spends no more than the budget, W."""
    min_w = revealed_value_of_time_w(leg, vehicle)
    before = [limit_before(leg, slow.at_m) for slow in leg.slow]

    def lost_s(value_of_time_w: float) -> float:
        return sum(
            coasting.lost_s(limit, slow.speed_mps, value_of_time_w, braking_mps2)
            for limit, slow in zip(before, leg.slow, strict=True)
        )

    low, high = min_w, min_w * _MAX_VALUE
    if lost_s(low) <= budget_s:
        return low
    for _ in range(_HALVINGS):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if lost_s(middle) > budget_s else (low, middle)
    return high
