"""Dense QAOA's circuits, beside a chain's."""

from __future__ import annotations

import numpy as np
import pytest

from dispatcher_daemon.solvers.quantum import Ising, linear_ramp
from dispatcher_daemon.solvers.quantum.backends import fake_target, transpile_on
from slipstream_lab.benchmarks.quantum.depth import compare_depths
from slipstream_lab.research.quantum.dense import (
    dense_qaoa_circuit,
    swap_network_circuit,
    transpile_dense,
)
from tests.dispatcher_daemon.solvers.quantum.devices import line, make_target, probabilities


def dense_ising(n: int, seed: int = 3) -> Ising:
    """All couplings and fields, normalised."""
    rng = np.random.default_rng(seed)
    coupling = np.triu(rng.normal(size=(n, n)), 1)
    return Ising(rng.normal(size=n), coupling + coupling.T, 0.0).normalised()


def test_swap_network_and_routed_circuit_are_dense_qaoa() -> None:
    """All three give the same bits, for an even and an odd number of qubits and layers."""
    target = make_target(line(5))
    for n, layers in ((4, 2), (5, 1)):
        ising, schedule = dense_ising(n), linear_ramp(layers, 0.7, 0.9)
        expected = probabilities(dense_qaoa_circuit(ising, schedule))
        network = swap_network_circuit(ising, schedule)
        assert probabilities(network) == pytest.approx(expected, abs=1e-9)
        on_chain = transpile_on(network, target, range(n))
        assert probabilities(on_chain) == pytest.approx(expected, abs=1e-9)
        routed = transpile_dense(dense_qaoa_circuit(ising, schedule), target)
        assert probabilities(routed) == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
def test_the_chain_saves_two_thirds_of_the_dense_circuits_depth() -> None:
    """On the same device in the same run, against the better of two ways to make it dense."""
    boston = fake_target("FakeBoston")
    depths = compare_depths(dense_ising(25), linear_ramp(1, 0.3, 0.6), boston)
    assert depths.chain_depth == 4
    assert depths.reduction >= 0.667
    assert depths.dense_gates >= 2 * 300
