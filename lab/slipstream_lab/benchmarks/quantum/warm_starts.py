"""Warm-started QAOA as seeds of the classical repair, beside random seeds.

    OPENBLAS_NUM_THREADS=1 python -m slipstream_lab.benchmarks.quantum.warm_starts [--seeds N]
    [--layers P ...]

Egger, Mareček and Woerner, "Warm-starting quantum optimization" (2021): the circuit starts in the
product state of a continuous relaxation, with a mixer of which that state is the ground state.
Cold (|+⟩, X mixer) and warm circuits with all couplings are trained on the exact state and sampled
without noise. Each sample is descended and repaired. Controls: uniform bits, the relaxation's bits
sampled without a circuit, and the trained circuit's own marginals. What counts is the processor
time to the first optimum, training included, and the share of repaired samples that are optimal.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from dispatcher_daemon.forms import QuboModel
from dispatcher_daemon.solvers import BitDistribution, Bits, stages
from dispatcher_daemon.solvers.quantum import ramp_of, to_ising
from dispatcher_daemon.solvers.quantum.statevector import (
    Diagonal,
    ExactState,
    Schedule,
    cost_diagonal,
)
from slipstream_lab.benchmarks.quantum.variants import VariantCase, route_cases
from slipstream_lab.research.quantum.angles import train
from slipstream_lab.research.quantum.controls import uniform_bits
from slipstream_lab.research.quantum.store import Record, Store

INSTANCES: Final = 8
OPTIONS: Final = 14
"""Route options, so qubits, of each instance. Published arc instances of this size are no test:
their repair leads from any sample to the optimum."""
LAYERS: Final = (1, 2, 3, 5)
EPSILON: Final = 0.25
"""Relaxed values are kept this far from 0 and 1, as in the paper."""
EVALUATIONS: Final = 60
ALPHA: Final = 0.1
"""Share of the lowest energies whose mean is trained: samples count, not the mean."""
_NOISE_RAD: Final = 0.05
"""Of the angles that training starts from, so that seeds differ."""
_SEEDS: Final = 1000
"""An instance's seed is this times the run's and its number."""
_BATCH: Final = 64
_BATCHES: Final = 8
_LIMIT_S: Final = 5.0
"""Processor time after which a control without an optimum gives up, s."""


def relaxed(model: QuboModel) -> npt.NDArray[np.float64]:
    """Minimiser of the convexified QUBO on [0, 1]^n, shape (n,).

    x² = x lets the diagonal take over what the least eigenvalue lacks to 0: the same values on
    bits, and a convex quadratic between them.
    """
    n = len(model.variables)
    vectors = model.total.to_numpy_vectors(variable_order=model.variables)
    rows, columns, values = vectors.quadratic
    half = np.zeros((n, n))
    half[rows, columns] = values
    half = (half + half.T) / 2
    shift = max(0.0, -float(np.linalg.eigvalsh(half)[0]))
    matrix, linear = half + shift * np.eye(n), vectors.linear_biases - shift
    found = minimize(
        lambda x: (float(x @ matrix @ x + linear @ x), 2 * matrix @ x + linear),
        np.full(n, 0.5),
        jac=True,
        method="L-BFGS-B",
        bounds=[(0.0, 1.0)] * n,
    )
    return np.asarray(found.x)


class WarmState(ExactState):
    """All 2^n states from ⊗ RY(θ_i)|0⟩ with θ_i = 2 arcsin √c_i, double precision.

    The mixer of qubit i is −sin θ_i X − cos θ_i Z; c_i = 1/2 is the usual start and X mixer.

    Args:
        diagonal: C by state, qubit 0 the least significant bit.
        values: c_i, shape (n,), each inside (0, 1).
    """

    def __init__(self, diagonal: Diagonal, values: npt.NDArray[np.float64]) -> None:
        super().__init__(diagonal, block=len(diagonal))
        self.values = values
        theta = 2 * np.arcsin(np.sqrt(values))
        self._axes = np.stack([np.sin(theta), np.cos(theta)], axis=1)
        start = np.ones(1)
        for value in values:
            start = np.kron([np.sqrt(1 - value), np.sqrt(value)], start)
        self._start = start.astype(complex)
        self._state = self._start

    def evolve(self, schedule: Schedule) -> None:
        """See `ExactState`."""
        state = self._start
        for beta, gamma in schedule:
            state = state * np.exp(-1j * gamma * self.diagonal)
            for qubit, (x, z) in enumerate(self._axes):
                rotation = np.cos(beta) * np.eye(2) + 1j * np.sin(beta) * np.array(
                    [[z, x], [x, -z]]
                )
                state = np.matmul(rotation, state.reshape(-1, 2, 1 << qubit)).ravel()
        self._state = state

    def probabilities(self, first: int, last: int) -> npt.NDArray[np.float32]:
        """See `ExactState`."""
        return np.asarray(np.abs(self._state[first:last]) ** 2, dtype=np.float32)

    def bits(self, states: npt.NDArray[np.int64]) -> Bits:
        """See `ExactState`."""
        return ((states[:, None] >> np.arange(len(self.values))) & 1).astype(np.int8)

    def marginals(self) -> BitDistribution:
        """P(x_i = 1) of the state."""
        shares = np.abs(self._state) ** 2
        ones = self.bits(np.arange(len(shares))).T @ shares / shares.sum()
        return BitDistribution(tuple(np.clip(ones, 0.0, 1.0).tolist()))


Draw = Callable[[int], Bits]
"""Rows of bits of the batch of that number."""


def seeds_of(case: VariantCase, draw: Draw, seed: int, began: float) -> Record:
    """Batches of samples through descent and repair, until `_BATCHES` and one optimum are had.

    Args:
        began: process time from which the time to the first optimum counts.
    """
    hits = np.zeros(3)
    first, shots = None, 0
    for number in count():
        rows, counts = np.unique(draw(number), axis=0, return_counts=True)
        samples, _ = stages(case.model, rows, counts, seed)
        of_stages = (samples.raw, samples.descended, samples.repaired)
        if number < _BATCHES:
            shots += samples.shots
            hits += [samples.share(h, case.optimum_kwh) * samples.shots for h in of_stages]
        spent = time.process_time() - began
        if first is None and samples.share(samples.repaired, case.optimum_kwh) > 0:
            first = spent
        if number + 1 >= _BATCHES and (first is not None or spent >= _LIMIT_S):
            break
    raw, descended, repaired = (hits / shots).tolist()
    return {"first_s": first, "raw": raw, "descended": descended, "repaired": repaired}


def circuit(case: VariantCase, values: npt.NDArray[np.float64], layers: int, seed: int) -> Record:
    """One trained circuit, its samples and those of its marginals; both times include training."""
    began = time.process_time()
    ising = to_ising(case.model.total, case.model.variables).normalised()
    state = WarmState(cost_diagonal(ising), values)
    rng = np.random.default_rng(seed)
    ramp = np.array(ramp_of("x", layers))
    start = [(b, g) for b, g in (ramp + _NOISE_RAD * rng.standard_normal(ramp.shape)).tolist()]
    _, evaluations = train(state, start, ALPHA, evaluations=EVALUATIONS)
    train_s = time.process_time() - began

    def sampled(number: int) -> Bits:
        states, counts = state.sample(_BATCH, seed * 1000 + number)
        return np.repeat(state.bits(states), counts, axis=0)

    found = seeds_of(case, sampled, seed, began)
    again = time.process_time() - train_s
    alone = state.marginals()
    control = seeds_of(case, lambda k: alone.sample(_BATCH, seed * 1000 + k), seed, again)
    return {
        "train_s": train_s,
        "evaluations": evaluations,
        "circuit": found,
        "marginals": control,
    }


def run_one(case: VariantCase, arm: str, layers: int, seed: int) -> Record:
    """One run: "random" and "relaxation" without a circuit, "cold" and "warm" with one."""
    n = len(case.model.variables)
    began = time.process_time()
    if arm in ("random", "cold"):
        values = np.full(n, 0.5)
    else:
        values = np.clip(relaxed(case.model), EPSILON, 1 - EPSILON)
    if arm in ("cold", "warm"):
        return circuit(case, values, layers, seed)
    source = uniform_bits(n) if arm == "random" else BitDistribution(tuple(values.tolist()))
    return {
        "circuit": seeds_of(case, lambda k: source.sample(_BATCH, seed * 1000 + k), seed, began)
    }


def rows_of(layers: Sequence[int]) -> list[tuple[str, int]]:
    """Arm and depth of each row; 0: no circuit."""
    return [("random", 0), ("relaxation", 0)] + [(a, p) for a in ("cold", "warm") for p in layers]


def measure(
    store: Store, cases: Sequence[VariantCase], layers: Sequence[int], seeds: int
) -> list[tuple[str, int, list[Record]]]:
    """All runs, those that the store lacks first, seed by seed."""
    for seed in range(1, seeds + 1):
        for arm, p in rows_of(layers):
            for number, case in enumerate(cases, start=1):
                row = f"{arm}/{p}/{seed}"
                if store.get(row, case.name) is None:
                    store.put(row, case.name, run_one(case, arm, p, _SEEDS * seed + number))
    return [
        (
            arm,
            p,
            [
                record
                for case in cases
                for seed in range(1, seeds + 1)
                if (record := store.get(f"{arm}/{p}/{seed}", case.name)) is not None
            ],
        )
        for arm, p in rows_of(layers)
    ]


def table(rows: Sequence[tuple[str, int, Sequence[Mapping[str, Any]]]]) -> Iterable[str]:
    """One line for each row and, of circuits, one for their marginals."""
    yield (
        "| seeds | p | runs | with an optimum | CPU s to the first one, median (most) "
        "| training, CPU s | P_opt raw, % | descended | repaired |"
    )
    yield "|---|--:|--:|--:|--:|--:|--:|--:|--:|"
    for arm, p, records in rows:
        yield _line(f"{arm}" if p == 0 else f"{arm} QAOA", p, records, "circuit")
        if p:
            yield _line(f"{arm} QAOA's marginals", p, records, "marginals")


def _line(title: str, p: int, records: Sequence[Mapping[str, Any]], of: str) -> str:
    firsts = [r[of]["first_s"] for r in records if r[of]["first_s"] is not None]
    shares = [
        f"{100 * statistics.mean(values):.2f} ± {100 * statistics.pstdev(values):.2f}"
        for values in (
            [r[of][stage] for r in records] for stage in ("raw", "descended", "repaired")
        )
    ]
    training = [r["train_s"] for r in records if "train_s" in r]
    spent = f"{statistics.mean(training):.2f}" if training else ""
    first = f"{statistics.median(firsts):.3f} ({max(firsts):.3f})" if firsts else ""
    return f"| {title} | {p or ''} | {len(records)} | {len(firsts)} | {first} | {spent} | " + (
        " | ".join(shares) + " |"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is missing and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.warm_starts", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=5, metavar="N")
    parser.add_argument("--layers", type=int, nargs="+", default=list(LAYERS), metavar="P")
    parser.add_argument("--short", action="store_true", help="one block, one seed, p = 1")
    parser.add_argument("--out", type=Path, default=Path(".slipstream/bench-gates"), metavar="DIR")
    options = parser.parse_args(arguments)
    cases = route_cases(1 if options.short else INSTANCES, OPTIONS)
    layers, seeds = ((1,), 1) if options.short else (options.layers, options.seeds)
    stamp = {"evaluations": EVALUATIONS, "epsilon": EPSILON, "alpha": ALPHA, "batch": _BATCH}
    with Store(options.out / "warm-starts.jsonl", stamp) as store:
        rows = measure(store, cases, layers, seeds)
    print("\n".join(table(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
