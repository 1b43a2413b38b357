"""What the device's own worker process does: every call of the service, training, reading samples.

The service is opened in that process, once, again after its credentials were refused, and before
a job where what was chosen when it was opened is out of date.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from dispatcher_daemon.hardware.making import Maker, Unsuitable
from dispatcher_daemon.problem import Problem
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.quantum.backends.jobs import JobService, JobView, ServiceFault
from dispatcher_daemon.solvers.quantum.chain.layout import Placement
from slipstream.errors import InputError

T = TypeVar("T")


class Opener(Protocol):
    """Opens the service; picklable and hashable."""

    @property
    def stale_s(self) -> float:
        """So old, an opened service is opened again before a job."""
        ...

    def __call__(self) -> JobService:
        """May raise InputError, as for missing credentials, or `ServiceFault`."""
        ...


@runtime_checkable
class Compiler(Protocol):
    """A service that tells what it makes of a circuit."""

    def two_qubit(self, circuit: object) -> tuple[int, int]:
        """Layers of two-qubit gates of the circuit as it will run, and their number."""
        ...


@runtime_checkable
class Placer(Protocol):
    """A service that tells where a chain lies on its device."""

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> Placement:
        """See `Backend.place`."""
        ...


@dataclass(frozen=True)
class Prepared:
    """A circuit, ready to be submitted.

    Attributes:
        circuit: pickled, so that only the worker needs what can read it.
        backend: name of the device.
        estimate_s: device time that it will take at most, s.
        two_qubit_depth: of the compiled circuit; None if the service does not tell.
        two_qubit_gates: likewise.
        order, fingerprint, variant, layers, train_s: see `Made`.
    """

    circuit: bytes
    backend: str
    estimate_s: float
    two_qubit_depth: int | None
    two_qubit_gates: int | None
    order: tuple[int, ...]
    fingerprint: str
    variant: str
    layers: int
    train_s: float


_open: dict[Opener, tuple[JobService, float]] = {}
"""Opened services, and when by the monotonic clock."""


def warm_up(maker: Maker) -> None:
    """Import what the other calls need."""
    maker.warm_up()


def prepare(
    opener: Opener, maker: Maker, problem: Problem, deadline_s: float, seed: int, shots: int
) -> Prepared:
    """Train a circuit and ask what it will cost; may raise Unsuitable, as if it does not fit."""

    def ask(service: JobService) -> Prepared:
        place = service.place if isinstance(service, Placer) else None
        made = maker.make(problem, deadline_s, seed, place)
        depth, gates = None, None
        if isinstance(service, Compiler):
            depth, gates = service.two_qubit(made.circuit)
        return Prepared(
            pickle.dumps(made.circuit),
            service.name,
            float(service.estimate_s(made.circuit, shots)),
            depth,
            gates,
            tuple(int(variable) for variable in made.order),
            made.fingerprint,
            made.variant,
            made.layers,
            made.train_s,
        )

    return _with(opener, ask, fresh=True)


def submit(opener: Opener, circuit: bytes, shots: int, tag: str) -> str:
    """Submit; returns the job's id. May raise Unsuitable: then there is no job."""
    return _with(opener, lambda service: service.submit(pickle.loads(circuit), shots, [tag]))


def look(opener: Opener, job_id: str, samples: bool) -> JobView:
    """State of a job."""
    return _with(opener, lambda service: service.look(job_id, samples=samples))


def cancel(opener: Opener, job_id: str) -> None:
    """Cancel a job."""
    _with(opener, lambda service: service.cancel(job_id))


def find(opener: Opener, tag: str) -> list[str]:
    """Ids of the jobs with a tag."""
    return _with(opener, lambda service: list(service.find(tag)))


def read(
    maker: Maker, problem: Problem, order: Sequence[int], samples: Mapping[str, int], seed: int
) -> Outcome:
    """Score samples."""
    return maker.read(problem, order, samples, seed)


def _with(opener: Opener, do: Callable[[JobService], T], *, fresh: bool = False) -> T:
    now = time.monotonic()
    if opener not in _open or (fresh and now - _open[opener][1] > opener.stale_s):
        try:
            _open[opener] = opener(), now
        except InputError as error:
            raise ServiceFault("refused", str(error)) from None
    try:
        return do(_open[opener][0])
    except InputError as error:
        raise Unsuitable(str(error)) from None
    except ServiceFault as fault:
        if fault.kind == "refused":
            _open.pop(opener, None)
        raise
