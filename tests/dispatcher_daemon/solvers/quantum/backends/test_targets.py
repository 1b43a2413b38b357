from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import pytest

from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.backends.aer import fake_target
from dispatcher_daemon.solvers.quantum.backends.targets import (
    transpile_on,
    two_qubit_depth,
    two_qubit_gates,
    with_fractional_gates,
)
from dispatcher_daemon.solvers.quantum.chain.layout import place_chain
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.quantum.ising import Ising
from tests.dispatcher_daemon.solvers.quantum.devices import (
    names,
    probabilities,
    random_chain,
    random_one_hot,
)


@pytest.fixture(scope="module")
def boston() -> Any:
    """Calibration snapshot of the paper's device."""
    return fake_target("FakeBoston")


@pytest.fixture(scope="module")
def fractional(boston: Any) -> Any:
    """The same with fractional gates."""
    return with_fractional_gates(boston)


def dense_ising(n: int, seed: int = 3) -> Ising:
    """All couplings and fields, normalised."""
    rng = np.random.default_rng(seed)
    coupling = np.triu(rng.normal(size=(n, n)), 1)
    return Ising(rng.normal(size=n), coupling + coupling.T, 0.0).normalised()


@pytest.mark.slow
@pytest.mark.parametrize("layers", [1, 2, 5])
def test_a_chain_has_depth_4p_in_cz_and_2p_in_rzz(
    boston: Any, fractional: Any, layers: int
) -> None:
    """25 qubits on FakeBoston: two brick layers a layer, of two CZ or one RZZ each."""
    circuit = circuit_of(scheduled(dense_ising(25), linear_ramp(layers, 0.3, 0.6)))
    for target, depth, gates in ((boston, 4, 48), (fractional, 2, 24)):
        transpiled = transpile_on(circuit, target, place_chain(target, 25).qubits)
        assert two_qubit_depth(transpiled) == depth * layers
        assert two_qubit_gates(transpiled) == gates * layers


@pytest.mark.parametrize("kind", ["cz", "rzz"])
@pytest.mark.parametrize("make", [random_chain, random_one_hot])
def test_transpiled_circuits_give_the_same_bits(
    boston: Any, fractional: Any, kind: str, make: Any
) -> None:
    """Probabilities of all bit strings agree for angles of any size, so bits keep their places."""
    target = boston if kind == "cz" else fractional
    for seed in range(3):
        ansatz = make(5 if make is random_chain else (3, 2), 2, seed)
        circuit = circuit_of(ansatz)
        transpiled = transpile_on(circuit, target, place_chain(target, 5).qubits)
        assert kind in set(names(transpiled))
        assert probabilities(transpiled) == pytest.approx(probabilities(circuit), abs=1e-9)


def test_native_rzz_angles_are_folded_into_range(fractional: Any) -> None:
    """Angles of −7 to 7 become 0 to π/2, the device's range."""
    circuit = circuit_of(random_chain(12, 3, 1))
    transpiled = transpile_on(circuit, fractional, place_chain(fractional, 12).qubits)
    angles = [i.operation.params[0] for i in transpiled.data if i.operation.name == "rzz"]
    assert angles
    assert min(angles) >= 0
    assert max(angles) <= pi / 2
    assert set(names(transpiled)) <= set(fractional.operation_names) | {"barrier"}


def test_fractional_gates_have_the_errors_they_are_assumed_to_have(
    boston: Any, fractional: Any
) -> None:
    """RZZ as its edge's CZ, RX as its qubit's SX; the snapshot itself stays as it was."""
    pair = next(iter(boston["cz"]))
    assert fractional["rzz"][pair].error == boston["cz"][pair].error
    assert fractional["rx"][(7,)].error == boston["sx"][(7,)].error
    assert "rzz" not in boston.operation_names


def test_a_gate_over_a_cut_is_an_error_of_the_caller(boston: Any) -> None:
    """No routing hides that a chain was not cut where it had to be."""
    far = [0, 100]
    with pytest.raises(ValueError, match="no edge for the rzz"):
        transpile_on(circuit_of(random_chain(2, 1, 1)), boston, far)
