"""From a problem to a circuit for a device, and from the device's samples to an answer."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from dispatcher_daemon.problem import ArcProblem, Problem
from dispatcher_daemon.solvers.lc_qaoa import Place
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault


class Unsuitable(Exception):
    """A problem that its solver makes no circuit for; nobody's fault."""


@dataclass(frozen=True)
class Made:
    """A circuit for a device.

    Attributes:
        circuit: measured, classical bit q being qubit q.
        order: qubit q carries variable ``order[q]``.
        fingerprint: of the circuit.
        variant: of the algorithm.
        layers: depth p.
        train_s: time for the angles, s.
    """

    circuit: Any
    order: tuple[int, ...]
    fingerprint: str
    variant: str
    layers: int
    train_s: float


class Maker(Protocol):
    """Makes circuits and reads samples of one solver; picklable and hashable."""

    @property
    def name(self) -> str:
        """The solver's name."""
        ...

    @property
    def dialect(self) -> str:
        """What decides, beside the problem, what its variables stand for."""
        ...

    def warm_up(self) -> None:
        """Import what it needs."""
        ...

    def make(
        self, problem: Problem, deadline_s: float, seed: int, place: Place | None = None
    ) -> Made:
        """Train without a device.

        Args:
            deadline_s: of the cycle; a circuit that is trained later serves later cycles.
            place: where a chain lies on the device; None: not known, so that nothing is cut.

        Raises:
            Unsuitable: there is no circuit for it.
        """
        ...

    def read(
        self, problem: Problem, order: Sequence[int], samples: Mapping[str, int], seed: int
    ) -> Outcome:
        """Score samples on a problem, which need not be the one that the circuit was made for."""
        ...


def fingerprint(*parts: object) -> str:
    """A short name for what has this representation."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def meaning(problem: Problem, dialect: str) -> str:
    """Fingerprint of what the variables of a problem stand for; costs and rewards may differ.

    Of a route option vehicle and stops are known, not its way or departure.
    """
    if isinstance(problem, ArcProblem):
        arcs = tuple((arc.vehicle, arc.start, arc.end) for arc in problem.arcs)
        return fingerprint("arc", dialect, problem.depot, problem.customers, problem.vehicles, arcs)
    options = tuple((option.vehicle, option.stops) for option in problem.options)
    return fingerprint("route", dialect, problem.vehicles, problem.stops, options)


def check_samples(samples: Mapping[str, int], width: int, shots: int) -> None:
    """See that samples are what was asked for.

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
