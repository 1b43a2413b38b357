"""Generated street networks: a perturbed grid with faster arterials and a few one-way streets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from slipstream.roads import RoadNetwork, Segment, build_network

_KMH: Final = 1 / 3.6
_ARTERIAL_LIMITS_KMH: Final = (50.0, 60.0, 70.0)
_STREET_LIMITS_KMH: Final = (30.0, 40.0, 50.0)
_LENGTHENED: Final = (0.75, 1.25)
"""Distances of neighbouring rows and columns, of the mean."""
_SHIFT: Final = 0.08
_MAX_SHIFT: Final = 0.2
"""Standard deviation and limit of a junction's displacement along each axis, of the mean block."""

Cell = tuple[int, int]
"""Row and column of a junction."""
Way = tuple[Cell, Cell]
"""One direction of a street between two crossings."""


@dataclass(frozen=True)
class StreetGrid:
    """What the grid knows about its streets beyond what a road network holds.

    Attributes:
        row_limits_mps: speed limit of the street along each row, shape (rows,).
        column_limits_mps: of the street along each column, shape (columns,).
    """

    row_limits_mps: tuple[float, ...]
    column_limits_mps: tuple[float, ...]
    arterial_rows: frozenset[int]
    arterial_columns: frozenset[int]

    @property
    def cells(self) -> list[Cell]:
        """All crossings, row by row."""
        rows, columns = len(self.row_limits_mps), len(self.column_limits_mps)
        return [(row, column) for row in range(rows) for column in range(columns)]

    @property
    def edge(self) -> list[Cell]:
        """The crossings on the rim of the grid."""
        last_row, last_column = len(self.row_limits_mps) - 1, len(self.column_limits_mps) - 1
        return [(r, c) for r, c in self.cells if r in (0, last_row) or c in (0, last_column)]

    def is_arterial(self, way: Way) -> bool:
        """True for a segment of an arterial."""
        (row, column), (end_row, _) = way
        return row in self.arterial_rows if row == end_row else column in self.arterial_columns

    def limit_mps(self, way: Way) -> float:
        """Speed limit, m/s."""
        (row, column), (end_row, _) = way
        return self.row_limits_mps[row] if row == end_row else self.column_limits_mps[column]

    def arterials_at(self, cell: Cell) -> int:
        """How many arterials meet at a crossing: 0, 1 or 2."""
        return (cell[0] in self.arterial_rows) + (cell[1] in self.arterial_columns)


def node(cell: Cell) -> str:
    """Junction id of a crossing."""
    return f"r{cell[0]:02d}c{cell[1]:02d}"


def segment(way: Way) -> str:
    """Segment id of one direction of a street."""
    return f"{node(way[0])}-{node(way[1])}"


def street_network(
    rng: np.random.Generator,
    segments: int,
    *,
    block_m: float,
    arterial_every: int,
    one_way_share: float,
    signalled_share: float,
) -> tuple[StreetGrid, RoadNetwork, dict[str, Way]]:
    """A grid of streets on which every segment leads to every other one without turning round.

    The smallest grid with enough directed segments is thinned out to the number asked for: some
    streets become one-way, others are missing; arterials stay.

    Args:
        segments: directed; the network has more where thinning further would cut it in pieces.
        signalled_share: of an arterial's crossings with streets; two arterials always have signals.
    """
    rows, columns = _size(segments)
    grid = _grid(rng, rows, columns, arterial_every)
    ys = np.cumsum(block_m * rng.uniform(*_LENGTHENED, rows))
    xs = np.cumsum(block_m * rng.uniform(*_LENGTHENED, columns))
    shift = rng.normal(0.0, _SHIFT, (rows, columns, 2)).clip(-_MAX_SHIFT, _MAX_SHIFT) * block_m
    places = {
        cell: (float(xs[cell[1]] + shift[cell][0]), float(ys[cell[0]] + shift[cell][1]))
        for cell in grid.cells
    }
    ways = _thinned(rng, grid, segments, one_way_share)
    parts = [
        Segment(
            id=segment(way),
            start=node(way[0]),
            end=node(way[1]),
            length_m=float(np.hypot(*np.subtract(places[way[1]], places[way[0]]))),
            speed_limit_mps=grid.limit_mps(way),
            lanes=2 if grid.is_arterial(way) else 1,
            shape=(places[way[0]], places[way[1]]),
        )
        for way in ways
    ]
    follows: dict[str, list[str]] = {part.id: [] for part in parts}
    for before, after in zip(*_turns(ways), strict=True):
        follows[parts[before].id].append(parts[after].id)
    network = build_network(
        f"city-{len(parts)}",
        parts,
        {node(cell): place for cell, place in places.items()},
        {name: tuple(sorted(after)) for name, after in follows.items()},
        signals=[
            node(cell)
            for cell in grid.cells
            if rng.random() < (0.0, signalled_share, 1.0)[grid.arterials_at(cell)]
        ],
        source="generated city",
    )
    return grid, network, {part.id: way for part, way in zip(parts, ways, strict=True)}


