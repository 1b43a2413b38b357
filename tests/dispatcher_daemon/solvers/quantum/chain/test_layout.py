from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
import pytest

from dispatcher_daemon.solvers.quantum.backends.aer import fake_target
from dispatcher_daemon.solvers.quantum.chain.layout import (
    _cover,
    calibration_graph,
    place_chain,
)
from slipstream.errors import InputError
from tests.dispatcher_daemon.solvers.quantum.devices import line, make_target


def grid(seed: int, rows: int = 3, columns: int = 4) -> Any:
    """A grid of qubits with random errors."""
    rng = np.random.default_rng(seed)
    edges = {
        (columns * a[0] + a[1], columns * b[0] + b[1]): float(rng.uniform(1e-3, 2e-2))
        for a, b in nx.grid_2d_graph(rows, columns).edges
    }
    n = rows * columns
    readout = {q: float(rng.uniform(1e-3, 5e-2)) for q in range(n)}
    return make_target(edges, readout=readout)


def weight(graph: Any, path: tuple[int, ...]) -> float:
    """Σ −ln(1 − error) along a path."""
    return float(
        sum(graph.nodes[v]["weight"] for v in path)
        + sum(graph.edges[e]["weight"] for e in pairwise(path))
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_chain_is_the_lightest_of_all_paths(seed: int) -> None:
    """Beam search and integer programme both find what trying all paths finds."""
    target, n = grid(seed), 7
    graph = calibration_graph(target)
    lightest = min(
        weight(graph, tuple(path))
        for a in graph
        for b in graph
        if a < b
        for path in nx.all_simple_paths(graph, a, b, cutoff=n - 1)
        if len(path) == n
    )
    placement = place_chain(target, n)
    assert placement.cuts == ()
    assert placement.success == pytest.approx(math.exp(-lightest))
    (by_programme,) = _cover(graph, n, single=True)
    assert weight(graph, by_programme) == pytest.approx(lightest)


def test_boston_has_a_chain_of_25_without_its_faulty_parts() -> None:
    """25 distinct qubits in a row, over working edges and off qubit 146, whose gates all fail."""
    target = fake_target("FakeBoston")
    placement = place_chain(target, 25)
    assert len(set(placement.qubits)) == 25
    assert placement.cuts == ()
    assert 146 not in placement.qubits
    assert max(target["cz"][pair].error for pair in pairwise(placement.qubits)) < 0.01
    assert placement == place_chain(target, 25)


def test_beyond_the_longest_path_a_chain_has_cuts_at_light_bonds() -> None:
    """130 qubits fit in fragments; all bonds but the cuts have an edge, and cuts are light."""
    target = fake_target("FakeBoston")
    bonds = np.random.default_rng(1).random(129)
    placement = place_chain(target, 130, bond_weights=list(bonds))
    assert len(set(placement.qubits)) == 130
    apart = tuple(
        q for q, pair in enumerate(pairwise(placement.qubits)) if pair not in set(target["cz"])
    )
    assert apart == placement.cuts
    assert 0 < len(placement.cuts) < 8
    assert bonds[list(placement.cuts)].mean() < bonds.mean()


@pytest.mark.parametrize("light", [1, 4])
def test_the_cut_lies_at_the_lightest_bond(light: int) -> None:
    """A star of three legs of two qubits is a path of five and one of two, in the better order."""
    legs = make_target(
        {(0, 1): 0.01, (1, 2): 0.01, (0, 3): 0.01, (3, 4): 0.01, (0, 5): 0.01, (5, 6): 0.01}
    )
    bonds = [1.0] * 6
    bonds[light] = 0.1
    assert place_chain(legs, 7, bond_weights=bonds).cuts == (light,)


def test_a_device_that_is_too_small_is_refused_in_one_line() -> None:
    """More qubits than usable ones, and cuts where none may be, are the user's to mend."""
    target = make_target(line(4), readout={0: 0.01, 1: 0.01, 2: 0.01, 3: 0.45})
    assert place_chain(target, 3).qubits in ((0, 1, 2), (2, 1, 0))
    with pytest.raises(InputError, match="3 of its qubits are usable, 4 are needed"):
        place_chain(target, 4)
    apart = make_target({(0, 1): 0.01, (2, 3): 0.01})
    with pytest.raises(InputError, match="without a cut where none may be"):
        place_chain(apart, 4, bond_weights=[math.inf, math.inf, 1.0])
