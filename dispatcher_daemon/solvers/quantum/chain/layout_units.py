"""A chain of units on a device: runs of qubits that must not be cut, one after another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

JOINT = 0.2
"""Bonus of an edge between two units, in units of −ln(1 − error)."""
LIMIT_S = 60.0
"""Time limit of the packing, s; it takes seconds."""
BEAM = 200
"""Orders kept by the beam search."""
MAX_PATHS = 50_000
"""Maximum number of candidate paths; devices' graphs have some thousands of short ones."""

Path = tuple[int, ...]


def place_units(graph: Any, sizes: Sequence[int], weights: Sequence[float]) -> list[Path] | None:
    """Disjoint paths of the sizes of the units, in the units' order; None where there are none.

    Set packing of all paths of these sizes, light ones with edges between their ends; then a beam
    search for an order, and for each path's direction, in which those edges keep heavy bonds.

    Args:
        graph: usable qubits and edges with their ``weight``.
        sizes: qubits of each unit, in chain order.
        weights: loss for cutting the bond between a unit and the next, shape (units − 1,).
    """
    packed = _pack(graph, Counter(sizes))
    return None if packed is None else _order(graph, packed, sizes, weights)


def _pack(graph: Any, counts: Counter[int]) -> list[Path] | None:
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array, hstack

    paths = [path for size in sorted(counts) for path in _paths(graph, size)]
    if not paths or len(paths) > MAX_PATHS:
        return None
    index = {v: i for i, v in enumerate(sorted(graph))}
    edges = sorted(tuple(sorted(e)) for e in graph.edges)

    def incidence(pairs: Iterable[tuple[Any, int]], columns: int) -> Any:
        at = [(index[v], k) for v, k in pairs]
        shape = (len(index), columns)
        return csr_array((np.ones(len(at)), tuple(zip(*at, strict=True))), shape=shape)

    cover = incidence(((v, k) for k, path in enumerate(paths) for v in path), len(paths))
    ends = incidence(((v, k) for k, p in enumerate(paths) for v in (p[0], p[-1])), len(paths))
    joints = incidence(((v, k) for k, e in enumerate(edges) for v in e), len(edges))
    sizes = np.array([len(path) for path in paths])
    kinds = sorted(counts)
    by_size = csr_array(np.array([sizes == size for size in kinds], dtype=float))
    wanted = np.array([counts[size] for size in kinds])
    weight = np.array([_weight(graph, path) for path in paths])
    result = milp(
        np.concatenate([weight, np.full(len(edges), -JOINT)]),
        constraints=[
            LinearConstraint(hstack([cover, csr_array(joints.shape)]), -np.inf, 1),
            LinearConstraint(hstack([-ends, joints]), -np.inf, 0),
            LinearConstraint(
                hstack([by_size, csr_array((len(kinds), len(edges)))]), wanted, wanted
            ),
        ],
        integrality=np.ones(len(paths) + len(edges)),
        bounds=Bounds(0, 1),
        options={"mip_rel_gap": 0.03, "time_limit": LIMIT_S},
    )
    if result.x is None:
        return None
    return [path for path, share in zip(paths, result.x, strict=False) if share > 0.5]


def _paths(graph: Any, size: int) -> list[Path]:
    """All paths of so many nodes, each in one direction."""
    found: list[Path] = [(v,) for v in sorted(graph)]
    for _ in range(size - 1):
        found = [(*p, v) for p in found for v in sorted(graph[p[-1]]) if v not in p]
        if len(found) > 2 * MAX_PATHS:
            break
    return [path for path in found if path[0] <= path[-1]]


def _weight(graph: Any, path: Path) -> float:
    nodes = sum(graph.nodes[v]["weight"] for v in path)
    return float(nodes + sum(graph.edges[e]["weight"] for e in pairwise(path)))


def _order(
    graph: Any, packed: Sequence[Path], sizes: Sequence[int], weights: Sequence[float]
) -> list[Path]:
    directed = [path for p in packed for path in ((p, p[::-1]) if len(p) > 1 else (p,))]
    number = {frozenset(path): k for k, path in enumerate(packed)}
    loss = [0.0, *weights]
    front: list[tuple[float, int, tuple[Path, ...]]] = [(0.0, 0, ())]
    for size, cut in zip(sizes, loss, strict=True):
        following: dict[tuple[int, Path], tuple[float, int, tuple[Path, ...]]] = {}
        for total, laid, chain in front:
            for path in directed:
                bit = 1 << number[frozenset(path)]
                if len(path) != size or laid & bit:
                    continue
                joined = not chain or graph.has_edge(chain[-1][-1], path[0])
                value = total if joined else total + cut
                key = laid | bit, path
                if key not in following or value < following[key][0]:
                    following[key] = value, laid | bit, (*chain, path)
        front = sorted(following.values())[:BEAM]
    return list(front[0][2])
