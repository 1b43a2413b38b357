from __future__ import annotations

import math
import os
import pickle
import time
from collections.abc import Callable, Sequence
from functools import reduce
from itertools import permutations, product
from typing import get_args

import dimod
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.forms.decode import decode
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import ArcProblem, RouteOption, RouteProblem
from dispatcher_daemon.settings import LcQaoaSettings, LcQaoaVariant
from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.backends.aer import AerBackend
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement
from dispatcher_daemon.solvers.quantum.chain.order import heavy_path, path_weight
from dispatcher_daemon.solvers.quantum.chain.state import ChainState
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.quantum.ising import Ising, to_ising
from dispatcher_daemon.solvers.quantum.lc_qaoa import (
    LcQaoaSolver,
    Prepared,
    counts_to_bits,
    prepare_model,
)

Demo = Callable[..., ArcProblem]


def random_bqm(seed: int, n: int) -> dimod.BinaryQuadraticModel:
    """A dense random model over v0, v1, ..."""
    rng = np.random.default_rng(seed)
    linear = {f"v{i}": float(rng.normal()) for i in range(n)}
    quadratic = {(f"v{i}", f"v{j}"): float(rng.normal()) for i in range(n) for j in range(i)}
    return dimod.BinaryQuadraticModel(linear, quadratic, float(rng.normal()), "BINARY")


@pytest.mark.slow
@given(seed=st.integers(0, 1000), n=st.integers(1, 5))
def test_ising_has_the_qubos_energy_in_qiskits_convention(seed: int, n: int) -> None:
    """With x = (1 − z)/2 both give every state the same energy."""
    bqm = random_bqm(seed, n)
    names = [f"v{i}" for i in range(n)]
    ising = to_ising(bqm, names)
    for bits in product((0, 1), repeat=n):
        z = 1 - 2 * np.array(bits)
        energy = ising.offset + ising.h @ z + z @ ising.coupling @ z / 2
        assert energy == pytest.approx(bqm.energy(dict(zip(names, bits, strict=True))))


def reference_probabilities(ising: Ising, angles: list[tuple[float, float]]) -> np.ndarray:
    """Chain QAOA by plain matrix algebra; state s has bit q of s on qubit q."""
    n = len(ising.h)
    states = (np.arange(2**n)[:, None] >> np.arange(n)) & 1
    z = 1 - 2 * states
    cost = z @ ising.h + sum(
        (ising.coupling[q, q + 1] * z[:, q] * z[:, q + 1] for q in range(n - 1)), np.zeros(2**n)
    )
    amplitude = np.full(2**n, 2 ** (-n / 2), dtype=complex)
    for beta, gamma in angles:
        amplitude = np.exp(-1j * gamma * cost) * amplitude
        mixer = np.array([[np.cos(beta), 1j * np.sin(beta)], [1j * np.sin(beta), np.cos(beta)]])
        # Qubit n − 1 is the most significant bit, so it comes first in the product.
        amplitude = reduce(np.kron, [mixer] * n) @ amplitude
    return np.asarray(np.abs(amplitude) ** 2)


@pytest.mark.slow
def test_circuit_is_the_formula_and_bits_come_back_in_order() -> None:
    """Sampled frequencies of an asymmetric chain agree with the state vector, bit by bit."""
    bqm = random_bqm(5, 4)
    order = [2, 0, 3, 1]
    ising = to_ising(bqm, [f"v{i}" for i in range(4)]).permuted(order)
    angles = linear_ramp(2, 0.4, 0.7)
    counts = AerBackend().sample(circuit_of(scheduled(ising, angles)), 40_000, 3).counts
    bits, shots = counts_to_bits(counts, order)
    expected = reference_probabilities(ising, angles)
    measured = np.zeros(16)
    for row, count in zip(bits, shots, strict=True):
        by_qubit = row[order]
        measured[int(by_qubit @ (1 << np.arange(4)))] += count / 40_000
    assert measured == pytest.approx(expected, abs=0.01)
    assert np.abs(expected - expected[::-1]).max() > 0.05


def test_ramp_lowers_the_energy_below_uniform_sampling() -> None:
    """The signs are right: samples of a chain problem are better than random ones on average."""
    n = 8
    rng = np.random.default_rng(0)
    coupling = np.zeros((n, n))
    for q in range(n - 1):
        coupling[q, q + 1] = coupling[q + 1, q] = rng.normal()
    ising = Ising(rng.normal(size=n), coupling, 0.0).normalised()
    circuit = circuit_of(scheduled(ising, linear_ramp(4, 0.6, 1.0)))
    counts = AerBackend().sample(circuit, 4000, 1).counts
    bits, shots = counts_to_bits(counts, list(range(n)))
    z = 1 - 2 * bits.astype(float)
    energy = z @ ising.h + np.einsum("si,ij,sj->s", z, ising.coupling, z) / 2
    assert np.average(energy, weights=shots) < -0.5


