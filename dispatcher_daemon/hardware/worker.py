"""The device's worker process: calls under a time limit, killed and replaced when they hang."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, TimeoutError
from typing import Any, Final, TypeVar

import pebble

from dispatcher_daemon.hardware.making import Unsuitable
from dispatcher_daemon.solvers.pool import error_line
from dispatcher_daemon.solvers.processes import Processes
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault

T = TypeVar("T")

_START_S: Final = 60.0
"""Time for a process to start, which the limit of a call does not cover."""


class WorkerClosed(Exception):
    """The worker was stopped during a call, or before."""


class GuestWorker:
    """One process, started by its first call; one thread calls, any may close."""

    def __init__(self) -> None:
        self._keeper = ThreadPoolExecutor(1, thread_name_prefix="guest-worker")
        self._processes = Processes(1, self._keeper, "the device's worker")
        self._lock = threading.Lock()
        self._closed = False

    def call(self, function: Callable[..., T], args: Sequence[Any], limit_s: float) -> T:
        """Run a picklable call and wait for it.

        Raises:
            ServiceFault: its own; or "unreachable" if it took longer than its limit, "broken" if
                the process died or it raised something else.
            Unsuitable, WorkerClosed: see there.
        """
        with self._lock:
            if self._closed:
                raise WorkerClosed
            future = self._processes.schedule(function, args, timeout_s=limit_s)
        try:
            result: T = future.result(timeout=limit_s + _START_S)
            return result
        except TimeoutError:
            if not future.done():
                # The pool itself is stuck; the next call gets another.
                with self._lock:
                    self._processes.stop()
            raise ServiceFault("unreachable", f"no answer within {limit_s:g} s") from None
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
