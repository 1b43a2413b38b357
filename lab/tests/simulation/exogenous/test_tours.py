"""Rounds of the fleet's day, without any simulation."""

from __future__ import annotations

from dataclasses import replace

import pytest

from slipstream.energy.consumption import Energy
from slipstream.messages import PlannedSegment, PlannedStop, VehiclePlan
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from slipstream_lab.simulation.closed_loop.record import OrderService
from slipstream_lab.simulation.exogenous.tours import LegOrder, Tours, free_s
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg
from slipstream_lab.simulation.fleet.losses import Losses
from slipstream_lab.simulation.scenarios.demand.deliveries import Deliveries, FleetSettings, Order

NOTHING = Energy(0.0, 0.0, 0.0, 0.0)
S = 10**9


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    """Roads to drive on."""
    return load_network("demo")


@pytest.fixture
def tours(network: RoadNetwork) -> Tours:
    """One van and three orders."""
    places = list(network.junctions)[:3]
    orders = tuple(
        Order(id=f"o{i}", node=node, release_s=0.0, latest_s=900.0, service_s=60.0, parcels=1)
        for i, node in enumerate(places)
    )
    return Tours(Deliveries(FleetSettings(), {"van": "depot"}, orders), network)


def plan(segment: str, *, second_leg: bool = True) -> VehiclePlan:
    """Depot, o0, o1, depot, the ways of 100 s and of one segment each; o1 may be next door."""

    def way(leg: int) -> PlannedSegment:
        return PlannedSegment(
            segment=segment,
            entry_ns=(100 + 200 * leg) * S,
            exit_ns=(200 + 200 * leg) * S,
            speed_mps=10.0,
            platoon=None,
            place=None,
            gap_m=None,
            leg=leg,
        )

    def stop(name: str, arrival: int, departure: int) -> PlannedStop:
        return PlannedStop(stop=name, node=name, arrival_ns=arrival * S, departure_ns=departure * S)

    return VehiclePlan(
        vehicle="van",
        cycle=0,
        issued_ns=0,
        valid_until_ns=600 * S,
        depart_ns=100 * S,
        stops=(
            stop("depot", 100, 100),
            stop("o0", 200, 300),
            stop("o1", 400, 500),
            stop("depot", 600, 600),
        ),
        segments=tuple(way(leg) for leg in ((0, 1, 2) if second_leg else (0, 2))),
        distance_m=1.0,
        energy_kwh=1.0,
    )


def driven(order: LegOrder, arrived_s: float) -> DrivenLeg:
    """A leg that ended when it did."""
    return DrivenLeg(
        vehicle=order.vehicle,
        round=order.round,
        leg=order.leg,
        ready_s=order.ready_s,
        due_s=order.due_s,
        departed_s=order.due_s,
        arrived_s=arrived_s,
        free_s=order.free_s,
        distance_m=1.0,
        driven=NOTHING,
        alone=NOTHING,
        led_m=0.0,
        followed_m=0.0,
        stops=0,
        waited_s=0.0,
        turbulent_s=0.0,
        path=order.path,
        losses=Losses(0.0, 0.0, 0.0, 0.0, 0.0),
    )


def test_a_round_is_driven_leg_by_leg_and_ends_at_the_depot(tours: Tours) -> None:
    """Each leg begins when the service at its beginning is over, whenever that really is."""
    segment = next(iter(tours.network.segments))
    (first,) = tours.begin(plan(segment))
    assert (first.due_s, first.path, first.id) == (100.0, (segment,), "van/0/0")
    assert first.free_s == free_s(tours.network, (segment,))
    assert "van" not in tours.idle
    assert tours.taken == {"o0", "o1"}
    (second,) = tours.arrived(driven(first, 230.0))
    assert (second.ready_s, second.due_s) == (290.0, 290.0)
    (third,) = tours.arrived(driven(second, 400.0))
    assert not [*tours.arrived(driven(third, 555.0))]
    assert tours.idle == {"van": 555.0}
    assert tours.services(1000.0)[:2] == (
        OrderService("o0", 900.0, 230.0),
        OrderService("o1", 900.0, 400.0),
    )
    (again,) = tours.begin(plan(segment))
    assert again.round == 1


def test_waiting_to_meet_others_is_travel_time(tours: Tours) -> None:
    """Planned at 0 s to leave at 100 s, an arrival at 230 s took 230 s."""
    (first,) = tours.begin(plan(next(iter(tours.network.segments))))
    assert (first.ready_s, first.due_s) == (0.0, 100.0)
    assert driven(first, 230.0).travel_s == 230.0


def test_two_stops_at_one_junction_need_no_drive_between_them(tours: Tours) -> None:
    """The second service begins when the first one ends."""
    segment = next(iter(tours.network.segments))
    (first,) = tours.begin(plan(segment, second_leg=False))
    (last,) = tours.arrived(driven(first, 230.0))
    assert (last.leg, last.due_s) == (2, 350.0)
    assert tours.services(1000.0)[1] == OrderService("o1", 900.0, 290.0)


def test_a_day_that_begins_late_leaves_earlier_orders_out(tours: Tours) -> None:
    """They are neither dispatched nor counted."""
    tours.deliveries = replace(
        tours.deliveries,
        orders=(
            replace(tours.deliveries.orders[0], release_s=10.0),
            *tours.deliveries.orders[1:],
        ),
    )
    late = Tours(tours.deliveries, tours.network)
    late.keep_released(10.0, 86_400.0)
    assert late.taken == {"o1", "o2"}
    assert [service.order for service in late.services(1000.0)] == ["o0"]