def test_linear_ramp_is_lr_qaoas() -> None:
    """β falls from Δβ to Δβ/p, γ rises from Δγ/p to Δγ."""
    assert linear_ramp(2, 0.3, 0.6) == [(0.3, 0.3), (0.15, 0.6)]
    assert linear_ramp(1, 0.3, 0.6) == [(0.3, 0.6)]


@pytest.mark.slow
@given(seed=st.integers(0, 10**6), n=st.integers(1, 6))
def test_chain_is_a_heavy_hamiltonian_path(seed: int, n: int) -> None:
    """Every variable comes once, with at least half the heaviest path's weight (greedy's bound)."""
    coupling = random_coupling(seed, n)
    path = heavy_path(coupling)
    assert sorted(path) == list(range(n))
    assert path_weight(coupling, path) >= 0.5 * heaviest(coupling)


def random_coupling(seed: int, n: int) -> np.ndarray:
    """A sparse symmetric matrix."""
    rng = np.random.default_rng(seed)
    coupling = np.triu(rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.7), 1)
    return coupling + coupling.T


def heaviest(coupling: np.ndarray) -> float:
    """Weight of the heaviest path, by trying all."""
    return max(path_weight(coupling, list(p)) for p in permutations(range(len(coupling))))


def test_normalised_has_a_largest_coefficient_of_one() -> None:
    """Normalisation scales h and J together; an empty Hamiltonian stays as it is."""
    ising = Ising(np.array([0.5, -4.0]), np.array([[0.0, 2.0], [2.0, 0.0]]), 1.0).normalised()
    assert np.abs(ising.h).max() == 1.0
    assert ising.coupling[0, 1] == 0.5
    empty = Ising(np.zeros(2), np.zeros((2, 2)), 0.0)
    assert empty.normalised() is empty


@pytest.mark.slow
def test_demo_is_solved_with_raw_and_repaired_samples_apart(demo_arcs: Demo) -> None:
    """The answer is valid; raw statistics are those of the samples as drawn, and near zero."""
    problem = demo_arcs(avenue_east=1, avenue_west=1)
    outcome = LcQaoaSolver(LcQaoaSettings(variant="ramp")).solve(problem, 120.0, seed=7)
    assert outcome.status == "feasible"
    assert outcome.selected is not None
    assert decode(problem, outcome.selected).routes is not None
    samples = outcome.samples
    assert samples is not None
    assert (samples.qubits, samples.shots) == (25, 4096)
    assert samples.share(samples.raw) < 0.02
    assert samples.share(samples.repaired) > samples.share(samples.raw)
    best_raw = min((value for value, _ in samples.raw), default=float("inf"))
    answered = problem.objective_kwh(outcome.selected)
    assert outcome.repaired == (best_raw > answered + 1e-9)


@pytest.mark.slow
def test_same_seed_same_answer(demo_arcs: Demo) -> None:
    """Two runs with one seed agree in everything but time; seed 0 is a seed like any other."""
    problem = demo_arcs(avenue_east=1, avenue_west=1)
    solver = LcQaoaSolver(LcQaoaSettings(variant="ramp", shots=512))
    for seed in (0, 11):
        one, two = (solver.solve(problem, 120.0, seed) for _ in range(2))
        assert (one.selected, one.samples) == (two.selected, two.samples)


def small_routes() -> RouteProblem:
    """Three vehicles with three options each; the cheapest ones do not meet."""
    options = tuple(
        RouteOption(f"v{k}", (f"s{k}",), cost)
        for k in range(3)
        for cost in (1.0, 1.05 + 0.01 * k, 1.2)
    )
    return RouteProblem(
        ("v0", "v1", "v2"), ("s0", "s1", "s2"), options, {(1, 4): 0.2, (4, 7): 0.2, (2, 8): 0.1}
    )


def prepare(
    problem: ArcProblem | RouteProblem, options: LcQaoaSettings, seed: int, deadline: float
) -> Prepared:
    """The circuit of a problem, from two starts."""
    model = build_model(problem)
    return prepare_model(model, options, seed=seed, deadline=deadline, restarts=2)


