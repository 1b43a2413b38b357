"""Which rows the tables have, and how each is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from itertools import product
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from dispatcher_daemon.settings import LcQaoaSettings, LcQaoaVariant
from dispatcher_daemon.solvers import CplexSolver, ExactSolver
from dispatcher_daemon.solvers.quantum import LcQaoaSolver
from dispatcher_daemon.solvers.quantum.backends import NoisyBackend
from slipstream.config import Settings
from slipstream_lab.research.quantum import dense, paper
from slipstream_lab.research.quantum.angles import QaoaOptions, make_qaoa
from slipstream_lab.research.quantum.backends.idle import DECOUPLED, IDLE, TWIRLED
from slipstream_lab.research.quantum.backends.opening import open_or_fall_back
from slipstream_lab.research.quantum.case import QuantumCase
from slipstream_lab.research.quantum.paper import PaperRow
from slipstream_lab.research.quantum.store import Record
from slipstream_lab.research.quantum.summary import Mark

VARIANT_TITLES: Final[dict[LcQaoaVariant, str]] = {
    "trained": "the paper's method",
    "multi-angle": "an angle for each gate",
    "product": "the same without entangling gates",
}

MITIGATIONS: Final = {
    IDLE: "idle errors",
    IDLE + DECOUPLED: "the same, decoupled",
    IDLE + TWIRLED: "the same, twirled",
    IDLE + DECOUPLED + TWIRLED: "the same, both",
}
"""Endings of a fake device's name, and what they are called."""


class BenchSettings(Settings):
    """How much is measured, and where circuits run."""

    instances: int = Field(default=20, ge=1, le=20, description="The first so many of the set.")
    shots: int = Field(default=4096, ge=1, le=1_000_000)
    seed: int = Field(default=1, ge=0, lt=2**32)
    iterations: int = Field(default=100, ge=1, le=100_000, description="Of training.")
    trained: int = Field(
        default=1,
        ge=0,
        le=20,
        description="Instances on which dense QAOA is trained: minutes each.",
    )
    estimated: int = Field(
        default=2,
        ge=0,
        le=20,
        description="Instances on which dense QAOA on a device is estimated.",
    )
    layers: tuple[Annotated[int, Field(ge=1, le=10)], ...] = Field(
        default=(1, 2, 3, 4, 5), min_length=1, description="Of the sweep."
    )
    noise: str = Field(default="aer:FakeBoston", description="Back end with a noise model.")
    device: str | None = Field(default=None, description="An IBM device, for its rows.")
    deadline_s: float = Field(default=600.0, gt=0, description="For one solve.")


@dataclass(frozen=True)
class QuantumRow:
    """One row, in one or more tables.

    Attributes:
        key: stable name; a row that two tables have is measured once.
        title: for people.
        mark: how its figures come about.
        paper: the paper's figures.
        measure: solves one instance; None where it cannot be had.
        reason: why not, or what else there is to say.
        most: instances that it is measured on, from the first.
    """

    key: str
    title: str
    mark: Mark
    paper: PaperRow | None
    measure: Callable[[QuantumCase], Record] | None
    reason: str | None = None
    most: int = 20


def hardware_rows(settings: BenchSettings) -> list[QuantumRow]:
    """Rows of the paper's table of hardware benchmarks, and our variants beside them."""
    rows = [
        QuantumRow("exact", "exact (HiGHS)", "classical", paper.EXACT, _exact(settings)),
        _cplex(settings),
        _iskay(settings),
    ]
    rows += [qaoa(settings, p, "transferred") for p in (1, 2)]
    rows += [qaoa(settings, p, "trained", settings.trained) for p in (1, 2)]
    rows += [_dense_on_device(settings, p) for p in (1, 2)]
    if settings.device is not None:
        device = f"ibm:{settings.device}"
        rows += [lc_qaoa(settings, "trained", p, device) for p in (1, 2)]
    rows += [lc_qaoa(settings, "trained", p, settings.noise) for p in (1, 2)]
    rows += [lc_qaoa(settings, "multi-angle", p, settings.noise) for p in (1, 2)]
    return [*rows, lc_qaoa(settings, "product", 2, settings.noise)]


def sweep_rows(settings: BenchSettings) -> list[QuantumRow]:
    """Rows of the paper's p-sweep, with noise and without."""
    return [
        lc_qaoa(settings, "trained", p, backend)
        for backend in (settings.noise, "aer")
        for p in settings.layers
    ]


