"""A simulation in a subprocess: SUMO ends its process on some faults, and runs once per process."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import TypeVar

from slipstream.errors import InputError

Progress = Callable[[float, float], None]
"""Called with the simulated time and the end, s."""

Spec = TypeVar("Spec")
Result = TypeVar("Result")


def run_in_subprocess(
    simulate: Callable[[Spec, Callable[[float], None]], Result],
    spec: Spec,
    source: str,
    end_s: float,
    progress: Progress | None = None,
) -> Result:
    """Simulate in a subprocess and return the result.

    Args:
        simulate: a module's function of the specification and a callback for the simulated time.

    Raises:
        InputError: what `simulate` raises, or SUMO died.
        RuntimeError: `simulate` raised something else.
        ModuleNotFoundError: libsumo is not installed.
    """
    if find_spec("libsumo") is None:
        raise ModuleNotFoundError("No module named 'libsumo'", name="libsumo")
    context = get_context("spawn")
    inbox, outbox = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(outbox, simulate, spec), daemon=True)
    process.start()
    outbox.close()
    try:
        while True:
            kind, received = inbox.recv()
            if kind == "fault":
                raise received
            if kind == "result":
                result: Result = received
                return result
            if progress is not None:
                progress(received, end_s)
    except EOFError:
        process.join()
        raise InputError(
            source,
            f"SUMO crashes on them (exit status {process.exitcode})",
            "look for edges without connections, or run sumo on them",
        ) from None
    finally:
        inbox.close()
        process.terminate()
        process.join()
        process.close()


def _serve(
    outbox: Connection, simulate: Callable[[Spec, Callable[[float], None]], object], spec: Spec
) -> None:
    """Run in the other process: send times as they pass, then the result, or the fault."""
    # An interrupt is the business of the process that asked.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        outbox.send(("result", simulate(spec, lambda time_s: outbox.send(("time", time_s)))))
    except InputError as error:
        outbox.send(("fault", error))
    except (BrokenPipeError, ConnectionResetError):
        return  # the parent has closed the connection
    except Exception:
        outbox.send(("fault", RuntimeError(f"the simulation failed:\n{traceback.format_exc()}")))
