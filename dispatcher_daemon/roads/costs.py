"""Travel costs c_ij over segments (paper section III-C), turbulent traffic included."""

from __future__ import annotations

import math

from dispatcher_daemon.traffic import SegmentTraffic
from slipstream.energy import PAPER_CAR, VehicleParameters, steady_energy_kwh, stop_energy_kwh
from slipstream.roads import Segment


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


def segment_cost_kwh(
    segment: Segment, traffic: SegmentTraffic, vehicle: VehicleParameters = PAPER_CAR
) -> float:
    """Energy that a vehicle alone is expected to need for a segment, kWh, > 0.

    Where traffic is not known to be turbulent, the vehicle holds the planning speed: the paper's
    c_ij with a = 0. A mean acceleration in a camera's short view does not hold for a whole segment,
    and its noise of some cm/s² would exceed drag.

    In turbulent traffic the vehicle follows the traffic, with a ~ N(ā, σ²_a), and the cost is that
    of the expected tractive force. There |ā| is limited to v²_limit/2d, the maximum for
    speeds between standstill and the limit over the segment's length d.

    Expected stops are added to either, each with the kinetic energy of the planning speed.
    """
    speed = traffic.speed_mps
    stops_kwh = traffic.stops * stop_energy_kwh(speed, vehicle)
    if traffic.y_e != 0 or traffic.measured_speed_mps is None:
        return steady_energy_kwh(segment.length_m, speed, vehicle=vehicle) + stops_kwh
    bound = segment.speed_limit_mps**2 / (2 * segment.length_m)
    mean_acceleration = min(bound, max(-bound, traffic.mean_acceleration_mps2))
    resistance_n = vehicle.rolling_force_n + vehicle.drag_force_n(speed)
    force_n = expected_traction_n(
        vehicle.mass_kg * mean_acceleration + resistance_n,
        vehicle.mass_kg * math.sqrt(traffic.acceleration_variance_m2ps4),
    )
    return vehicle.electrical_kwh(max(force_n, 1.0) * segment.length_m) + stops_kwh
