"""Travel costs c_ij over segments (paper section III-C), turbulent traffic included."""

from __future__ import annotations

import math

from dispatcher_daemon.traffic import SegmentTraffic
from slipstream.energy.consumption import steady_energy_kwh
from slipstream.roads import Segment
from slipstream.vehicle_types import RoutingProfile


def expected_traction_n(mean_n: float, std_n: float) -> float:
    """E[max(0, X)] for X ~ N(mean, std²): μΦ(μ/σ) + σφ(μ/σ).

    Braking recovers no energy, so the mean of the positive part counts, not the part of the mean.
    """
    if std_n <= 0:
        return max(0.0, mean_n)
    z = mean_n / std_n
    cumulative = 0.5 * math.erfc(-z / math.sqrt(2))
    density = math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
    return mean_n * cumulative + std_n * density


def planning_speed_mps(segment: Segment, traffic: SegmentTraffic, profile: RoutingProfile) -> float:
    """Speed that a vehicle is expected to hold: the traffic's, its top speed or its limit."""
    limit_mps = segment.access.speed_limit_mps(segment.speed_limit_mps, profile)
    top_mps = math.inf if profile.max_speed_mps is None else profile.max_speed_mps
    return min(traffic.speed_mps, limit_mps, top_mps)


def follows_traffic(traffic: SegmentTraffic) -> bool:
    """Whether a vehicle cannot hold the planning speed: traffic is known to be turbulent."""
    return traffic.y_e == 0 and traffic.measured_speed_mps is not None


def held_cost_kwh(segment: Segment, traffic: SegmentTraffic, profile: RoutingProfile) -> float:
    """Energy that a vehicle alone is expected to need for a segment without stops, kWh, > 0.

    It is on the segment at its planning speed; each expected stop costs the kinetic energy of that.

    Where traffic is not known to be turbulent, the vehicle holds the planning speed: the paper's
    c_ij with a = 0. A mean acceleration in a camera's short view does not hold for a whole segment,
    and its noise of some cm/s² would exceed drag.

    In turbulent traffic the vehicle follows the traffic, with a ~ N(ā, σ²_a), and the cost is that
    of the expected tractive force. There |ā| is limited to v²_limit/2d, the maximum for
    speeds between standstill and the limit over the segment's length d. What the vehicle
    recuperates is taken off.
    """
    vehicle, speed = profile.physics, planning_speed_mps(segment, traffic, profile)
    if not follows_traffic(traffic):
        return steady_energy_kwh(segment.length_m, speed, vehicle=vehicle)
    bound = segment.speed_limit_mps**2 / (2 * segment.length_m)
    mean_acceleration = min(bound, max(-bound, traffic.mean_acceleration_mps2))
    resistance_n = vehicle.rolling_force_n + vehicle.drag_force_n(speed)
    mean_n = vehicle.mass_kg * mean_acceleration + resistance_n
    std_n = vehicle.mass_kg * math.sqrt(traffic.acceleration_variance_m2ps4)
    traction_n = max(expected_traction_n(mean_n, std_n), 1.0)
    cost_kwh = vehicle.electrical_kwh(traction_n * segment.length_m)
    if vehicle.recuperation_efficiency > 0:
        braking_n = expected_traction_n(-mean_n, std_n)
        net_kwh = cost_kwh - vehicle.recovered_kwh(braking_n * segment.length_m)
        # Of a force of 1 N, as above: a cost is > 0.
        cost_kwh = max(net_kwh, vehicle.electrical_kwh(segment.length_m))
    return cost_kwh
