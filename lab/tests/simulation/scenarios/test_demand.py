"""Trips, their routes and the route file."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from slipstream.errors import InputError
from slipstream_lab.simulation.scenarios.defaults import default_demand
from slipstream_lab.simulation.scenarios.demand.routes import find_routes
from slipstream_lab.simulation.scenarios.demand.trips import (
    DemandSettings,
    Flow,
    Zone,
    draw_trips,
    gateways,
)
from slipstream_lab.simulation.scenarios.networks.route_files import check_routes
from slipstream_lab.simulation.scenarios.scenario import Scenario, prepare
from slipstream_lab.simulation.sumo.vehicle_types import TYPES

FLAT = (1.0,) * 24


def _small(scenario: Scenario, share: int = 20) -> DemandSettings:
    """The scenario's demand with fewer trips."""
    flows = tuple(
        flow.model_copy(update={"trips": max(1, flow.trips // share)})
        for flow in scenario.demand.flows
    )
    return scenario.demand.model_copy(update={"flows": flows})


def test_troys_day_has_as_many_trips_as_stated_and_two_directional_peaks(troy: Scenario) -> None:
    """Trips come in through gateways in the morning and leave by them in the evening."""
    trips = draw_trips(troy.demand, troy.network, 1)
    assert 25_000 <= len(trips) <= 40_000
    ends = np.isin(trips.junctions, list(gateways(troy.network)))
    hour = trips.depart_s // 3600
    coming = ends[trips.origin] & ~ends[trips.destination]
    leaving = ~ends[trips.origin] & ends[trips.destination]
    assert coming[hour == 7].sum() > 4 * leaving[hour == 7].sum()
    assert leaving[hour == 16].sum() > 4 * coming[hour == 16].sum()
    assert (hour == 7).sum() > 20 * (hour == 2).sum()
    assert (np.diff(trips.depart_s) >= 0).all()
    assert 0 <= trips.depart_s.min() < trips.depart_s.max() < 86400


def test_departures_follow_the_hours_of_their_purpose(troy: Scenario) -> None:
    """A purpose with one busy hour departs around it alone."""
    hours = tuple(1.0 if hour == 9 else 0.0 for hour in range(24))
    demand = DemandSettings(
        zones={"all": Zone(base=1.0)},
        flows=(Flow(name="x", trips=500, origin="all", destination="all", hours=hours),),
        types={"car": 1.0},
    )
    depart_h = draw_trips(demand, troy.network, 3).depart_s / 3600
    assert depart_h.min() >= 8.5
    assert depart_h.max() <= 10.5
    assert np.median(depart_h) == pytest.approx(9.5, abs=0.1)


def test_reach_makes_trips_short(corridor: Scenario) -> None:
    """A purpose with a short reach drives shorter ways than one that may go anywhere."""

    def mean_m(decay_length_m: float | None) -> float:
        flow = Flow(
            name="x",
            trips=400,
            origin="all",
            destination="all",
            hours=FLAT,
            decay_length_m=decay_length_m,
        )
        demand = DemandSettings(zones={"all": Zone(base=1.0)}, flows=(flow,), types={"car": 1.0})
        trips = draw_trips(demand, corridor.network, 1)
        where = np.array([corridor.network.junctions[name] for name in trips.junctions])
        apart = where[trips.origin] - where[trips.destination]
        return float(np.hypot(*apart.T).mean())

    assert mean_m(2000.0) < 0.5 * mean_m(None)


def test_routes_lead_from_origin_to_destination_by_allowed_turns(troy: Scenario) -> None:
    """Each route begins at the trip's junction, ends at its goal, and every turn exists."""
    trips = draw_trips(_small(troy), troy.network, 2)
    routes = find_routes(trips, troy.network, 2)
    segments, follows = troy.network.segments, troy.network.follows
    for trip in range(len(trips)):
        way = routes.names(trip)
        assert segments[way[0]].start == trips.junctions[trips.origin[trip]]
        assert segments[way[-1]].end == trips.junctions[trips.destination[trip]]
        assert all(after in follows[before] for before, after in pairwise(way))
    assert sum(routes.passages().values()) == sum(
        len(set(routes.names(trip))) for trip in range(len(trips))
    )


def test_full_roads_send_some_trips_another_way(troy: Scenario) -> None:
    """Where a road fills up within an hour, trips of one pair take more than one way."""
    gates = {"a": Zone(junctions={"hoosick_plaza": 1.0}), "b": Zone(junctions={"menands_378": 1.0})}
    hours = tuple(1.0 if hour == 8 else 0.0 for hour in range(24))

    def ways(count: int) -> int:
        flow = Flow(name="x", trips=count, origin="a", destination="b", hours=hours)
        demand = DemandSettings(zones=gates, flows=(flow,), types={"car": 1.0})
        return len(find_routes(draw_trips(demand, troy.network, 1), troy.network, 1).ways)

    assert ways(20) == 1
    assert ways(4000) > 1


def test_same_seed_same_route_file_byte_for_byte(corridor: Scenario, tmp_path: Path) -> None:
    """Trips, routes and speed factors come from the seed; nothing is left for SUMO to draw."""
    few = replace(corridor, demand=_small(corridor))
    files = [
        prepare(few, seed, tmp_path / str(i)).files[0].read_bytes()
        for i, seed in enumerate((4, 4, 5))
    ]
    assert files[0] == files[1]
    assert files[0] != files[2]
    path = tmp_path / "0" / "corridor-4.rou.xml"
    check_routes((path,), corridor.network.segments)
    root = ElementTree.parse(path).getroot()
    assert {kind.get("id") for kind in root.iter("vType")} == set(TYPES)
    assert {(kind.get("speedDev"), kind.get("carFollowModel")) for kind in root.iter("vType")} == {
        ("0", "IDM")
    }
    factors = [float(vehicle.get("speedFactor", "nan")) for vehicle in root.iter("vehicle")]
    assert np.std(factors) == pytest.approx(0.05, abs=0.01)


def test_unknown_places_and_zones_are_told(troy: Scenario) -> None:
    """A demand for another net names what is missing."""
    flow = Flow(name="x", trips=1, origin="all", destination="all", hours=FLAT)
    zones = {"all": Zone(junctions={"atlantis": 1.0})}
    demand = DemandSettings(zones=zones, flows=(flow,), types={"car": 1.0})
    with pytest.raises(InputError, match="no junction 'atlantis' in net 'troy'"):
        draw_trips(demand, troy.network, 1)
    nowhere = demand.model_copy(update={"zones": {}})
    with pytest.raises(InputError, match="no zone 'all'"):
        draw_trips(nowhere, troy.network, 1)
    empty = demand.model_copy(update={"zones": {"all": Zone()}})
    with pytest.raises(InputError, match="no two places to drive between"):
        draw_trips(empty, troy.network, 1)
    bicycle = demand.model_copy(update={"zones": {"all": Zone(base=1.0)}, "types": {"tram": 1.0}})
    with pytest.raises(InputError, match="no vehicle type 'tram'"):
        draw_trips(bicycle, troy.network, 1)


def test_a_net_of_which_nothing_is_known_gets_light_demand(corridor: Scenario) -> None:
    """Random pairs of places, in proportion to the length of the roads."""
    demand = default_demand(corridor.network)
    km = sum(segment.length_m for segment in corridor.network.segments.values()) / 1000
    assert demand.flows[0].trips == round(170 * km)
    assert len(draw_trips(demand, corridor.network, 1)) == demand.flows[0].trips
