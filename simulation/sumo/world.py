"""One running SUMO simulation: started, stepped, read around the RSU, and closed again.

SUMO lives in this process (libsumo), which holds one simulation at a time. It moves in steps of
20 ms whatever the frame rate is, so that the traffic of a seed does not depend on it.
"""

from __future__ import annotations

import gzip
import math
import os
import sys
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final
from xml.etree import ElementTree

import libsumo
import numpy as np
from libsumo import constants

from simulation.sumo.lines import distances
from simulation.sumo.shapes import Kind, is_known
from slipstream.errors import InputError

STEP_S: Final = 0.02
_PLACE: Final = "slipstream-rsu"
_VARIABLES: Final = (
    constants.VAR_POSITION,
    constants.VAR_ANGLE,
    constants.VAR_SPEED,
    constants.VAR_ACCELERATION,
    constants.VAR_LANE_ID,
)


@dataclass(frozen=True)
class State:
    """A vehicle at one step.

    Attributes:
        x_m: middle of the front bumper in the net, with y_m.
        heading_rad: anticlockwise from +x.
        speed_mps: over ground: SUMO's speed along its lane times the lane's drawn length over its
            driven one, which is 1 on straight lanes and differs by percents in curves.
        acceleration_mps2: over ground, in the step that ended here.
    """

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float


class World:
    """A simulation as a context manager: `with World(...) as world`.

    Raises:
        InputError: a file is missing, no SUMO net, or refused by SUMO.
        RuntimeError: a simulation already runs in this process.
    """

    def __init__(self, net: Path, routes: Path, additional: tuple[Path, ...], seed: int) -> None:
        self._files = (net, routes, *additional)
        for path, tags in ((net, ("net",)), *((p, ()) for p in self._files[1:])):
            _check_xml(path, tags)
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
        with _messages() as said:
            try:
                libsumo.start(self._command)
            except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
                _close()
                raise self._refusal("\n".join([*said(), str(error)])) from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        _close()

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return float(libsumo.simulation.getTime())

    def advance(self, until_s: float | None = None) -> None:
        """Move by one step, or by steps until a time.

        Raises:
            InputError: SUMO refuses a vehicle or a route.
        """
        with _messages() as said:
            try:
                libsumo.simulationStep(until_s or 0.0)
            except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
                raise self._refusal("\n".join([str(error), *said()])) from None

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

    def _refusal(self, text: str) -> InputError:
        """SUMO's complaint about one of the files, the routes unless it names another."""
        lines = [line.removeprefix("Error: ").strip() for line in text.splitlines()]
        told = [line for line in lines if line and line not in ("Process Error", _QUIT)]
        problem = " ".join(told[:2]).rstrip(".") or "SUMO gives no reason"
        source = next((path for path in self._files if str(path) in text), self._files[1])
        problem = problem.replace(f"'{source}' ", "").replace(str(source), "the file")
        return InputError(source, f"SUMO refuses it: {problem}", "mend the file")


_QUIT: Final = "Quitting (on error)."


def _close() -> None:
    """Close the simulation if one is loaded; what SUMO says at its end is of no use."""
    if libsumo.isLoaded():
        with _messages():
            libsumo.close()


def _check_xml(path: Path, tags: tuple[str, ...]) -> None:
    """Look at the first element of a file: SUMO's own words for other files are no help.

    Raises:
        InputError: the file cannot be read, is no XML, or is no net where one is wanted.
    """
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            _, root = next(iter(ElementTree.iterparse(file, events=("start",))))
    except OSError as error:
        problem = error.strerror or str(error)
        raise InputError(path, f"not readable: {problem}", "check the path") from None
    except (ElementTree.ParseError, StopIteration, EOFError, zlib.error) as error:
        raise InputError(path, f"not XML: {error}", "give a SUMO file") from None
    if tags and root.tag not in tags:
        raise InputError(path, f"a <{root.tag}> is no SUMO net", "build one with netconvert")


@contextmanager
def _messages() -> Iterator[_Said]:
    """Keep what SUMO writes to the terminal: its reasons stand there, not in its exceptions."""
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


@dataclass(frozen=True)
class _Said:
    """Reads the lines that went into a file."""

    descriptor: int

    def __call__(self) -> list[str]:
        size = os.fstat(self.descriptor).st_size
        return os.pread(self.descriptor, size, 0).decode(errors="replace").splitlines()
