"""From a problem to a circuit for a device, and from the device's samples to an answer."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dispatcher_daemon.forms import ArcProblem, BinaryProblem, Problem, QuboModel
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.quantum.lc_qaoa import (
    LcQaoaSolver,
    Place,
    VariantError,
    counts_to_bits,
)
from dispatcher_daemon.solvers.sampling import SampledBits, solve_by_sampling


class Unsuitable(Exception):
    """There is no circuit for the problem; not a fault of the service."""


@dataclass(frozen=True)
class BuiltCircuit:
    """A circuit for a device.

    Attributes:
        circuit: measured, classical bit q being qubit q.
        order: qubit q carries variable ``order[q]``.
        train_s: time for the angles, s.
    """

    circuit: Any
    order: tuple[int, ...]
    fingerprint: str
    variant: str
    layers: int
    train_s: float


@dataclass(frozen=True)
class ChainCircuitBuilder:
    """Builds LC-QAOA's circuits and decodes their samples; picklable and hashable.

    Attributes:
        solver: trains the circuits as for the simulator.
    """

    solver: LcQaoaSolver

    @property
    def name(self) -> str:
        """The solver's name."""
        return self.solver.name

    @property
    def encoding(self) -> str:
        """The solver's encoding."""
        return self.solver.encoding

    def warm_up(self) -> None:
        """Import what training, building and scoring need."""
        zero = np.zeros((1, 2))
        self.circuit(ChainAnsatz(zero, np.ones((1, 1)), zero))
        import dwave.samplers  # noqa: F401
        import scipy.optimize  # noqa: F401

    def circuit(self, ansatz: Any) -> Any:
        """The measured circuit of an ansatz."""
        return circuit_of(ansatz)

    def build(
        self, problem: Problem, deadline_s: float, seed: int, place: Place | None = None
    ) -> BuiltCircuit:
        """Train a circuit without a device.

        Args:
            deadline_s: of the cycle, s; a circuit that is trained later serves later cycles.
            place: where a chain lies on the device; None: not known, so the chain is not cut.

        Raises:
            Unsuitable: there is no circuit for the problem.
        """
        if not problem.choices:
            raise Unsuitable("the problem has nothing to choose")
        try:
            prepared = self.solver.prepare(problem, deadline_s, seed, place)
        except VariantError as error:
            raise Unsuitable(str(error)) from None
        tables = [np.asarray(table).tolist() for table in vars(prepared.ansatz).values()]
        return BuiltCircuit(
            self.circuit(prepared.ansatz),
            prepared.order,
            fingerprint(prepared.order, *tables),
            prepared.variant,
            self.solver.settings.layers,
            prepared.train_s,
        )

    def decode(
        self, problem: Problem, order: Sequence[int], samples: Mapping[str, int], seed: int
    ) -> Outcome:
        """Score samples on a problem, which need not be the one that the circuit was built for.

        There is no answer if the number of variables differs.
        """
        began = time.perf_counter()

        def draw(model: QuboModel) -> SampledBits:
            if len(order) != len(model.variables):
                raise Unsuitable("the problem has another number of variables by now")
            bits, shots = counts_to_bits(samples, tuple(order))
            return SampledBits(bits, shots, len(order))

        try:
            gamma, encoding = self.solver.gamma, self.solver.encoding
            return solve_by_sampling(self.name, problem, gamma, encoding, seed, draw)
        except Unsuitable as error:
            wall_s = time.perf_counter() - began
            return Outcome(self.name, "failed", None, wall_s, reason=str(error))


def fingerprint(*parts: object) -> str:
    """First 16 hexadecimal digits of the SHA-256 of the parts' representation."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def problem_key(problem: Problem, encoding: str) -> str:
    """Cache key of a problem: fingerprint of its variables, without costs and rewards.

    Of a route option the vehicle and the stops count, not the roads or the departure.
    """
    if isinstance(problem, ArcProblem):
        arcs = tuple((arc.vehicle, arc.start, arc.end) for arc in problem.arcs)
        parts = (problem.depot, problem.customers, problem.vehicles, arcs)
        return fingerprint("arc", encoding, *parts)
    if isinstance(problem, BinaryProblem):
        return fingerprint("binary", encoding, problem.names)
    options = tuple((option.vehicle, option.stops) for option in problem.options)
    return fingerprint("route", encoding, problem.vehicles, problem.stops, options)


def check_samples(samples: Mapping[str, int], width: int, shots: int) -> None:
    """Check that samples are what was asked for.

    Raises:
        ServiceFault: of kind "garbage": no bit strings of that width, fewer than asked for, or more
            than twice as many (twirling rounds their number up to whole random frames).
    """
    try:
        total = 0
        for string, number in samples.items():
            if not isinstance(string, str) or len(string) != width or not {*string} <= {"0", "1"}:
                shown = repr(string)[:40]
                raise ServiceFault("garbage", f"{shown} is no bit string of {width} qubits")
            if isinstance(number, bool) or not isinstance(number, int) or number < 1:
                raise ServiceFault("garbage", f"{number!r} shots of one bit string")
            total += number
    except (AttributeError, TypeError, ValueError):
        raise ServiceFault("garbage", "its answer holds no samples") from None
    if not shots <= total <= 2 * shots:
        raise ServiceFault("garbage", f"{total} samples instead of {shots}")
