"""The linear-ramp test of a device: whether its samples still carry a signal, by width and depth.

Montañez-Barrera, Michielsen and Bernal Neira, arXiv 2502.06471: QAOA with a fixed linear schedule
on weighted MaxCut, here on a chain, the shape of LC-QAOA's circuits. A chain's largest cut cuts
every edge, so that the approximation ratio r = mean cut / Σ w needs no solver, and uniform bits cut
each edge independently with probability 1/2, so that the limit for them is exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from dispatcher_daemon.solvers.quantum import Ising, chain_circuit, linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.backends import Backend, FaultKind, ServiceFault
from dispatcher_daemon.solvers.quantum.statevector import StateVector, cost_diagonal
from slipstream.config import Settings

DELTA_BETA: Final = 0.3
DELTA_GAMMA: Final = 0.6
SIGMAS: Final = 3.0

_IDEAL_QUBITS: Final = 20
"""The exact r without noise is simulated up to here."""
_PASSING: Final[tuple[FaultKind, ...]] = ("broken", "garbage")
"""Faults of one job; after others the device is not asked again."""


class DeviceTestSettings(Settings):
    """Which circuits are tried, and where."""

    backend: str = Field(default="aer:FakeBoston", description="As of `open_backend`.")
    widths: tuple[Annotated[int, Field(ge=2, le=1000)], ...] = Field(
        default=(5, 10, 15, 20), min_length=1, description="Qubits."
    )
    layers: tuple[Annotated[int, Field(ge=1, le=10_000)], ...] = Field(
        default=(1, 2, 5, 10), min_length=1, description="Depths p."
    )
    shots: int = Field(default=512, ge=16, le=100_000, description="Of each circuit.")
    seed: int = Field(default=1, ge=0, lt=2**32, description="Of weights and simulated noise.")


@dataclass(frozen=True)
class Cell:
    """One circuit.

    Attributes:
        width: qubits n.
        layers: depth p.
        shots: as counted; 0 where there is a fault.
        r: mean share of the largest cut, 0 to 1.
        error: standard error of r by the shots.
        limit: 0.5 + 3 σ of as many uniform samples.
        ideal: r without noise, exact; None for widths that are not simulated.
        two_qubit_depth, two_qubit_gates: of the circuit as it ran.
        sample_s: wall time, s.
        job: the service's id.
        fault: why there is no r.
    """

    width: int
    layers: int
    shots: int = 0
    r: float | None = None
    error: float | None = None
    limit: float | None = None
    ideal: float | None = None
    two_qubit_depth: int | None = None
    two_qubit_gates: int | None = None
    sample_s: float | None = None
    job: str | None = None
    fault: str | None = None

    @property
    def above(self) -> bool:
        """Whether r is above random sampling at 3 σ."""
        return self.r is not None and self.limit is not None and self.r > self.limit

    @property
    def signal(self) -> float | None:
        """Share of the ideal gain over random sampling that is left: (r − ½) / (r_ideal − ½)."""
        if self.r is None or self.ideal is None:
            return None
        return (self.r - 0.5) / (self.ideal - 0.5)


@dataclass(frozen=True)
class DeviceVerdict:
    """What the cells of one width say.

    Attributes:
        above_to: greatest depth p up to which every one is above random; None: none is.
        best: the depth with the greatest r; None without any r.
        failed: whether a depth was measured that is not above random.
    """

    width: int
    above_to: int | None
    best: int | None
    failed: bool


def chain_weights(width: int, seed: int) -> npt.NDArray[np.float64]:
    """Edge weights of the chain, uniform on (0, 1], shape (width − 1,)."""
    return 1.0 - np.random.default_rng([seed, width]).random(width - 1)


def max_cut(weights: npt.NDArray[np.float64]) -> Ising:
    """Σ w_q Z_q Z_{q+1}, to be minimised, normalised to a largest |J| of 1."""
    couplings = np.diag(weights / weights.max(), 1)
    return Ising(np.zeros(len(weights) + 1), couplings + couplings.T, 0.0)


def quality(
    counts: Mapping[str, int], weights: npt.NDArray[np.float64]
) -> tuple[float, float, int]:
    """r, its standard error and the number of shots, of Qiskit's bit strings."""
    strings = sorted(counts)
    bits = np.array([[int(c) for c in reversed(text)] for text in strings])
    shots = np.array([counts[text] for text in strings])
    ratios = (bits[:, 1:] != bits[:, :-1]) @ weights / weights.sum()
    total = int(shots.sum())
    mean = float(ratios @ shots / total)
    variance = float(((ratios - mean) ** 2) @ shots / max(1, total - 1))
    return mean, math.sqrt(variance / total), total


def random_limit(weights: npt.NDArray[np.float64], shots: int) -> float:
    """½ + 3 σ of the mean r of uniform samples; σ² = Σ w² / (4 (Σ w)² · shots)."""
    sigma = math.sqrt(float((weights**2).sum()) / shots) / (2 * float(weights.sum()))
    return 0.5 + SIGMAS * sigma


