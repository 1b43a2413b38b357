"""Small road networks of six kinds, each drawn from a seed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Final

import numpy as np

from slipstream.roads import RoadNetwork, Segment, build_network

STREET_MPS: Final = 13.89
ROAD_MPS: Final = 19.44
MOTORWAY_MPS: Final = 30.0

Point = tuple[float, float]


@dataclass(frozen=True)
class Landscape:
    """Roads, and where a fleet belongs on them."""

    network: RoadNetwork
    depots: tuple[str, ...]
    sites: tuple[str, ...]


@dataclass
class _Draft:
    """Junctions and two-way roads while a network is drawn."""

    rng: np.random.Generator
    shift_m: float
    places: dict[str, Point]
    segments: list[Segment]

    def place(self, name: str, x_m: float, y_m: float) -> str:
        """Add a junction, shifted at random."""
        dx, dy = self.rng.uniform(-self.shift_m, self.shift_m, 2)
        self.places[name] = (round(x_m + float(dx), 1), round(y_m + float(dy), 1))
        return name

    def road(self, stops: Iterable[str], speed_mps: float) -> None:
        """Two-way segments from junction to junction, up to 15 % longer than the straight line."""
        for start, end in pairwise(stops):
            points = self.places[start], self.places[end]
            straight = float(np.hypot(*np.subtract(points[1], points[0])))
            length = round(straight * float(self.rng.uniform(1.0, 1.15)), 1)
            for a, b, shape in ((start, end, points), (end, start, points[::-1])):
                self.segments.append(Segment(f"{a}-{b}", a, b, length, speed_mps, 1, shape))

    def finish(self, name: str) -> RoadNetwork:
        """The network; every turn is allowed but the one back."""
        return build_network(name, self.segments, self.places)


def avenue(rng: np.random.Generator) -> Landscape:
    """An avenue with stops around both ends and slower roads beside it."""
    draft = _draft(rng, 60.0)
    span = float(rng.uniform(1600, 4000))
    west, east = draft.place("w", 0, 0), draft.place("e", span, 0)
    gate, yard = draft.place("gate", -700, 0), draft.place("yard", -1300, 0)
    near = [draft.place(f"w{i}", -300, side * 320) for i, side in enumerate((-1, 1, -2, 2))]
    far = [draft.place(f"e{i}", span + 300, side * 320) for i, side in enumerate((-1, 1, -2, 2))]
    draft.road((yard, gate, west), STREET_MPS)
    draft.road((west, east), float(rng.choice((STREET_MPS, ROAD_MPS, ROAD_MPS))))
    for group, hub in ((near, west), (far, east)):
        draft.road((group[2], group[0], hub), STREET_MPS)
        draft.road((group[3], group[1], hub), STREET_MPS)
    for site in near[:2]:
        draft.road((gate, site), STREET_MPS)
    draft.road((near[2], far[2]), ROAD_MPS)
    draft.road((near[3], far[3]), ROAD_MPS)
    return Landscape(draft.finish("avenue"), (yard,), (*near, *far))


def blocks(rng: np.random.Generator) -> Landscape:
    """A grid of streets with one faster street in each direction."""
    draft = _draft(rng, 70.0)
    rows = columns = 4
    step = float(rng.uniform(350, 700))
    for row in range(rows):
        for column in range(columns):
            draft.place(f"r{row}c{column}", column * step, row * step)
    main = int(rng.integers(rows)), int(rng.integers(columns))
    for row in range(rows):
        speed = ROAD_MPS if row == main[0] else STREET_MPS
        draft.road((f"r{row}c{column}" for column in range(columns)), speed)
    for column in range(columns):
        speed = ROAD_MPS if column == main[1] else STREET_MPS
        draft.road((f"r{row}c{column}" for row in range(rows)), speed)
    names = tuple(draft.places)
    return Landscape(draft.finish("blocks"), names, names)


def ring(rng: np.random.Generator) -> Landscape:
    """A ring road, spokes to its centre, stops outside of it."""
    draft = _draft(rng, 40.0)
    radius, spokes = float(rng.uniform(900, 1600)), 6
    centre = draft.place("centre", 0, 0)
    angles = np.arange(spokes) * 2 * np.pi / spokes
    on_ring = [
        draft.place(f"ring{i}", radius * float(np.cos(a)), radius * float(np.sin(a)))
        for i, a in enumerate(angles)
    ]
    outside = [
        draft.place(f"out{i}", (radius + 500) * float(np.cos(a)), (radius + 500) * float(np.sin(a)))
        for i, a in enumerate(angles)
    ]
    draft.road((*on_ring, on_ring[0]), ROAD_MPS)
    for hub, site in zip(on_ring, outside, strict=True):
        draft.road((centre, hub, site), STREET_MPS)
    return Landscape(draft.finish("ring"), (centre, *outside), (*outside, centre))


def bridges(rng: np.random.Generator) -> Landscape:
    """Two banks of a river and the two bridges between them."""
    draft = _draft(rng, 60.0)
    width, step = float(rng.uniform(800, 1800)), float(rng.uniform(350, 600))
    banks = [
        [draft.place(f"{bank}{i}", i * step, side * width / 2) for i in range(5)]
        for bank, side in (("north", 1), ("south", -1))
    ]
    back = [
        [draft.place(f"{bank}-back{i}", i * step, side * (width / 2 + 400)) for i in range(5)]
        for bank, side in (("north", 1), ("south", -1))
    ]
    for quay, behind in zip(banks, back, strict=True):
        draft.road(quay, STREET_MPS)
        draft.road(behind, STREET_MPS)
        for pair in zip(quay, behind, strict=True):
            draft.road(pair, STREET_MPS)
    for column in (int(rng.integers(2)), 3 + int(rng.integers(2))):
        draft.road((banks[0][column], banks[1][column]), float(rng.choice((STREET_MPS, ROAD_MPS))))
    names = tuple(draft.places)
    return Landscape(draft.finish("bridges"), names, names)


def motorway(rng: np.random.Generator) -> Landscape:
    """A motorway with four junctions, a country road along it, villages on both."""
    draft = _draft(rng, 150.0)
    step = float(rng.uniform(3000, 6000))
    ramps = [draft.place(f"exit{i}", i * step, 0) for i in range(4)]
    villages = [draft.place(f"south{i}", i * step, -900) for i in range(4)]
    hamlets = [draft.place(f"north{i}", i * step, 900) for i in range(4)]
    draft.road(ramps, MOTORWAY_MPS)
    draft.road(villages, ROAD_MPS)
    for parts in zip(hamlets, ramps, villages, strict=True):
        draft.road(parts, STREET_MPS)
    return Landscape(
        draft.finish("motorway"), (villages[0], hamlets[0]), (*villages[1:], *hamlets[1:])
    )


def valley(rng: np.random.Generator) -> Landscape:
    """One road up a valley with side roads: whoever goes further passes everybody else."""
    draft = _draft(rng, 80.0)
    along = [draft.place("mouth", 0, 0)]
    ends = []
    for i in range(1, 6):
        along.append(draft.place(f"fork{i}", i * float(rng.uniform(700, 1500)), 0))
        x_m = draft.places[along[-1]][0]
        side = 1 if rng.random() < 0.5 else -1
        ends.append(draft.place(f"farm{i}", x_m, side * float(rng.uniform(300, 900))))
    along.sort(key=lambda name: draft.places[name])
    draft.road(along, ROAD_MPS)
    for i, end in enumerate(ends, start=1):
        draft.road((f"fork{i}", end), STREET_MPS)
    return Landscape(draft.finish("valley"), (along[0],), (*ends, *along[1:]))


def _draft(rng: np.random.Generator, shift_m: float) -> _Draft:
    return _Draft(rng, shift_m, {}, [])


LANDSCAPES: Final[Mapping[str, Callable[[np.random.Generator], Landscape]]] = MappingProxyType(
    {f.__name__: f for f in (avenue, blocks, ring, bridges, motorway, valley)}
)
"""By name."""
