"""Generated delivery cities: streets, depots, stops, vehicles and one moment of traffic.

Roads, traffic, stops and vehicles have random streams of their own, so that another fleet of the
same seed drives on the same roads in the same traffic.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from dispatcher_daemon.fleet import Depot, Fleet, Stop, Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.traffic import MIN_SPEED_MPS, SegmentTraffic, TrafficSnapshot
from slipstream.roads import RoadNetwork
from slipstream_lab.research.cities.streets import Cell, StreetGrid, Way, node, street_network
from slipstream_lab.research.instances.instance import Instance

MIN_SEGMENTS: Final = 24
CITY_TIME_NS: Final = 1_800_000_000_000_000_000
"""The moment that every generated city is shown at, UTC."""

_MAX_DEMAND: Final = 10
_STRETCH: Final = 4
"""Watched segments in a row along an arterial, at most."""
_HOUR_S: Final = 3600.0


@dataclass(frozen=True)
class CityShape:
    """What kind of city; shares are of 1.

    Attributes:
        signalled_share: of an arterial's crossings with streets; two arterials always have signals.
        one_way_share: of the streets, at most; less where the number of segments needs no more.
        open_share: of the arterials' segments: fresh y_e = 1, in stretches of a few.
        turbulent_share: of all other segments: fresh y_e = 0; the rest is unwatched.
        ready_within_s: vehicles get ready at some moment between 0 and this.
    """

    block_m: float = 220.0
    arterial_every: int = 5
    signalled_share: float = 0.5
    one_way_share: float = 0.03
    open_share: float = 0.5
    turbulent_share: float = 0.05
    depots: int = 2
    clustered_share: float = 0.6
    window_share: float = 0.2
    capacity_ratio: float = 1.3
    ready_within_s: float = 1200.0

    def __post_init__(self) -> None:
        for name in ("signalled", "one_way", "open", "turbulent", "clustered", "window"):
            share = getattr(self, f"{name}_share")
            if not 0 <= share <= 1:
                raise ValueError(f"{name}_share must be within [0, 1], got {share}")
        if not 1 <= self.depots <= 3:
            raise ValueError(f"depots must be 1, 2 or 3, got {self.depots}")
        if self.arterial_every < 2 or not self.block_m > 0:
            raise ValueError("arterial_every must be at least 2 and block_m positive")
        if not self.capacity_ratio >= 1 or not 0 <= self.ready_within_s <= _HOUR_S:
            raise ValueError("capacity_ratio must be at least 1, ready_within_s within an hour")


def generate_city(
    seed: int,
    *,
    vehicles: int = 200,
    stops: int = 1000,
    segments: int = 2000,
    shape: CityShape | None = None,
) -> Instance:
    """A city with its fleet and traffic as an instance; same arguments, same city.

    Args:
        vehicles: spread evenly over the depots; departure windows of 10 to 20 minutes.
        segments: directed; met exactly unless that would cut the network in pieces.
        shape: what kind of city; the default one if None.

    Raises:
        ValueError: no vehicle, no stop, or fewer than `MIN_SEGMENTS` segments.
    """
    if vehicles < 1 or stops < 1 or segments < MIN_SEGMENTS:
        raise ValueError(f"a city has vehicles, stops and at least {MIN_SEGMENTS} segments")
    shape = shape or CityShape()
    roads, traffic, depot, stop, vehicle = (
        np.random.default_rng([seed, part]) for part in range(5)
    )
    grid, network, ways = street_network(
        roads,
        segments,
        block_m=shape.block_m,
        arterial_every=shape.arterial_every,
        one_way_share=shape.one_way_share,
        signalled_share=shape.signalled_share,
    )
    depots = _depots(depot, grid, shape)
    orders = _stops(stop, grid, {place.node for place in depots}, stops, shape)
    fleet = Fleet(
        name=f"{network.name}-{vehicles}-{stops}-{seed}",
        depots=depots,
        stops=orders,
        vehicles=_vehicles(vehicle, depots, orders, vehicles, shape),
    )
    now = dict(_traffic(traffic, grid, ways, network, shape))
    return Instance(
        name=fleet.name,
        problem=RoutingProblem(network, fleet),
        snapshot=TrafficSnapshot(CITY_TIME_NS, MappingProxyType(now), ()),
        provenance=f"generated city, seed {seed}, {shape}",
    )


def with_carriers(city: Instance, carriers: int) -> Instance:
    """The city with its vehicles and stops dealt out to carriers, of each depot to all of them."""
    fleet = city.problem.fleet
    depots = len(fleet.depots)
    dealt = Fleet(
        **fleet.parts
        | {
            "stops": tuple(
                stop.model_copy(update={"carrier": f"carrier-{n % carriers + 1}"})
                for n, stop in enumerate(fleet.stops)
            ),
            "vehicles": tuple(
                vehicle.model_copy(update={"carrier": f"carrier-{n // depots % carriers + 1}"})
                for n, vehicle in enumerate(fleet.vehicles)
            ),
        }
    )
    return replace(city, problem=replace(city.problem, fleet=dealt))


def small_city(seed: int) -> Instance:
    """A city for trials: 10 vehicles at one depot, 50 stops, 200 segments."""
    return generate_city(seed, vehicles=10, stops=50, segments=200, shape=CityShape(depots=1))


def _traffic(
    rng: np.random.Generator,
    grid: StreetGrid,
    ways: Mapping[str, Way],
    network: RoadNetwork,
    shape: CityShape,
) -> Iterator[tuple[str, SegmentTraffic]]:
    """Speeds, expected stops and flags; calm and turbulent where an RSU watches."""
    calm = _calm(rng, grid, ways, shape.open_share)
    for name, way in ways.items():
        main, segment = grid.is_arterial(way), network.segments[name]
        turbulent = name not in calm and rng.random() < shape.turbulent_share
        share = rng.normal(0.93, 0.02) if name in calm else rng.normal(0.88 if main else 0.82, 0.06)
        share = rng.normal(0.6, 0.1) if turbulent else share
        speed = max(MIN_SPEED_MPS, float(np.clip(share, 0.3, 0.98)) * segment.speed_limit_mps)
        signals, main_ahead = segment.end in network.signals, grid.arterials_at(way[1]) > 0
        stops = _expected_stops(rng, main, signals, main_ahead)
        if name in calm:
            yield (
                name,
                SegmentTraffic(
                    segment=name,
                    speed_mps=speed,
                    y_e=1,
                    open=True,
                    reason=None,
                    age_s=1.0,
                    measured_speed_mps=speed,
                    acceleration_variance_m2ps4=float(rng.uniform(0.05, 0.3)),
                    stops=stops,
                ),
            )
        elif turbulent:
            yield (
                name,
                SegmentTraffic(
                    segment=name,
                    speed_mps=speed,
                    y_e=0,
                    reason="turbulent",
                    age_s=1.0,
                    measured_speed_mps=speed,
                    acceleration_variance_m2ps4=float(rng.uniform(0.6, 1.5)),
                    stops=stops,
                ),
            )
        else:
            yield name, SegmentTraffic(segment=name, speed_mps=speed, stops=stops)


def _expected_stops(rng: np.random.Generator, main: bool, signals: bool, main_ahead: bool) -> float:
    """Stops a passage at a segment's end: main roads have the longer green and the right of way,
    the others a stop sign before them and on one of two ways where they cross.

    With fewer stops on streets nobody who saves energy would drive on an arterial.
    """
    if signals:
        return float(rng.uniform(0.15, 0.35) if main else rng.uniform(0.4, 0.7))
    if main:
        return 0.0
    return float(rng.uniform(0.8, 1.0) if main_ahead else rng.uniform(0.3, 0.7))


def _calm(
    rng: np.random.Generator, grid: StreetGrid, ways: Mapping[str, Way], share: float
) -> set[str]:
    """Segments of arterials to be watched and found calm, in stretches."""

    def along(way: Way) -> tuple[bool, int, bool, int]:
        """Street, direction, and position on it in that direction."""
        (row, column), (end_row, end_column) = way
        if row == end_row:
            forward = end_column > column
            return True, row, forward, column if forward else -column
        forward = end_row > row
        return False, column, forward, row if forward else -row

    main = sorted((along(way), name) for name, way in ways.items() if grid.is_arterial(way))
    stretches: dict[tuple[object, ...], list[str]] = {}
    for (*street, position), name in main:
        stretches.setdefault((*street, position // _STRETCH), []).append(name)
    in_order = list(stretches.values())
    chosen = [name for index in rng.permutation(len(in_order)) for name in in_order[index]]
    return set(chosen[: round(share * len(main))])


def _depots(rng: np.random.Generator, grid: StreetGrid, shape: CityShape) -> tuple[Depot, ...]:
    """At the edge, on an arterial where one reaches it, and far from each other."""
    places = [cell for cell in grid.edge if grid.arterials_at(cell)] or grid.edge
    chosen = [places[rng.integers(len(places))]]
    while len(chosen) < min(shape.depots, len(places)):
        chosen.append(max(places, key=lambda cell: min(_blocks(cell, other) for other in chosen)))
    return tuple(Depot(id=f"depot-{i}", node=node(cell)) for i, cell in enumerate(chosen, 1))


def _blocks(a: Cell, b: Cell) -> int:
    return abs(a[0] - b[0]) + abs(a[1] - b[1])


def _stops(
    rng: np.random.Generator, grid: StreetGrid, taken: set[str], count: int, shape: CityShape
) -> tuple[Stop, ...]:
    cells = [cell for cell in grid.cells if node(cell) not in taken]
    where = np.array(cells, dtype=np.float64)
    centres = where[rng.integers(len(cells), size=2 + count // 60)]
    spread = 0.5 + 0.07 * max(len(grid.row_limits_mps), len(grid.column_limits_mps))
    stops = []
    for number in range(1, count + 1):
        if rng.random() < shape.clustered_share:
            wanted = centres[rng.integers(len(centres))] + rng.normal(0.0, spread, 2)
            cell = cells[int(np.square(where - wanted).sum(axis=1).argmin())]
        else:
            cell = cells[rng.integers(len(cells))]
        service_s, demand = int(rng.integers(30, 181)), int(rng.integers(1, _MAX_DEMAND + 1))
        earliest_s, latest_s = 0.0, None
        if rng.random() < shape.window_share:
            earliest_s = float(rng.integers(0, 2701))
            # The last vehicles get ready late, and the city has to be crossed.
            latest_s = max(earliest_s, 1800.0) + float(rng.integers(1800, 3601))
        stops.append(
            Stop(
                id=f"stop-{number}",
                node=node(cell),
                service_s=service_s,
                demand=demand,
                earliest_s=earliest_s,
                latest_s=latest_s,
            )
        )
    return tuple(stops)


def _vehicles(
    rng: np.random.Generator,
    depots: tuple[Depot, ...],
    stops: tuple[Stop, ...],
    count: int,
    shape: CityShape,
) -> tuple[Vehicle, ...]:
    mean = shape.capacity_ratio * sum(stop.demand for stop in stops) / count
    vehicles = []
    for number in range(count):
        ready_s = float(rng.integers(0, int(shape.ready_within_s) + 1))
        vehicles.append(
            Vehicle(
                id=f"van-{number + 1}",
                depot=depots[number % len(depots)].id,
                capacity=max(_MAX_DEMAND, round(mean * rng.uniform(0.85, 1.15))),
                ready_s=ready_s,
                depart_by_s=ready_s + float(rng.integers(600, 1201)),
            )
        )
    return tuple(vehicles)