def ideal_quality(weights: npt.NDArray[np.float64], layers: int) -> float | None:
    """r of the circuit without noise, exact."""
    if len(weights) >= _IDEAL_QUBITS:
        return None
    ising = max_cut(weights)
    state = StateVector(cost_diagonal(ising), threads=1)
    state.evolve(linear_ramp(layers, DELTA_BETA, DELTA_GAMMA))
    return 0.5 - state.mean() * float(weights.max()) / (2 * float(weights.sum()))


def measure(
    backend: Backend, settings: DeviceTestSettings, tell: Callable[[Cell], None]
) -> list[Cell]:
    """All cells, widths and depths ascending.

    A width's deeper circuits are not asked for after one that is not above random, which spares a
    device's budget; nothing is asked for after a fault that is more than one job's.

    Args:
        tell: called with each cell as it comes.

    Raises:
        InputError: the device has too few usable qubits.
    """
    found: list[Cell] = []
    for width in sorted(set(settings.widths)):
        weights = chain_weights(width, settings.seed)
        for depth in sorted(set(settings.layers)):
            schedule = linear_ramp(depth, DELTA_BETA, DELTA_GAMMA)
            circuit = chain_circuit(scheduled(max_cut(weights), schedule))
            ideal = ideal_quality(weights, depth)
            try:
                sampled = backend.sample(circuit, settings.shots, settings.seed)
            except ServiceFault as fault:
                found.append(Cell(width, depth, ideal=ideal, fault=str(fault)))
                tell(found[-1])
                if fault.kind not in _PASSING:
                    return found
                continue
            r, error, counted = quality(sampled.counts, weights)
            found.append(
                Cell(
                    width,
                    depth,
                    counted,
                    r,
                    error,
                    random_limit(weights, counted),
                    ideal,
                    sampled.two_qubit_depth,
                    sampled.two_qubit_gates,
                    sampled.sample_s,
                    sampled.job,
                )
            )
            tell(found[-1])
            if not found[-1].above:
                break
    return found


def verdicts(cells: Sequence[Cell]) -> list[DeviceVerdict]:
    """One for each width, ascending."""
    found = []
    for width in sorted({cell.width for cell in cells}):
        own = sorted((c for c in cells if c.width == width), key=lambda c: c.layers)
        measured = [c for c in own if c.r is not None]
        passed: list[int] = []
        for cell in own:
            if not cell.above:
                break
            passed.append(cell.layers)
        best = max(measured, key=lambda c: c.r or 0.0, default=None)
        failed = any(not c.above for c in measured)
        to = passed[-1] if passed else None
        found.append(DeviceVerdict(width, to, None if best is None else best.layers, failed))
    return found


def conclusion(of: Sequence[DeviceVerdict], backend: str) -> str:
    """The verdict in one line: the widest chain that is above random, and how deep."""
    good = [v for v in of if v.above_to is not None]
    if all(v.best is None for v in of):
        return f"{backend}: no verdict, as no circuit was measured"
    if not good:
        return f"{backend}: not worth asking, no circuit is above random sampling at 3 sigma"
    widest = max(good, key=lambda v: v.width)
    most = "" if widest.failed else " (no deeper one was seen to fail)"
    return (
        f"{backend}: worth asking up to n = {widest.width}, p = {widest.above_to}{most}; "
        f"the cut is best at p = {widest.best}"
    )


def as_markdown(cells: Sequence[Cell], backend: str, kind: str) -> str:
    """The table by width and depth, and the verdict."""
    lines = [
        f"Linear-ramp test of {backend} ({kind}): weighted MaxCut on a chain, "
        f"Δβ = {DELTA_BETA:g}, Δγ = {DELTA_GAMMA:g}",
        "",
        "| n | p | two-qubit depth | gates | shots | r | random + 3 sigma | above "
        "| r without noise | signal left | s |",
        "|--:|--:|--:|--:|--:|--:|--:|---|--:|--:|--:|",
    ]
    for c in cells:
        if c.r is None or c.error is None or c.limit is None:
            lines.append(f"| {c.width} | {c.layers} | | | | {c.fault} | | | | | |")
            continue
        ideal = "" if c.ideal is None else f"{c.ideal:.3f}"
        signal = "" if c.signal is None else f"{100 * c.signal:.0f} %"
        lines.append(
            f"| {c.width} | {c.layers} | {c.two_qubit_depth} | {c.two_qubit_gates} | {c.shots} | "
            f"{c.r:.3f} ± {c.error:.3f} | {c.limit:.3f} | {'yes' if c.above else 'no'} | {ideal} | "
            f"{signal} | {c.sample_s:.1f} |"
        )
    return "\n".join([*lines, "", conclusion(verdicts(cells), backend)])


def as_json(cells: Sequence[Cell], backend: str, kind: str, seed: int) -> dict[str, Any]:
    """The same as plain data."""
    of = verdicts(cells)
    return {
        "backend": backend,
        "kind": kind,
        "seed": seed,
        "delta_beta": DELTA_BETA,
        "delta_gamma": DELTA_GAMMA,
        "cells": [vars(c) | {"above": c.above, "signal": c.signal} for c in cells],
        "verdicts": [vars(v) for v in of],
        "verdict": conclusion(of, backend),
    }
