"""Generated cities: what they are made of, and that a seed says all."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from dispatcher_daemon.fleet import check_fleet
from slipstream.roads import RoadNetwork
from slipstream_lab.research.cities.generator import (
    CityShape,
    generate_city,
    small_city,
    with_carriers,
)
from slipstream_lab.research.instances.instance import Instance, load_instance, write_instance


@pytest.fixture(scope="module")
def city() -> Instance:
    """A city of the benchmark's size."""
    return generate_city(1)


def is_strongly_connected(network: RoadNetwork) -> bool:
    """Every segment leads to every other one over allowed turns."""
    index = {name: i for i, name in enumerate(network.segments)}
    turns = [(index[a], index[b]) for a, after in network.follows.items() for b in after]
    rows, columns = zip(*turns, strict=True)
    graph = csr_array((np.ones(len(turns)), (rows, columns)), shape=(len(index), len(index)))
    return bool(connected_components(graph, connection="strong")[0] == 1)


@pytest.mark.slow
def test_same_seed_same_city_and_another_seed_another(city: Instance) -> None:
    """All of it depends on the arguments and on nothing else."""
    again, other = generate_city(1), generate_city(2)
    assert again.problem == city.problem
    assert again.snapshot == city.snapshot
    assert other.problem.fleet.stops != city.problem.fleet.stops
    assert other.problem.network.junctions != city.problem.network.junctions


def test_another_fleet_drives_on_the_same_roads_in_the_same_traffic(city: Instance) -> None:
    """So that time against fleet size is measured on one network."""
    fewer = generate_city(1, vehicles=10, stops=50)
    assert fewer.problem.network == city.problem.network
    assert fewer.snapshot == city.snapshot
    assert fewer.problem.fleet.depots == city.problem.fleet.depots


def test_a_city_of_2000_segments_takes_less_than_a_second() -> None:
    """Generating is no part of what is measured."""
    began = time.process_time()
    generate_city(3)
    assert time.process_time() - began < 1.0


@pytest.mark.parametrize("segments", [24, 101, 200, 500, 2000])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_network_is_as_large_as_asked_and_whole(segments: int, seed: int) -> None:
    """No part of it is cut off, although no vehicle turns round; one-way streets are rare."""
    network = generate_city(seed, vehicles=2, stops=4, segments=segments).problem.network
    assert segments <= len(network.segments) <= 1.02 * segments
    assert is_strongly_connected(network)
    one_way = [s for s in network.segments.values() if f"{s.end}-{s.start}" not in network.segments]
    assert len(one_way) <= 0.03 * len(network.segments)


def test_arterials_are_faster_than_streets(city: Instance) -> None:
    """50 to 70 km/h against 30 to 50, and between a tenth and a third of the city."""
    segments = city.problem.network.segments.values()
    fast = [s.speed_limit_mps * 3.6 for s in segments if s.lanes == 2]
    slow = [s.speed_limit_mps * 3.6 for s in segments if s.lanes == 1]
    assert set(np.round(fast)) <= {50, 60, 70}
    assert set(np.round(slow)) <= {30, 40, 50}
    assert 0.1 < len(fast) / len(segments) < 1 / 3


def test_gates_are_open_on_the_asked_share_of_the_arterials_only(city: Instance) -> None:
    """Half of their segments; elsewhere turbulent or unwatched, and never faster than the limit."""
    network, traffic = city.problem.network, city.snapshot.segments
    assert set(traffic) == set(network.segments)
    main = [name for name, s in network.segments.items() if s.lanes == 2]
    assert sum(traffic[name].open for name in main) == round(0.5 * len(main))
    for name, now in traffic.items():
        assert 1.0 <= now.speed_mps < network.segments[name].speed_limit_mps
        assert now.stops >= 0
        if now.open:
            assert (now.y_e, now.reason, network.segments[name].lanes) == (1, None, 2)
        else:
            assert (now.y_e, now.reason) in {(0, "turbulent"), (None, "unwatched")}
    assert any(now.y_e == 0 for now in traffic.values())
    km = 1e-3 * sum(s.length_m for s in network.segments.values())
    assert 0.5 < sum(t.stops for t in traffic.values()) / km < 2.5


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_the_open_share_can_be_chosen(share: float) -> None:
    """From nowhere to every arterial."""
    city = generate_city(1, vehicles=2, stops=4, segments=200, shape=CityShape(open_share=share))
    main = [name for name, s in city.problem.network.segments.items() if s.lanes == 2]
    assert sum(t.open for t in city.snapshot.segments.values()) == share * len(main)


