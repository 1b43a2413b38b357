"""Training of chain ansätze without a device: exact energies, and samples where CVaR is asked for.

Energies are those of the whole Hamiltonian, all couplings included, of the circuit's exact state.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from dispatcher_daemon.solvers.quantum.chain.batched_lbfgs import minimise
from dispatcher_daemon.solvers.quantum.chain.sites import Ansatz, ChainSites, Real
from dispatcher_daemon.solvers.quantum.chain.state import energies, energies_and_gradients
from dispatcher_daemon.solvers.quantum.ising import Ising

Schedule = Sequence[tuple[float, float]]
"""(β, γ) of each layer."""

C = TypeVar("C")
"""A circuit, as what is trained represents it."""

_KEPT_NUMBERS = 4_000_000
"""About as many complex numbers a reverse sweep may keep: starts beyond that wait their turn."""

_CALL_SHARE = 0.25
"""Of the time that is left, what one call may take."""


@dataclass(frozen=True)
class Trained(Generic[C]):
    """A circuit and how it came about.

    Attributes:
        circuit: the best one that was evaluated.
        value: its objective; of the mean energy if nothing else was asked for.
        evaluations: of the objective, all restarts together.
    """

    circuit: C
    value: float
    evaluations: int


def mean_energy(ising: Ising) -> Callable[[Ansatz], float]:
    """⟨C⟩ as an objective; ``ising`` in chain order."""

    def objective(ansatz: Ansatz) -> float:
        sites = ChainSites(ansatz)
        return float(energies(sites, sites.flat(ansatz)[None], ising)[0])

    return objective


def train_schedule(
    build: Callable[[Schedule], C],
    objective: Callable[[C], float],
    start: Schedule,
    *,
    evaluations: int,
    deadline: float = float("inf"),
) -> Trained[C]:
    """The 2p angles of a schedule by COBYLA, from ``start``.

    Args:
        build: the circuit of a schedule.
        evaluations: most of the objective; at least one is made.
        deadline: `time.perf_counter` at which the best so far is taken.
    """
    from scipy.optimize import minimize

    best: list[Trained[C]] = []

    def value(parameters: Real) -> float:
        circuit = build([(float(beta), float(gamma)) for beta, gamma in parameters.reshape(-1, 2)])
        found = objective(circuit)
        count = best[0].evaluations + 1 if best else 1
        if best and best[0].value <= found:
            best[0] = Trained(best[0].circuit, best[0].value, count)
        else:
            best[:] = [Trained(circuit, found, count)]
        if count >= evaluations or time.perf_counter() >= deadline:
            raise _Enough
        return found

    try:
        # A step of 0.1 rad: a tenth of the ramp's height moves the energy, and does not leave it.
        # COBYLA warns about less than a simplex and a point; `evaluations` ends it all the same.
        most = max(evaluations, 2 * len(start) + 2)
        options = {"maxiter": most, "rhobeg": 0.1}
        minimize(value, np.array(start, dtype=float).ravel(), method="COBYLA", options=options)
    except _Enough:
        pass
    return best[0]


class _Enough(Exception):
    """Evaluations or time are used up."""


def train_angles(
    starts: Sequence[Ansatz],
    ising: Ising,
    *,
    iterations: int,
    deadline: float = float("inf"),
    entangled: bool = True,
    cuts: Sequence[int] = (),
) -> Trained[Ansatz]:
    """Every gate's own angle by L-BFGS with the exact gradient; the start that gets lowest wins.

    Which of them wins is decided by ⟨C⟩ alone. Energies fall towards single bit strings, so that
    what this finds is an answer found classically, written into a circuit.

    Args:
        starts: ansätze of one shape, at least one.
        ising: in chain order.
        iterations: most evaluations for each start.
        deadline: `time.perf_counter` at which the best so far is taken.
        entangled: False keeps all RZZ angles at 0: a product state, the control of this method.
        cuts: bonds between sites, by the number of the first, that stay without a gate.
    """
    sites = ChainSites(starts[0])
    free = sites.free()
    free[sites.bonds[list(cuts)] if entangled else sites.bonds] = False
    angles = np.where(free, [sites.flat(start) for start in starts], 0.0)

    def evaluate(chosen: Real) -> tuple[Real, Real]:
        table = np.zeros((len(chosen), len(free)))
        table[:, free] = chosen
        found, gradients = energies_and_gradients(sites, table, ising)
        return found, gradients[:, free]

    best, lowest, count = angles[0], np.inf, 0
    size = max(1, _KEPT_NUMBERS // (len(ising.h) ** 2 << 2 * sites.layers))
    if deadline < float("inf"):
        # One call evaluates a whole batch and cannot be cut short: where one start alone takes
        # long, fewer go together.
        began = time.perf_counter()
        values, _ = evaluate(angles[:1, free])
        now = time.perf_counter()
        if now >= deadline:
            return Trained(sites.ansatz(best), float(values[0]), 1)
        size = max(1, min(size, int(_CALL_SHARE * (deadline - now) / (now - began))))
    for first in range(0, len(angles), size):
        if count and time.perf_counter() >= deadline:
            break
        found = minimise(evaluate, angles[first : first + size, free], iterations, deadline)
        count += found.evaluations
        winner = int(found.values.argmin())
        if found.values[winner] < lowest:
            best, lowest = np.zeros(len(free)), float(found.values[winner])
            best[free] = found.points[winner]
    return Trained(sites.ansatz(best), lowest, count)


def around(ansatz: Ansatz, spread: float, count: int, seed: int) -> list[Ansatz]:
    """Starts for `train_angles`: ``count`` ansätze with normal noise on the angles of all gates."""
    sites = ChainSites(ansatz)
    flat, free, rng = sites.flat(ansatz), sites.free(), np.random.default_rng(seed)
    return [
        sites.ansatz(flat + spread * free * rng.standard_normal(len(flat))) for _ in range(count)
    ]
