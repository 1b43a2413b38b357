"""One running SUMO simulation: started, stepped, read around the RSU, and closed again.

SUMO lives in the calling process (libsumo), which holds one simulation at a time and writes nothing
to its terminal meanwhile.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final

import libsumo
import numpy as np
from libsumo import constants

from simulation.sumo.lines import distances
from simulation.sumo.shapes import Kind, is_known
from simulation.sumo.traffic import STEP_S, State
from slipstream.errors import InputError

_PLACE: Final = "slipstream-rsu"
_VARIABLES: Final = (
    constants.VAR_POSITION,
    constants.VAR_ANGLE,
    constants.VAR_SPEED,
    constants.VAR_ACCELERATION,
    constants.VAR_LANE_ID,
)


class World:
    """A simulation as a context manager: `with World(...) as world`.

    Raises:
        InputError: SUMO refuses a file.
        RuntimeError: a simulation already runs in this process.
    """

    def __init__(self, net: Path, routes: Path, additional: tuple[Path, ...], seed: int) -> None:
        self._files = (net, routes, *additional)
        self._command = [
            *("sumo", "--net-file", str(net), "--route-files", str(routes)),
            *(("--additional-files", ",".join(map(str, additional))) if additional else ()),
            *("--step-length", str(STEP_S), "--step-method.ballistic", "true"),
            # Without a duration vehicles jump sideways from lane to lane.
            *("--lanechange.duration", "2.5"),
            *("--seed", str(seed), "--xml-validation", "never"),
            *("--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true"),
        ]
        self._kinds: dict[str, Kind] = {}
        self._stretch: dict[str, float] = {}

    def __enter__(self) -> World:
        if libsumo.isLoaded():
            raise RuntimeError("a SUMO simulation already runs in this process")
        with ExitStack() as stack:
            self._said = stack.enter_context(_messages())
            stack.callback(_close)
            self._run(lambda: libsumo.start(self._command))
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
        """Move by one step, or by steps until a time.

        Raises:
            InputError: SUMO refuses a vehicle or a route.
        """
        self._run(lambda: libsumo.simulationStep(until_s or 0.0))

    def _run(self, command: Callable[[], object]) -> None:
        """Have SUMO do something that it may refuse, with or without an exception.

        Raises:
            InputError: it did.
        """
        reasons: list[str] = []
        try:
            command()
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            reasons = [str(error)]
        spoken = self._said.news()
        if reasons or any(line.startswith("Error") for line in spoken):
            raise self._refusal([*spoken, *reasons])

    def expect_vehicles(self) -> None:
        """Make sure that there is something to see.

        Raises:
            InputError: no vehicle drives, and none is due.
        """
        if libsumo.simulation.getMinExpectedNumber() == 0:
            raise InputError(
                self._files[1],
                f"no vehicle drives at {self.time_s:g} s or soon after",
                "give another begin, or a route file with vehicles",
            )

    def look(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Ask for the vehicles around a point of the net from now on."""
        libsumo.poi.add(_PLACE, x_m, y_m, (0, 0, 0, 0))
        libsumo.poi.subscribeContext(
            _PLACE, constants.CMD_GET_VEHICLE_VARIABLE, radius_m, list(_VARIABLES)
        )

    def vehicles(self) -> dict[str, State]:
        """The vehicles around the point, by SUMO's ids in a fixed order."""
        around = libsumo.poi.getContextSubscriptionResults(_PLACE)
        states = {}
        for name in sorted(around):
            values = around[name]
            x, y = values[constants.VAR_POSITION]
            if not math.isfinite(x) or abs(x) > 1e9:  # not on the road yet
                continue
            ratio = self._over_ground(values[constants.VAR_LANE_ID])
            states[name] = State(
                float(x),
                float(y),
                math.radians(90.0 - values[constants.VAR_ANGLE]),
                float(values[constants.VAR_SPEED]) * ratio,
                float(values[constants.VAR_ACCELERATION]) * ratio,
            )
        return states

    def kind(self, name: str) -> Kind:
        """What kind of vehicle it is; it must be on the road.

        Raises:
            InputError: a vehicle class that has no shape.
        """
        if name not in self._kinds:
            vclass = libsumo.vehicle.getVehicleClass(name)
            if not is_known(vclass):
                raise InputError(
                    self._files[1],
                    f"a vehicle of class {vclass!r} cannot be drawn",
                    "use passenger, delivery, truck, trailer, bus or motorcycle",
                    key=name,
                )
            self._kinds[name] = Kind(
                vclass,
                float(libsumo.vehicle.getLength(name)),
                float(libsumo.vehicle.getWidth(name)),
            )
        return self._kinds[name]

    def _over_ground(self, lane: str) -> float:
        if lane not in self._stretch:
            shape = np.array(libsumo.lane.getShape(lane)) if lane else np.zeros((0, 2))
            drawn = float(distances(shape)[-1]) if len(shape) > 1 else 0.0
            self._stretch[lane] = drawn / libsumo.lane.getLength(lane) if drawn > 1.0 else 1.0
        return self._stretch[lane]

    def _refusal(self, lines: list[str]) -> InputError:
        """SUMO's complaint about one of the files; about all but the net if it names none."""
        text = "\n".join(lines)
        parts = [line.removeprefix("Error: ").strip() for line in text.splitlines()]
        told = list(dict.fromkeys(p for p in parts if p and p not in ("Process Error", _QUIT)))
        problem = " ".join(told[:3]).rstrip(".") or "it gives no reason"
        named = next((path for path in self._files if str(path) in text), None)
        source = named or ", ".join(path.name for path in self._files[1:])
        if named is not None:
            problem = problem.replace(f"In file '{named}'", "").replace(f"'{named}' ", "")
        return InputError(source, f"SUMO refuses it: {problem}", "mend the file")


_QUIT: Final = "Quitting (on error)."


def _close() -> None:
    """Close the simulation if one is loaded."""
    if libsumo.isLoaded():
        libsumo.close()


@contextmanager
def _messages() -> Iterator[_Said]:
    """Keep what this process writes to the terminal: SUMO gives its reasons there alone."""
    sys.stdout.flush()
    sys.stderr.flush()
    saved = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        try:
            yield _Said(file.fileno())
        finally:
            os.dup2(saved[0], 1)
            os.dup2(saved[1], 2)
            os.close(saved[0])
            os.close(saved[1])


class _Said:
    """Reads what went into a file."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._read = 0

    def news(self) -> list[str]:
        """The lines since the last call."""
        new = os.fstat(self._descriptor).st_size - self._read
        text = os.pread(self._descriptor, new, self._read) if new else b""
        self._read += new
        return text.decode(errors="replace").splitlines()
