from __future__ import annotations

from itertools import pairwise, permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp
from dispatcher_daemon.solvers.quantum.chain.one_hot import (
    group_order,
    inside_groups,
    one_hot_scheduled,
    uniform_start,
)
from dispatcher_daemon.solvers.quantum.chain.state import ChainState
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.quantum.ising import Ising


def random_ising(seed: int, n: int) -> Ising:
    """All couplings."""
    rng = np.random.default_rng(seed)
    coupling = np.triu(rng.normal(size=(n, n)), 1)
    return Ising(rng.normal(size=n), coupling + coupling.T, float(rng.normal()))


def selections(groups: list[list[int]]) -> np.ndarray:
    """Bits of every choice of one member from each group."""
    rows = []
    for chosen in product(*groups):
        bits = np.zeros(sum(map(len, groups)), dtype=np.int8)
        bits[list(chosen)] = 1
        rows.append(bits)
    return np.array(rows)


def energies(ising: Ising, bits: np.ndarray) -> np.ndarray:
    """C of each row."""
    z = 1.0 - 2.0 * bits
    return np.asarray(
        ising.offset + z @ ising.h + np.einsum("si,ij,sj->s", z, ising.coupling, z) / 2
    )


@pytest.mark.slow
@given(seed=st.integers(0, 1000))
def test_hamiltonian_inside_groups_has_the_same_energies_there(seed: int) -> None:
    """Whatever the groups are, also of one; nothing couples members of one group any more."""
    groups = [[4, 0, 2], [1], [3, 6], [5, 7, 8, 9]]
    ising = random_ising(seed, 10)
    inside = inside_groups(ising, groups)
    bits = selections(groups)
    assert energies(inside, bits) == pytest.approx(energies(ising, bits))
    for group in groups:
        assert inside.coupling[np.ix_(group, group)] == pytest.approx(0.0)
        assert inside.h[group].sum() == pytest.approx(0.0)


def test_energy_of_a_one_hot_state_is_that_of_the_whole_hamiltonian() -> None:
    """The expectation does not depend on which of the two Hamiltonians is asked."""
    ising = random_ising(3, 9)
    groups = [[0, 1, 2, 3], [4, 5], [6, 7, 8]]
    inside = inside_groups(ising, groups)
    ansatz = one_hot_scheduled(inside, (4, 2, 3), linear_ramp(2, 0.7, 0.9))
    state = ChainState(ansatz)
    assert state.energy(inside) == pytest.approx(state.energy(ising))


@pytest.mark.parametrize("groups", [(5, 5), (1, 4, 2), (6, 3), (1, 1)])
def test_start_is_uniform_and_real(groups: tuple[int, ...]) -> None:
    """Without phases and mixers every choice has the same amplitude, sign and all."""
    from qiskit.quantum_info import Statevector

    n = sum(groups)
    idle = Ising(np.zeros(n), np.zeros((n, n)), 0.0)
    ansatz = one_hot_scheduled(idle, groups, [(0.0, 0.0)])
    circuit = circuit_of(ansatz).remove_final_measurements(inplace=False)
    amplitudes = np.asarray(Statevector(circuit))
    choices = np.abs(amplitudes) > 1e-9
    assert choices.sum() == np.prod(groups)
    assert amplitudes[choices] == pytest.approx(amplitudes[choices][0])
    assert len(uniform_start(groups)[0]) == len(groups)


def test_ramp_prefers_cheap_choices() -> None:
    """The signs are right: the ramp's mean energy is below that of uniform choices."""
    rng = np.random.default_rng(0)
    groups = [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    inside = inside_groups(random_ising(int(rng.integers(100)), 9), groups).normalised()
    uniform = energies(inside, selections(groups)).mean()
    ansatz = one_hot_scheduled(inside, (3, 3, 3), linear_ramp(3, 0.6, 1.0))
    assert ChainState(ansatz).energy(inside) < uniform - 0.3


@given(seed=st.integers(0, 1000))
def test_ends_of_groups_are_the_best_for_their_path(seed: int) -> None:
    """Groups stay together, and no other choice of ends along the same path has more weight."""
    coupling = random_ising(seed, 8).coupling
    groups = [[0, 3], [1, 4, 6], [2], [5, 7]]
    order, sizes = group_order(coupling, groups)
    assert sorted(order) == list(range(8))
    path, first = [], 0
    for size in sizes:
        path.append(list(order[first : first + size]))
        first += size
    assert sorted(map(sorted, path)) == sorted(map(sorted, groups))
    weight = np.abs(coupling)

    def value(laid: tuple[tuple[int, ...], ...]) -> float:
        return float(sum(weight[a[-1], b[0]] for a, b in pairwise(laid)))

    best = max(value(laid) for laid in product(*(list(permutations(g)) for g in path)))
    assert value(tuple(map(tuple, path))) == pytest.approx(best)
