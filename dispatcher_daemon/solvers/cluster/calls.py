"""Both ends of a call: how it is written, and how a worker runs it in a process of its own."""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import TimeoutError
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final, Literal

from dispatcher_daemon.solvers.workers.pool import error_line
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor
from slipstream.sources import sources_digest

MIN_SHARED_BYTES: Final = 16_384
"""Arrays of at least this size are sent once and named by their content in calls."""

_PACKAGES: Final = ("slipstream", "dispatcher_daemon")
_LIBRARIES: Final = (
    *("dask", "distributed", "dimod", "dwave-samplers", "highspy", "networkx", "numpy"),
    *("pebble", "pyvrp", "qiskit", "qiskit-aer", "scipy"),
)
"""Answers depend on their versions."""


@cache
def build() -> str:
    """What must be the same on both sides: versions, and a digest of the sources."""
    libraries = " ".join(f"{name}=={_version(name)}" for name in _LIBRARIES)
    return (
        f"slipstream {_version('slipstream')} of sources {sources_digest(_PACKAGES)[:12]}, "
        f"Python {sys.version_info.major}.{sys.version_info.minor}, "
        f"libraries {sha256(libraries.encode()).hexdigest()[:12]}"
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


@dataclass(frozen=True)
class ClusterCall:
    """What a worker is asked for.

    Attributes:
        timeout_s: its process is killed then.
        within_s: how long the answer is awaited.
        workers: addresses of those that may do it; none: all that are ready.
    """

    function: Callable[..., Any]
    args: Sequence[Any]
    timeout_s: float
    within_s: float
    workers: tuple[str, ...] = ()


def write_call(function: Callable[..., Any], args: Sequence[Any]) -> tuple[bytes, list[bytes]]:
    """Pickle a call of an importable function: the pickle of protocol 5, and its arrays apart."""
    buffers: list[pickle.PickleBuffer] = []
    text = pickle.dumps((function, tuple(args)), protocol=5, buffer_callback=buffers.append)
    return text, [buffer.raw().tobytes() for buffer in buffers]


def name_of(array: bytes) -> str:
    """Name of an array on the cluster, by its content."""
    return f"slipstream-{sha256(array).hexdigest()}"


class ClusterLost(Exception):
    """A call has no answer from the cluster: worker or scheduler lost, or silent for too long."""


class CallFailed(Exception):
    """The called function raised; the text is its error's class and message."""


@dataclass(frozen=True)
class CallAnswer:
    """What became of a call.

    Attributes:
        kind: "value"; "raised" by the function; "late": its process was killed at its limit;
            "refused": the worker is of another build.
        value: the function's, of kind "value".
        reason: of the other kinds.
    """

    kind: Literal["value", "raised", "late", "refused"]
    value: Any = None
    reason: str = ""

    def result(self) -> Any:
        """The value.

        Raises:
            CallFailed, TimeoutError, ClusterLost: of the kinds "raised", "late", "refused".
        """
        if self.kind == "value":
            return self.value
        if self.kind == "late":
            raise TimeoutError(self.reason)
        if self.kind == "refused":
            raise ClusterLost(f"a worker is {self.reason}")
        raise CallFailed(self.reason)


_executors: Final[list[WorkerExecutor]] = []


def use_processes(executor: WorkerExecutor) -> None:
    """Have calls that arrive in this process run in these processes."""
    _executors[:] = [executor]


def run_call(expected: str, text: bytes, arrays: Sequence[bytes], timeout_s: float) -> CallAnswer:
    """Run a call in one of the worker's processes; a thread of the worker waits for it.

    Nothing is unpickled where the build is not the expected one.

    Args:
        expected: build of the sender.
        timeout_s: the process is killed then, as threads cannot be.
    """
    if expected != build():
        return CallAnswer("refused", reason=build())
    if not _executors:
        return CallAnswer("refused", reason="not started by `slipstream worker`")
    try:
        future = _executors[0].submit_limited(timeout_s, _run, text, arrays)
        return CallAnswer("value", future.result())
    except TimeoutError:
        return CallAnswer("late", reason=f"no answer within {timeout_s:.3g} s")
    except Exception as error:
        return CallAnswer("raised", reason=error_line(error))


def _run(text: bytes, arrays: Sequence[bytes]) -> Any:
    # Arrays are copied: some libraries write into what they are given.
    function, args = pickle.loads(text, buffers=[bytearray(array) for array in arrays])
    return function(*args)


def warm_up(solvers: Sequence[Any], *functions: Callable[..., Any]) -> int:
    """Import what later calls need; the process id.

    Args:
        functions: unpickling them imports their modules.
    """
    for solver in solvers:
        try:
            solver.warm_up()
        except Exception:
            # It will give its reason in each call that asks for it.
            continue
    return os.getpid()
