"""Verification of plans against what their vehicles may use, and what their batteries hold."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from dispatcher_daemon.fleet import Commitment, Fleet
from slipstream.messages import PlannedSegment, VehiclePlan
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import RoutingProfile

_TOLERANCE_KWH = 1e-4
_LEAST_OF_ROLLING = 0.9
"""Losses that were observed may be a little below what rolling needs."""


def legs_of(plan: VehiclePlan) -> list[list[PlannedSegment]]:
    """Its segments by leg."""
    legs: list[list[PlannedSegment]] = [[] for _ in plan.stops[1:]]
    for segment in plan.segments:
        if segment.leg < len(legs):
            legs[segment.leg].append(segment)
    return legs


def profile_of(fleet: Fleet, name: str) -> RoutingProfile:
    """A vehicle's permissions, size and top speed."""
    vehicle = fleet.vehicle_by_id.get(name)
    kind = None if vehicle is None else fleet.type_of(vehicle)
    return RoutingProfile() if kind is None else kind.profile


def access_faults(
    plan: VehiclePlan, network: RoadNetwork, fleet: Fleet, own: Commitment | None
) -> Iterator[str]:
    """Segments, but those begun, and turns that a vehicle of its class and size may not use."""
    profile = profile_of(fleet, plan.vehicle)
    begun = 1 if own is not None and own.moving is not None else 0
    for segment in plan.segments[begun:]:
        known = segment.segment in network.segments
        if known and not network.admits(segment.segment, profile):
            yield f"may not use {segment.segment}"
    for leg in legs_of(plan):
        for a, b in pairwise(segment.segment for segment in leg):
            if not network.admits_turn(a, b, profile):
                yield f"may not turn from {a} into {b}"


def charge_faults(
    plan: VehiclePlan,
    network: RoadNetwork,
    fleet: Fleet,
    reference_s: float,
    own: Commitment | None,
) -> Iterator[str]:
    """Charge by the plan's own figures, against what the battery holds, what a place gives in the
    time, and the work of rolling, below which no leg's energy can be. A bound vehicle delivers
    what it has loaded, whatever its reserve.
    """
    vehicle = fleet.vehicle_by_id.get(plan.vehicle)
    kind = None if vehicle is None else fleet.type_of(vehicle)
    if vehicle is None or kind is None or kind.battery_kwh is None or not plan.stops:
        return
    top_kw = math.inf if kind.charging_power_kw is None else kind.charging_power_kw

    def most_kwh(power_kw: float | None, seconds: float) -> float:
        return 0.0 if power_kw is None else min(power_kw, top_kw) * max(0.0, seconds) / 3600

    begin_ns = plan.issued_ns + round(reference_s * 1e9)
    depot_kw = fleet.depot_of(vehicle).charging_power_kw
    charge = kind.battery_kwh if vehicle.charge_kwh is None else vehicle.charge_kwh
    charge += most_kwh(depot_kw, (plan.depart_ns - begin_ns) * 1e-9)
    rolling_n = kind.profile.physics.rolling_force_n
    legs = [[], *legs_of(plan)]
    for number, (visit, leg) in enumerate(zip(plan.stops, legs, strict=False)):
        if visit.charge_kwh is None:
            yield f"no charge is planned for {visit.stop}"
            return
        # A part of a bound vehicle's first leg may lie behind it.
        ahead = [] if own is not None and number == 1 else leg
        roads = [network.segments.get(segment.segment) for segment in ahead]
        length_m = sum(road.length_m for road in roads if road is not None)
        least_kwh = _LEAST_OF_ROLLING * kind.profile.physics.electrical_kwh(rolling_n * length_m)
        if visit.charge_kwh > min(charge, kind.battery_kwh) - least_kwh + _TOLERANCE_KWH:
            yield f"comes to {visit.stop} with more charge than it can have"
        is_free = own is None and number > 0
        reserve_kwh = kind.battery_reserve * kind.battery_kwh if is_free else 0.0
        if visit.charge_kwh < reserve_kwh - _TOLERANCE_KWH:
            yield f"comes to {visit.stop} with less than its reserve of {reserve_kwh:g} kWh"
        place = fleet.charging_stop_by_id.get(visit.stop)
        seconds = (visit.departure_ns - visit.arrival_ns) * 1e-9
        limit_kwh = most_kwh(None if place is None else place.power_kw, seconds)
        if visit.charged_kwh > limit_kwh + _TOLERANCE_KWH:
            yield f"cannot take in {visit.charged_kwh:g} kWh at {visit.stop}"
        charge = visit.charge_kwh + visit.charged_kwh