VARIANTS: tuple[LcQaoaVariant, ...] = get_args(LcQaoaVariant)


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
def test_prepared_circuit_means_what_it_says(variant: LcQaoaVariant) -> None:
    """Its samples, by variable, have the stated mean energy and marginals, also after pickling."""
    options = LcQaoaSettings(variant=variant, iterations=20)
    made = prepare(small_routes(), options, 3, math.inf)
    prepared = pickle.loads(pickle.dumps(made))
    by_qubit = ChainState(prepared.ansatz).sample(4000, 1)
    bits = np.empty_like(by_qubit)
    bits[:, list(prepared.order)] = by_qubit
    energies = prepared.model.total.energies((bits, list(prepared.model.variables)))
    error = energies.std() / 4000**0.5
    assert prepared.energy == pytest.approx(energies.mean(), abs=5 * error + 1e-3)
    assert np.array(prepared.marginals.probabilities) == pytest.approx(bits.mean(axis=0), abs=0.05)
    assert (prepared.variant, prepared.evaluations > 0) == (variant, variant != "ramp")
    one_each = bits.reshape(-1, 3, 3).sum(axis=2) == 1
    if variant.startswith("one-hot"):
        assert one_each.all()
    elif variant in ("ramp", "trained"):
        assert not one_each.all()


@pytest.mark.slow
def test_one_hot_solves_routes_and_refuses_arcs(demo_arcs: Demo) -> None:
    """Every raw sample of route options is valid; arcs have no groups, which is said."""
    solver = LcQaoaSolver(LcQaoaSettings(variant="one-hot-multi-angle", shots=256), restarts=4)
    outcome = solver.solve(small_routes(), 60.0, 1)
    assert outcome.selected == {1, 4, 7}
    assert outcome.samples is not None
    assert outcome.samples.share(outcome.samples.raw) == 1.0
    assert outcome.execution is not None
    assert (outcome.execution.variant, outcome.execution.layers) == ("one-hot-multi-angle", 2)
    refused = solver.solve(demo_arcs(), 60.0, 1)
    assert (refused.status, refused.selected) == ("failed", None)
    assert "route form" in str(refused.reason)


def test_training_that_has_no_time_left_still_prepares_a_circuit(demo_arcs: Demo) -> None:
    """One start is looked at once, and taken."""
    options = LcQaoaSettings(variant="multi-angle", iterations=100_000)
    assert prepare(demo_arcs(), options, 1, deadline=0.0).evaluations == 1
    assert prepare(demo_arcs(), LcQaoaSettings(), 1, deadline=0.0).evaluations == 1


def test_a_device_that_cuts_the_chain_gets_no_gate_there() -> None:
    """The placement is asked once, with the couplings along the chain; its cuts have angle 0."""
    asked: list[tuple[int, int]] = []

    def place(n: int, weights: Sequence[float]) -> QubitPlacement:
        asked.append((n, len(weights)))
        return QubitPlacement(tuple(range(n)), (4,), 1.0)

    for variant in ("trained", "multi-angle"):
        options = LcQaoaSettings(variant=variant, iterations=5)
        prepared = prepare_model(
            build_model(small_routes()), options, seed=1, deadline=math.inf, place=place, restarts=1
        )
        assert np.all(prepared.ansatz.bonds[:, 4] == 0)
        assert np.any(prepared.ansatz.bonds[:, 3] != 0)
    assert asked == [(9, 8), (9, 8)]


@pytest.mark.long
@pytest.mark.parametrize("variant", ["one-hot-multi-angle", "trained"])
def test_a_wide_circuit_holds_its_deadline(variant: LcQaoaVariant) -> None:
    """By the processor's time: training, samples and their processing fit, with fewer samples.

    All 4,096 of 100 options would take more than the deadline after training.
    """
    rng = np.random.default_rng(1)
    vehicles, options = tuple(f"v{i}" for i in range(20)), 5
    costs = rng.uniform(1.0, 2.0, size=len(vehicles) * options)
    problem = RouteProblem(
        vehicles,
        (),
        tuple(RouteOption(vehicles[i // options], (), float(c)) for i, c in enumerate(costs)),
        {
            (a, b): float(rng.uniform(0.0, 0.2))
            for a in range(len(costs))
            for b in range(a + 1, len(costs))
            if a // options != b // options and rng.random() < 0.4
        },
    )
    solver = LcQaoaSolver(LcQaoaSettings(variant=variant))
    solver.warm_up()
    began = time.process_time()
    outcome = solver.solve(problem, 2.5, 1)
    # Circuits are computed in as many threads as there are cores, at least two.
    assert time.process_time() - began < 2.5 * max(2, os.cpu_count() or 1)
    assert outcome.status == "feasible"
    assert outcome.samples is not None
    assert 16 <= outcome.samples.shots < 4096