def _size(segments: int) -> Cell:
    """Rows and columns of the smallest grid, square or one column wider, with enough segments."""
    rows = columns = 2
    while 2 * (rows * (columns - 1) + columns * (rows - 1)) < segments:
        if columns > rows:
            rows += 1
        else:
            columns += 1
    return rows, columns


def _grid(rng: np.random.Generator, rows: int, columns: int, every: int) -> StreetGrid:
    limits, arterials = [], []
    for lines in (rows, columns):
        main = frozenset(range(int(rng.integers(min(every, lines))), lines, every))
        fast = rng.choice(_ARTERIAL_LIMITS_KMH, lines)
        slow = rng.choice(_STREET_LIMITS_KMH, lines)
        limits.append(tuple(float(fast[i] if i in main else slow[i]) * _KMH for i in range(lines)))
        arterials.append(main)
    return StreetGrid(limits[0], limits[1], arterials[0], arterials[1])


def _thinned(
    rng: np.random.Generator, grid: StreetGrid, segments: int, one_way_share: float
) -> list[Way]:
    cells = set(grid.cells)
    streets = [
        ((row, column), end)
        for row, column in grid.cells
        for end in ((row, column + 1), (row + 1, column))
        if end in cells
    ]
    ways = {way for start, end in streets for way in ((start, end), (end, start))}
    excess = len(ways) - segments
    one_way = min(excess, round(one_way_share * len(streets)))
    one_way += (excess - one_way) % 2
    missing = (excess - one_way) // 2
    for index in rng.permutation(len(streets)):
        start, end = streets[index]
        if grid.is_arterial((start, end)):
            continue
        if missing > 0 and _is_whole(gone := ways - {(start, end), (end, start)}):
            ways, missing = gone, missing - 1
        elif one_way > 0 and missing == 0:
            way = (start, end) if rng.random() < 0.5 else (end, start)
            if _is_whole(gone := ways - {way}):
                ways, one_way = gone, one_way - 1
    return sorted(ways)


def _turns(ways: Sequence[Way]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Indices of all (before, after) pairs of ways, but for U-turns."""
    number = {cell: i for i, cell in enumerate(sorted({cell for way in ways for cell in way}))}
    starts = np.array([number[start] for start, _ in ways])
    ends = np.array([number[end] for _, end in ways])
    every = np.arange(len(ways))
    ones = np.ones(len(ways), dtype=np.int8)
    shape = (len(ways), len(number))
    enters = csr_array((ones, (every, ends)), shape=shape)
    leaves = csr_array((ones, (every, starts)), shape=shape)
    before, after = (enters @ leaves.T).nonzero()
    onward = ends[after] != starts[before]
    return before[onward], after[onward]


def _is_whole(ways: set[Way]) -> bool:
    listed = sorted(ways)
    before, after = _turns(listed)
    ones = np.ones(len(before), dtype=np.int8)
    graph = csr_array((ones, (before, after)), shape=(len(listed), len(listed)))
    return int(connected_components(graph, connection="strong")[0]) == 1
