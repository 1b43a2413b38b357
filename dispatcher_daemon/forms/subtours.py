"""Rows that exclude subtours in the arc form: the paper's, and a reduced set.

A row is a linear equality over order variables u ≥ 0, arcs and slack bits; its square is the
penalty. Every valid route set can satisfy the rows and no set with a cycle apart from the depot
can, be they `full_rows` (Miller–Tucker–Zemlin for each vehicle) or `order_rows` (order variables
u_j shared by the vehicles, x_ij = Σ_k x_ijk). Reasons and proofs: docs/formulation.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from dispatcher_daemon.forms.problem import ArcProblem

Pair = tuple[str, str]


@dataclass(frozen=True)
class PrecedenceRow:
    """u_i − u_j + ``weight`` x_ij + ``constant`` + Σ_m slack_m w_m = 0 for the arc (i, j).

    Attributes:
        vehicle: whose u and x they are; None: u is shared and x_ij the sum over the vehicles.
    """

    start: str
    end: str
    weight: int
    constant: int
    slack: tuple[int, ...] = ()
    vehicle: str | None = None


def bits_for(values: int) -> int:
    """Number of bits that hold 0..values − 1; ⌈log2 values⌉."""
    return (values - 1).bit_length()


def full_rows(problem: ArcProblem) -> tuple[PrecedenceRow, ...]:
    """u_ik − u_jk + N x_ijk ≤ N − 1 for each candidate arc between customers (paper III-B).

    u takes the values 0..2^B − 1 of its B bits, of which a tour needs 0..N − 1, so the slack needs
    0..2(N − 1). Pairs (i, j, k) that are no candidate arc have no x and need no row.
    """
    size = len(problem.customers)
    slack = tuple(1 << bit for bit in range(bits_for(2 * size - 1)))
    return tuple(
        PrecedenceRow(arc.start, arc.end, size, 1 - size, slack, arc.vehicle)
        for arc in problem.arcs
        if problem.depot not in (arc.start, arc.end)
    )


def order_rows(problem: ArcProblem) -> tuple[PrecedenceRow, ...]:
    """Rows that exclude every subtour, and equalities that tie the other stops' order to them."""
    customers = problem.customers
    longest = len(customers) - len(problem.vehicles)
    components = [c for c in _cyclic_components(problem) if longest >= 2 and len(c) >= 2]
    arcs = sorted({(a.start, a.end) for a in problem.arcs if problem.depot not in (a.start, a.end)})
    inside = _arcs_on_cycles(problem)
    rows: list[PrecedenceRow] = []
    for component in components:
        pairs = [p for p in arcs if p in inside and p[0] in component and p[1] in component]
        # A vehicle can serve all stops but those that the other vehicles leave the depot for.
        run = min(len(component), longest + 1)
        rows += _pair_rows(pairs) if len(component) == 2 else _mtz_rows(pairs, run)
    rows += _forest_rows(customers, arcs, components)
    return tuple(rows)


def _pair_rows(pairs: Sequence[Pair]) -> list[PrecedenceRow]:
    """The 2-cycle i→j→i: u_i − u_j is −1 or 1, and both arcs at once leave it no value."""
    (i, j), (_, _) = pairs
    return [PrecedenceRow(i, j, 2, -1, (2,)), PrecedenceRow(j, i, 2, -1)]


def _mtz_rows(pairs: Sequence[Pair], run: int) -> list[PrecedenceRow]:
    """u_i − u_j + M x_ij ≤ M − 1 with M = ``run``, its slack of 0..2(M − 1) in binary."""
    slack = tuple(1 << bit for bit in range(bits_for(2 * run - 1)))
    return [PrecedenceRow(i, j, run, 1 - run, slack) for i, j in pairs]


def _forest_rows(
    customers: Sequence[str], arcs: Sequence[Pair], components: Sequence[frozenset[str]]
) -> list[PrecedenceRow]:
    """u_j = u_i + x_ij on a spanning forest between the components: always satisfiable."""
    parent = {name: name for name in customers}

    def root(name: str) -> str:
        while parent[name] != name:
            name = parent[name]
        return name

    for component in components:
        first, *others = sorted(component)
        for other in others:
            parent[root(other)] = root(first)
    rows = []
    for i, j in arcs:
        if root(i) != root(j):
            parent[root(j)] = root(i)
            rows.append(PrecedenceRow(i, j, 1, 0))
    return rows


def _arcs_on_cycles(problem: ArcProblem) -> set[Pair]:
    """Arcs between customers that lie on a cycle which a single vehicle could drive."""
    cyclic: set[Pair] = set()
    for vehicle in problem.vehicles:
        pairs = [
            (a.start, a.end)
            for a in problem.arcs
            if a.vehicle == vehicle and problem.depot not in (a.start, a.end)
        ]
        label = _strong_labels(problem.customers, pairs)
        cyclic |= {(i, j) for i, j in pairs if label[i] == label[j]}
    return cyclic


def _cyclic_components(problem: ArcProblem) -> list[frozenset[str]]:
    label = _strong_labels(problem.customers, _arcs_on_cycles(problem))
    groups: dict[int, set[str]] = {}
    for name in problem.customers:
        groups.setdefault(label[name], set()).add(name)
    return [frozenset(group) for group in groups.values()]


def _strong_labels(customers: Sequence[str], pairs: Iterable[Pair]) -> dict[str, int]:
    index = {name: i for i, name in enumerate(customers)}
    links = sorted({(index[i], index[j]) for i, j in pairs})
    rows, columns = zip(*links, strict=True) if links else ((), ())
    size = len(customers)
    graph = csr_array((np.ones(len(links)), (rows, columns)), shape=(size, size))
    _, labels = connected_components(graph, directed=True, connection="strong")
    return {name: int(labels[i]) for name, i in index.items()}
