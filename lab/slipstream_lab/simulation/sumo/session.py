"""SUMO inside the calling process (libsumo): started, stepped, closed, and heard when it refuses.

libsumo holds one simulation a process at most. SUMO gives its reasons on the terminal alone, so the
process writes nothing there meanwhile.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final

import libsumo

from slipstream.errors import InputError

_QUIT: Final = "Quitting (on error)."


class SumoSession:
    """A running simulation as a context manager: `with Session(options, files) as session`.

    Args:
        files: that they name, the net first; errors name one of them.

    Raises:
        InputError: SUMO refuses a file.
        RuntimeError: a simulation already runs in this process.
    """

    def __init__(self, options: Sequence[str], files: Sequence[Path]) -> None:
        self._command = ["sumo", *options]
        self._files = tuple(files)

    def __enter__(self) -> SumoSession:
        if libsumo.isLoaded():
            raise RuntimeError("a SUMO simulation already runs in this process")
        with ExitStack() as stack:
            self._said = stack.enter_context(_messages())
            stack.callback(_close)
            self.run(lambda: libsumo.start(self._command))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stack.close()

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return float(libsumo.simulation.getTime())

    def advance(self, until_s: float | None = None) -> None:
        """Move by one step, or by steps until a time. Raises InputError: SUMO refuses a vehicle or
        a route.
        """
        self.run(lambda: libsumo.simulationStep(until_s or 0.0))

    def run(self, command: Callable[[], object]) -> None:
        """Have SUMO do something that it may refuse, with or without an exception. Raises
        InputError: it did.
        """
        reasons: list[str] = []
        try:
            command()
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            reasons = [str(error)]
        spoken = self._said.new_lines()
        if reasons or any(line.startswith("Error") for line in spoken):
            raise self._refusal([*spoken, *reasons])

    def _refusal(self, lines: list[str]) -> InputError:
        """SUMO's complaint about one of the files; about all but the net if it names none."""
        text = "\n".join(lines)
        parts = [line.removeprefix("Error: ").strip() for line in text.splitlines()]
        complaints = list(
            dict.fromkeys(p for p in parts if p and p not in ("Process Error", _QUIT))
        )
        problem = " ".join(complaints[:3]).rstrip(".") or "it gives no reason"
        named = next((path for path in self._files if str(path) in text), None)
        source = named or ", ".join(path.name for path in self._files[1:])
        if named is not None:
            problem = problem.replace(f"In file '{named}'", "").replace(f"'{named}' ", "")
        return InputError(source, f"SUMO refuses it: {problem}", "mend the file")


def _close() -> None:
    """Close the simulation if one is loaded."""
    if libsumo.isLoaded():
        libsumo.close()


@contextmanager
def _messages() -> Iterator[_CapturedOutput]:
    """Keep what this process writes to the terminal."""
    sys.stdout.flush()
    sys.stderr.flush()
    saved = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        try:
            yield _CapturedOutput(file.fileno())
        finally:
            os.dup2(saved[0], 1)
            os.dup2(saved[1], 2)
            os.close(saved[0])
            os.close(saved[1])


class _CapturedOutput:
    """Reads what went into a file."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._read = 0

    def new_lines(self) -> list[str]:
        """The lines since the last call."""
        new = os.fstat(self._descriptor).st_size - self._read
        text = os.pread(self._descriptor, new, self._read) if new else b""
        self._read += new
        return text.decode(errors="replace").splitlines()
