"""Placement of a chain on a device: physical qubits in chain order, and bonds without an edge.

The weight of a path is Σ −ln(1 − error) over what a layered circuit uses on it, so that the
lightest path has the highest product of success probabilities.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import networkx as nx
import numpy as np

from slipstream.errors import InputError

ONE_QUBIT_GATES_PER_LAYER = 6
"""Calibrated one-qubit gates per qubit and layer of a transpiled chain, for the weights."""
READOUT_LIMIT = 0.3
"""A qubit with a readout error from here on is not used."""
GATE_LIMIT = 0.1
"""A gate with an error from here on is not used: a cut costs a coupling, such a gate two qubits."""
BEAM = 500
"""Paths kept by the beam search; on FakeBoston, at 25 to 75 qubits, within 0.3 % of the optimum."""
BEAM_QUBITS = 75
"""Chains up to here are searched by beam, longer ones by integer programming."""


@dataclass(frozen=True)
class QubitPlacement:
    """A chain on a device.

    Attributes:
        qubits: physical qubit of each of the chain's.
        cuts: q of each bond (q, q + 1) whose physical qubits share no edge, ascending.
        success: product of (1 − error) over the gates and readouts that a chain circuit uses.
    """

    qubits: tuple[int, ...]
    cuts: tuple[int, ...]
    success: float


def place_chain(
    target: Any, n: int, layers: int = 2, bond_weights: Sequence[float] | None = None
) -> QubitPlacement:
    """The best chain of a device; with as few cuts as it allows, at the lightest bonds.

    A chain without cuts comes from a beam search, or beyond `BEAM_QUBITS` from integer programming,
    which also finds the covers by the fewest path fragments where no single path is long enough.

    Args:
        target: `qiskit.transpiler.Target` with calibrated errors.
        n: number of qubits.
        layers: depth p, which weighs gates against readout.
        bond_weights: loss for cutting bond (q, q + 1), shape (n − 1,); infinite: never. All equal
            by default.

    Raises:
        InputError: the device has too few usable qubits, or only with cuts that are forbidden.
    """
    device = target.description or "the device"
    graph = calibration_graph(target, layers)
    if n > graph.number_of_nodes():
        raise InputError(
            device,
            f"{graph.number_of_nodes()} of its qubits are usable, {n} are needed",
            "use a larger device or smaller blocks",
        )
    nodes = tuple((v, float(w)) for v, w in graph.nodes(data="weight"))
    edges = tuple((min(u, v), max(u, v), float(w)) for u, v, w in graph.edges(data="weight"))
    fragments = _fragments(nodes, edges, n)
    weights = [1.0] * (n - 1) if bond_weights is None else [float(w) for w in bond_weights]
    lengths = _arrange([len(f) for f in fragments], weights)
    if not lengths:
        raise InputError(
            device,
            f"no chain of {n} qubits without a cut where none may be",
            "use a larger device or smaller blocks",
        )
    waiting = sorted(fragments, key=lambda f: (len(f), f))
    paths = [waiting.pop([len(f) for f in waiting].index(length)) for length in lengths]
    qubits = [v for path in paths for v in path]
    bonds = list(nx.utils.pairwise(qubits))
    weight = sum(graph.nodes[v]["weight"] for v in qubits)
    weight += sum(graph.edges[bond]["weight"] for bond in bonds if graph.has_edge(*bond))
    return QubitPlacement(
        qubits=tuple(qubits),
        cuts=tuple(q for q, bond in enumerate(bonds) if not graph.has_edge(*bond)),
        success=math.exp(-weight),
    )


def calibration_graph(target: Any, layers: int = 2) -> Any:
    """The usable qubits and edges as a `networkx.Graph`, each with its ``weight``.

    Left out is what `READOUT_LIMIT` and `GATE_LIMIT` rule out. An RZZ counts once where the device
    has it, otherwise as two gates.
    """
    graph = nx.Graph()
    for qubit in range(target.num_qubits):
        gate = max((_error(target, name, (qubit,)) for name in ("sx", "x")), default=0.0)
        readout = _error(target, "measure", (qubit,))
        if gate < GATE_LIMIT and readout < READOUT_LIMIT:
            one_qubit = -math.log1p(-gate) * ONE_QUBIT_GATES_PER_LAYER * layers
            graph.add_node(qubit, weight=one_qubit - math.log1p(-readout))
    for name in two_qubit_names(target):
        uses = (1 if name == "rzz" else 2) * layers
        for pair in target.qargs_for_operation_name(name) or ():
            error = _error(target, name, pair)
            if error >= GATE_LIMIT or not all(q in graph for q in pair):
                continue
            weight = -math.log1p(-error) * uses
            if weight < graph.edges.get(pair, {"weight": math.inf})["weight"]:
                graph.add_edge(*pair, weight=weight)
    return graph


def two_qubit_names(target: Any) -> list[str]:
    """Names of a target's calibrated two-qubit gates."""
    return [
        name
        for name in target.operation_names
        if getattr(target.operation_from_name(name), "num_qubits", 0) == 2
        and target.qargs_for_operation_name(name) is not None
    ]


def _error(target: Any, name: str, qubits: tuple[int, ...]) -> float:
    """Calibrated error; 0 where none is known, 1 where the device has no such gate there."""
    if name not in target.operation_names:
        return 0.0
    if not target.instruction_supported(name, qubits):
        return 1.0
    properties = target[name].get(qubits) if target[name] else None
    return 0.0 if properties is None or properties.error is None else float(properties.error)


Nodes = tuple[tuple[int, float], ...]
Edges = tuple[tuple[int, int, float], ...]
Paths = tuple[tuple[int, ...], ...]


