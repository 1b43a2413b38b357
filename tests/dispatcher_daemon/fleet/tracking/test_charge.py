"""What is known of a tracked vehicle's battery."""

from __future__ import annotations

import pytest

from dispatcher_daemon.fleet import Depot, Vehicle
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from slipstream.messages import PlannedStop, VehiclePlan, VehiclePosition
from slipstream.orders import PlanRecord

NOW_NS = 1_800_000_000_000_000_000


def tracked(
    leg: int, on_road: bool, reported_kwh: float | None, kind: str | None = "van"
) -> TrackedVehicle:
    """A van on its way from the depot over a charging stop to a stop and back."""
    stops = [
        PlannedStop(
            stop=name,
            node=name,
            arrival_ns=NOW_NS,
            departure_ns=NOW_NS,
            charge_kwh=charge,
            charged_kwh=charged,
        )
        for name, charge, charged in (
            ("depot", 20.0, 0.0),
            ("fast", 12.0, 9.0),
            ("s", 15.0, 0.0),
            ("depot", 9.0, 0.0),
        )
    ]
    plan = VehiclePlan(
        vehicle="v",
        cycle=1,
        issued_ns=NOW_NS,
        valid_until_ns=NOW_NS + 1,
        depart_ns=NOW_NS,
        stops=tuple(stops),
        segments=(),
        distance_m=0.0,
        energy_kwh=0.0,
    )
    assert [stop.stop for stop in plan.service_stops] == ["s"]
    position = VehiclePosition(
        vehicle="v",
        time_ns=NOW_NS,
        segment="road",
        share=0.5,
        speed_mps=0.0,
        on_road=on_road,
        cycle=1,
        leg=leg,
        charge_kwh=reported_kwh,
    )
    vehicle = TrackedVehicle(Vehicle(id="v", type=kind), Depot(node="depot"), position=position)
    vehicle.accepted, vehicle.leg, vehicle.left = (
        PlanRecord(plan, "acknowledged", NOW_NS),
        leg,
        True,
    )
    return vehicle


@pytest.mark.parametrize(
    ("leg", "on_road", "to_charge"),
    [(0, True, True), (1, False, True), (1, True, False), (2, False, False), (2, True, False)],
)
def test_a_vehicle_keeps_its_plan_until_it_has_charged(
    leg: int, on_road: bool, to_charge: bool
) -> None:
    """On its way to the charging stop and at it, but not behind it."""
    assert tracked(leg, on_road, None).keeps_its_plan == to_charge


def test_a_vehicle_keeps_its_plan_until_it_has_left_its_hub() -> None:
    """Likewise: a commitment tells no hubs."""
    for leg, on_road, keeps in ((0, True, True), (1, False, True), (1, True, False)):
        vehicle = tracked(leg, on_road, None)
        assert vehicle.accepted is not None
        plan = vehicle.accepted.plan
        hub = plan.stops[1].model_copy(update={"charged_kwh": 0.0, "is_hub": True})
        stops = (plan.stops[0], hub, *plan.stops[2:])
        over_hub = plan.model_copy(update={"stops": stops})
        vehicle.accepted = PlanRecord(over_hub, "acknowledged", NOW_NS)
        assert vehicle.keeps_its_plan == keeps


def test_a_vehicles_own_measurement_counts_before_what_was_planned() -> None:
    """Of one that reports none, the plan's charge where it left last; a car has no battery."""
    assert tracked(1, True, 17.5).charged().charge_kwh == 17.5
    assert tracked(0, True, None).charged().charge_kwh == 20.0
    assert tracked(1, True, None).charged().charge_kwh == 21.0
    assert tracked(2, True, None).charged().charge_kwh == 15.0
    assert tracked(1, True, 17.5, kind=None).charged().charge_kwh is None