def mitigation_rows(settings: BenchSettings) -> list[QuantumRow]:
    """LC-QAOA with idle and coherent errors: dynamical decoupling and twirling, off and on."""
    variants: tuple[LcQaoaVariant, ...] = ("trained", "multi-angle")
    device = settings.noise.partition("+")[0]
    rows = []
    for variant, ending in product(variants, MITIGATIONS):
        row = lc_qaoa(settings, variant, 2, device + ending)
        row = replace(row, title=f"{row.title}, {MITIGATIONS[ending]}", paper=None)
        if device == "aer":
            row = replace(row, measure=None, reason="not run: no device is named (--noise)")
        rows.append(row)
    return rows


def lc_qaoa(settings: BenchSettings, variant: LcQaoaVariant, p: int, backend: str) -> QuantumRow:
    """A row of LC-QAOA."""
    options = LcQaoaSettings(
        variant=variant,
        layers=p,
        shots=settings.shots,
        iterations=settings.iterations,
    )
    solver = LcQaoaSolver(options, backend=partial(open_or_fall_back, backend))

    def measure(case: QuantumCase) -> Record:
        return case.measure(solver, settings.deadline_s, _seed(settings, case))

    return QuantumRow(
        key=f"lc-qaoa/{variant}/p{p}/{backend}",
        title=f"LC-QAOA, {VARIANT_TITLES.get(variant, variant)}, p = {p}",
        mark=mark_of(backend),
        paper=paper.LC_QAOA_DEVICE.get(p) if variant == "trained" else None,
        measure=measure,
    )


def qaoa(
    settings: BenchSettings, p: int, angles: Literal["transferred", "trained"], most: int = 20
) -> QuantumRow:
    """A row of dense QAOA, simulated exactly and sampled.

    Args:
        most: instances that it is measured on.
    """
    iterations = settings.iterations if angles == "trained" else None
    solver = make_qaoa(QaoaOptions(layers=p, shots=settings.shots, iterations=iterations))

    def measure(case: QuantumCase) -> Record:
        # An evaluation takes a second, a hundred of them minutes.
        return case.measure(solver, 10 * settings.deadline_s, _seed(settings, case))

    titles = {"transferred": "ramp of fixed heights", "trained": "the paper's training"}
    return QuantumRow(
        key=f"qaoa/{angles}/p{p}",
        title=f"QAOA, {titles[angles]}, p = {p}",
        mark="simulated",
        paper=paper.QAOA_SIMULATED[p],
        measure=measure if most else None,
        reason=None if most else "not measured: it takes minutes an instance (--trained N)",
        most=most,
    )


def _dense_on_device(settings: BenchSettings, p: int) -> QuantumRow:
    device = settings.noise.partition(":")[2].partition("+")[0]

    def measure(case: QuantumCase) -> Record:
        return dense.estimate(case, p, NoisyBackend(device))

    return QuantumRow(
        key=f"qaoa/estimated/p{p}/{settings.noise}",
        title=f"QAOA on the device, p = {p}",
        mark="estimated",
        paper=paper.QAOA_DEVICE[p],
        measure=measure if device and settings.estimated else None,
        reason=dense.ESTIMATE if device else "not estimated: no device is named (--noise)",
        most=settings.estimated,
    )


def _seed(settings: BenchSettings, case: QuantumCase) -> int:
    """A seed for each instance: they are so alike that one draw would be lucky for all or none."""
    return settings.seed + case.number


def mark_of(backend: str) -> Mark:
    """How a back end's figures come about."""
    if backend.startswith("ibm:"):
        return "hardware"
    return "simulated" if backend == "aer" else "noise-model"


def _exact(settings: BenchSettings) -> Callable[[QuantumCase], Record]:
    return lambda case: case.measure(ExactSolver(), settings.deadline_s, settings.seed)


def _cplex(settings: BenchSettings) -> QuantumRow:
    there = find_spec("cplex") is not None

    def measure(case: QuantumCase) -> Record:
        return case.measure(CplexSolver(), settings.deadline_s, settings.seed)

    return QuantumRow(
        "cplex",
        "CPLEX",
        "classical",
        paper.EXACT,
        measure if there else None,
        None if there else "not run: the extra cplex is not installed",
    )


def _iskay(settings: BenchSettings) -> QuantumRow:
    solver: Any = None
    reason: str | None = "not run: it needs a device (--device), an account and the extra iskay"
    if settings.device is not None:
        from dispatcher_daemon.solvers.quantum.backends import find_access
        from slipstream_lab.research.quantum.backends.iskay import IskaySolver

        solver, reason = IskaySolver(find_access(), settings.device), None
        solver.warm_up()

    def measure(case: QuantumCase) -> Record:
        return case.measure(solver, settings.deadline_s, settings.seed)

    return QuantumRow(
        "iskay",
        "Kipu Iskay",
        "hardware",
        paper.ISKAY,
        None if solver is None else measure,
        reason,
    )