def test_the_fleet_can_serve_its_stops(city: Instance) -> None:
    """Capacity is 1.3 times the demand, depots lie apart, windows can be met, nodes exist."""
    fleet, network = city.problem.fleet, city.problem.network
    check_fleet(fleet, network, "city")
    assert (len(fleet.vehicles), len(fleet.stops), len(fleet.depots)) == (200, 1000, 2)
    capacities = [v.capacity for v in fleet.vehicles if v.capacity is not None]
    demands = [stop.demand for stop in fleet.stops]
    assert len(capacities) == 200
    assert sum(capacities) == pytest.approx(1.3 * sum(demands), rel=0.03)
    assert min(capacities) >= max(demands)
    first, second = (np.array(network.junctions[d.node]) for d in fleet.depots)
    assert float(np.abs(first - second).max()) > 2000
    for vehicle in fleet.vehicles:
        assert vehicle.depart_by_s is not None
        assert 600 <= vehicle.depart_by_s - vehicle.ready_s <= 1200
    timed = [stop for stop in fleet.stops if stop.latest_s is not None]
    assert 0.15 < len(timed) / len(fleet.stops) < 0.25
    assert all(stop.latest_s >= 3600 for stop in timed if stop.latest_s is not None)
    assert all(30 <= stop.service_s <= 180 for stop in fleet.stops)
    assert len({stop.node for stop in fleet.stops}) < len(fleet.stops)


def test_who_stops_where(city: Instance) -> None:
    """Arterials have signals or the right of way; a street without signals stops before them."""
    network, traffic = city.problem.network, city.snapshot.segments
    assert 0.1 < len(network.signals) / len(network.junctions) < 0.4
    signals = [traffic[n].stops for n, s in network.segments.items() if s.end in network.signals]
    assert 0 < min(signals) <= max(signals) < 1
    mean = {
        lanes: np.mean([traffic[n].stops for n, s in network.segments.items() if s.lanes == lanes])
        for lanes in (1, 2)
    }
    assert mean[1] > 1.5 * mean[2]


def test_a_city_can_be_written_and_read(tmp_path: Path) -> None:
    """It is an instance like any other: the file gives the same city back."""
    city = small_city(2)
    write_instance(city, tmp_path / "city.json")
    assert load_instance(tmp_path / "city.json") == city


def test_the_small_city() -> None:
    """10 vehicles, 50 stops and 200 segments."""
    city = small_city(1)
    fleet = city.problem.fleet
    assert (len(fleet.vehicles), len(fleet.stops), len(fleet.depots)) == (10, 50, 1)
    assert len(city.problem.network.segments) == 200


@pytest.mark.parametrize(
    "change",
    [
        {"open_share": 1.1},
        {"window_share": -0.1},
        {"depots": 4},
        {"block_m": 0.0},
        {"arterial_every": 1},
        {"capacity_ratio": 0.9},
    ],
)
def test_shapes_that_no_city_has(change: dict[str, float]) -> None:
    """They are refused where they are made."""
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(CityShape(), **change)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [{"vehicles": 0}, {"stops": 0}, {"segments": 23}])
def test_sizes_that_no_city_has(size: dict[str, int]) -> None:
    """They are refused."""
    with pytest.raises(ValueError, match="a city has"):
        generate_city(1, **size)


def test_vehicles_and_stops_are_dealt_out_to_carriers() -> None:
    """Each has vans at each depot and as many stops as the others; nothing else changes."""
    city = generate_city(3, vehicles=8, stops=20, segments=100)
    fleet = with_carriers(city, 4).problem.fleet
    assert Counter(stop.carrier for stop in fleet.stops) == {f"carrier-{n}": 5 for n in range(1, 5)}
    assert len({(vehicle.carrier, vehicle.depot) for vehicle in fleet.vehicles}) == 8
    for table in ("stops", "vehicles"):
        plain = [row.model_copy(update={"carrier": None}) for row in getattr(fleet, table)]
        assert plain == list(getattr(city.problem.fleet, table))
