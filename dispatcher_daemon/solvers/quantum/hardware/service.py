"""The device's service: the calls that run in its worker process, and that process.

All that is slow or may hang runs there: every call of the service, training, decoding samples. A
call that exceeds its time limit is ended with its process, which is replaced. The process opens the
service once; again after its credentials were refused, and before a job once it is too old.
"""

from __future__ import annotations

import math
import pickle
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, TimeoutError
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

import pebble

from dispatcher_daemon.forms import Problem
from dispatcher_daemon.solvers.quantum.backends.ibm import CALIBRATION_S, LEAST_BUSY
from dispatcher_daemon.solvers.quantum.backends.jobs import JobService, JobView, ServiceFault
from dispatcher_daemon.solvers.quantum.backends.opening import open_service
from dispatcher_daemon.solvers.quantum.hardware.circuits import (
    BuiltCircuit,
    ChainCircuitBuilder,
    Unsuitable,
)
from dispatcher_daemon.solvers.workers.pool import error_line
from dispatcher_daemon.solvers.workers.processes import Processes
from slipstream.errors import InputError

T = TypeVar("T")

_START_S: Final = 60.0
"""Time for a process to start, which a call's time limit does not cover, s."""


@dataclass(frozen=True)
class ServiceFactory:
    """Opens the service of a device, in any process.

    Attributes:
        backend: as in `HardwareSettings.backend`.
    """

    backend: str

    @property
    def max_age_s(self) -> float:
        """The least busy device is chosen anew after this time, s; a named device never."""
        return CALIBRATION_S if self.backend == f"ibm:{LEAST_BUSY}" else math.inf

    def __call__(self) -> JobService:
        """May raise InputError, as for missing credentials, or `ServiceFault`."""
        return open_service(self.backend)


@dataclass(frozen=True)
class PreparedCircuit:
    """A circuit, ready to be submitted.

    Attributes:
        built: its circuit is pickled, so that only the worker needs what can read it.
        backend: name of the device.
        estimate_s: upper estimate of the device time, s.
        two_qubit_depth, two_qubit_gates: of the compiled circuit.
    """

    built: BuiltCircuit
    backend: str
    estimate_s: float
    two_qubit_depth: int
    two_qubit_gates: int


_open: dict[ServiceFactory, tuple[JobService, float]] = {}
"""Opened services, and when by the monotonic clock."""


def prepare(
    factory: ServiceFactory,
    builder: ChainCircuitBuilder,
    problem: Problem,
    deadline_s: float,
    seed: int,
    shots: int,
) -> PreparedCircuit:
    """Train a circuit and estimate its device time; may raise Unsuitable, as if it does not fit."""

    def do(service: JobService) -> PreparedCircuit:
        built = builder.build(problem, deadline_s, seed, service.place)
        depth, gates = service.two_qubit(built.circuit)
        order = tuple(int(variable) for variable in built.order)
        pickled = replace(built, circuit=pickle.dumps(built.circuit), order=order)
        estimate_s = float(service.estimate_s(built.circuit, shots))
        return PreparedCircuit(pickled, service.name, estimate_s, depth, gates)

    return _with_service(factory, do, fresh=True)


def submit(factory: ServiceFactory, circuit: bytes, shots: int, tag: str) -> str:
    """Submit; returns the job's id. May raise Unsuitable: then there is no job."""
    return _with_service(
        factory, lambda service: service.submit(pickle.loads(circuit), shots, [tag])
    )


def look(factory: ServiceFactory, job_id: str, samples: bool) -> JobView:
    """State of a job."""
    return _with_service(factory, lambda service: service.look(job_id, samples=samples))


def cancel(factory: ServiceFactory, job_id: str) -> None:
    """Cancel a job."""
    _with_service(factory, lambda service: service.cancel(job_id))


def find(factory: ServiceFactory, tag: str) -> list[str]:
    """Ids of the jobs with a tag."""
    return _with_service(factory, lambda service: list(service.find(tag)))


def _with_service(
    factory: ServiceFactory, do: Callable[[JobService], T], *, fresh: bool = False
) -> T:
    now = time.monotonic()
    if factory not in _open or (fresh and now - _open[factory][1] > factory.max_age_s):
        try:
            _open[factory] = factory(), now
        except InputError as error:
            raise ServiceFault("refused", str(error)) from None
    try:
        return do(_open[factory][0])
    except InputError as error:
        raise Unsuitable(str(error)) from None
    except ServiceFault as fault:
        if fault.kind == "refused":
            _open.pop(factory, None)
        raise


class WorkerClosed(Exception):
    """The worker was closed before a call or during it."""


class ServiceWorker:
    """One process, started by its first call; one thread calls, any may close."""

    def __init__(self) -> None:
        self._keeper = ThreadPoolExecutor(1, thread_name_prefix="service-worker")
        self._processes = Processes(1, self._keeper, "the device's worker", modules=(__name__,))
        self._lock = threading.Lock()
        self._closed = False

    def call(self, function: Callable[..., T], args: Sequence[Any], timeout_s: float) -> T:
        """Run a picklable call and wait for it.

        Raises:
            ServiceFault: its own; or "unreachable" if it took longer than its limit, "broken" if
                the process died or it raised something else.
            Unsuitable, WorkerClosed: see there.
        """
        with self._lock:
            if self._closed:
                raise WorkerClosed
            future = self._processes.schedule(function, args, timeout_s=timeout_s)
        try:
            result: T = future.result(timeout=timeout_s + _START_S)
            return result
        except TimeoutError:
            if not future.done():
                # The pool itself is stuck; the next call gets another.
                with self._lock:
                    self._processes.stop()
            raise ServiceFault("unreachable", f"no answer within {timeout_s:g} s") from None
        except CancelledError:
            raise WorkerClosed from None
        except (ServiceFault, Unsuitable):
            raise
        except pebble.ProcessExpired as error:
            if self._closed:
                raise WorkerClosed from None
            raise ServiceFault("broken", f"its worker process died ({error})") from None
        except Exception as error:
            raise ServiceFault("broken", error_line(error)) from None

    def close(self) -> None:
        """End the process, whatever it is doing."""
        with self._lock:
            self._closed = True
            self._processes.stop()
        self._keeper.shutdown()