@lru_cache(maxsize=64)
def _fragments(nodes: Nodes, edges: Edges, n: int) -> Paths:
    graph = nx.Graph()
    for node, weight in nodes:
        graph.add_node(node, weight=weight)
    for u, v, weight in edges:
        graph.add_edge(u, v, weight=weight)
    if n <= BEAM_QUBITS:
        path = _beam(graph, n)
        if path is not None:
            return (path,)
    return _cover(graph, n, single=True) or _cover(graph, n, single=False)


def _beam(graph: Any, n: int) -> tuple[int, ...] | None:
    """A light path of n nodes; of the paths over one set to one end only the lightest is kept."""
    weight = graph.nodes(data="weight")
    front: list[tuple[float, tuple[int, ...], int]]
    front = [(weight[v], (v,), 1 << v) for v in sorted(graph)]
    for _ in range(n - 1):
        best: dict[tuple[int, int], tuple[float, tuple[int, ...], int]] = {}
        for total, path, visited in front:
            for v, edge in graph.adj[path[-1]].items():
                if visited >> v & 1:
                    continue
                longer, key = total + edge["weight"] + weight[v], (v, visited | 1 << v)
                if key not in best or longer < best[key][0]:
                    best[key] = longer, (*path, v), key[1]
        front = sorted(best.values())[:BEAM]
    return front[0][1] if front else None


def _cover(graph: Any, n: int, *, single: bool) -> Paths:
    """Paths over n nodes in all, the fewest and of these the lightest; empty if there is none.

    Asking for a single path is no other problem where there is one, but solved much sooner.
    Integer programme over used nodes and edges; cycles are cut off as they turn up.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array, hstack, identity, vstack

    nodes, edges = sorted(graph), sorted(tuple(sorted(e)) for e in graph.edges)
    index = {v: i for i, v in enumerate(nodes)}
    ends = np.array([[index[u], index[v]] for u, v in edges])
    weight = np.array([graph.nodes[v]["weight"] for v in nodes])
    edge_weight = np.array([graph.edges[e]["weight"] for e in edges])
    # One more edge, so one fragment less, outweighs all weights together.
    dominant = 1 + weight.sum() + edge_weight.sum()
    count = np.arange(len(edges))
    sides = [
        csr_array((np.ones(len(edges)), (count, ends[:, k])), shape=(len(edges), len(nodes)))
        for k in (0, 1)
    ]
    degree = hstack([(sides[0] + sides[1]).T, -2 * identity(len(nodes))])
    within = vstack([hstack([identity(len(edges)), -side]) for side in sides])
    size = np.zeros((2, len(edges) + len(nodes)))
    size[0, len(edges) :] = 1
    size[1, : len(edges)] = 1
    lowest, highest = ([n, n - 1] if single else [n, 0]), [n, n - 1]
    constraints = [
        LinearConstraint(csr_array(degree), -np.inf, 0),
        LinearConstraint(csr_array(within), -np.inf, 0),
        LinearConstraint(size, lowest, highest),
    ]
    while True:
        result = milp(
            np.concatenate([edge_weight - dominant, weight]),
            constraints=constraints,
            integrality=np.ones(len(edges) + len(nodes)),
            bounds=Bounds(0, 1),
            options={"mip_rel_gap": 1e-7},
        )
        if result.x is None:
            return ()
        chosen = result.x > 0.5
        used = nx.Graph()
        used.add_nodes_from(v for i, v in enumerate(nodes) if chosen[len(edges) + i])
        used.add_edges_from(e for k, e in enumerate(edges) if chosen[k])
        parts = [used.subgraph(c) for c in nx.connected_components(used)]
        cycles = [p for p in parts if p.number_of_edges() == p.number_of_nodes()]
        if not cycles:
            return tuple(_along(part) for part in parts)
        for cycle in cycles:
            inside = [k for k, (u, v) in enumerate(edges) if u in cycle and v in cycle]
            rows = np.zeros((len(cycle), len(edges) + len(nodes)))
            rows[:, inside] = 1
            # A forest has fewer edges than nodes, whichever of its nodes is not counted.
            members = [len(edges) + index[v] for v in cycle]
            rows[:, members] = -1
            rows[np.arange(len(cycle)), members] = 0
            constraints.append(LinearConstraint(rows, -np.inf, 0))


def _along(path: Any) -> tuple[int, ...]:
    """Nodes of a path graph from its lower end to the other."""
    ends = sorted(v for v in path if path.degree(v) < 2)
    return tuple(int(v) for v in nx.dfs_preorder_nodes(path, ends[0]))


def _arrange(lengths: Iterable[int], weights: Sequence[float]) -> list[int] | None:
    """The order of fragments that cuts the lightest bonds; None if every order is forbidden."""
    kinds = sorted(Counter(lengths).items(), reverse=True)
    sizes = [size for size, _ in kinds]
    total = sum(size * count for size, count in kinds)

    # Dynamic programme over the number of placed fragments of each kind, which gives the position.
    best: dict[tuple[int, ...], tuple[float, tuple[int, ...]]] = {(0,) * len(kinds): (0.0, ())}
    for _ in range(sum(count for _, count in kinds)):
        following: dict[tuple[int, ...], tuple[float, tuple[int, ...]]] = {}
        for laid, (loss, order) in best.items():
            for k, (size, count) in enumerate(kinds):
                if laid[k] == count:
                    continue
                state = (*laid[:k], laid[k] + 1, *laid[k + 1 :])
                end = sum(s * c for s, c in zip(sizes, state, strict=True))
                value = loss + (weights[end - 1] if end < total else 0.0)
                if value < following.get(state, (math.inf, ()))[0]:
                    following[state] = value, (*order, size)
        best = following
    return list(next(iter(best.values()))[1]) if best else None
