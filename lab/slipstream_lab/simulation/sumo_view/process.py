"""SUMO in a subprocess that sends roads and vehicles.

SUMO ends its process on some faulty files, so it must not run in this one. A process runs at most
one simulation, and SUMO computes while frames are painted here.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

from slipstream.errors import InputError
from slipstream_lab.simulation.sumo import check_files
from slipstream_lab.simulation.sumo_view.lanes import LaneRoads
from slipstream_lab.simulation.sumo_view.traffic import ViewedVehicle


@dataclass(frozen=True)
class ViewSpec:
    """What to simulate and what to hand over: frames around a point of the net."""

    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    seed: int
    x_m: float
    y_m: float
    radius_m: float
    start_s: float
    begin_s: float
    fps: float
    frames: int


class Simulation:
    """A simulation as a context manager: `with Simulation(order) as simulation`.

    Raises:
        InputError: a file is no SUMO file, SUMO refuses it or dies of it.
        ModuleNotFoundError: libsumo is not installed.
    """

    roads: LaneRoads

    def __init__(self, spec: ViewSpec) -> None:
        if find_spec("libsumo") is None:
            raise ModuleNotFoundError("No module named 'libsumo'", name="libsumo")
        check_files(spec.net, (*spec.routes, *spec.additional))
        self._spec = spec
        context = get_context("spawn")
        self._inbox, self._outbox = context.Pipe(duplex=False)
        self._process = context.Process(target=_serve, args=(self._outbox, spec), daemon=True)

    def __enter__(self) -> Simulation:
        self._process.start()
        self._outbox.close()
        try:
            roads = self._receive()
        except BaseException:
            self._stop()
            raise
        assert isinstance(roads, LaneRoads)
        self.roads = roads
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stop()

    def frames(self) -> Iterator[list[ViewedVehicle]]:
        """The vehicles of each frame. Raises InputError: SUMO refuses a vehicle or a route or dies
        of it, no vehicle drives, or a vehicle's class has no shape.
        """
        for _ in range(self._spec.frames):
            vehicles = self._receive()
            assert isinstance(vehicles, list)
            yield vehicles

    def _receive(self) -> object:
        try:
            received = self._inbox.recv()
        except EOFError:
            self._process.join()
            names = ", ".join(p.name for p in (self._spec.net, *self._spec.routes))
            raise InputError(
                names,
                f"SUMO crashes on them (exit status {self._process.exitcode})",
                "look for edges without connections, or run sumo on them",
            ) from None
        if isinstance(received, InputError):
            raise received
        return received

    def _stop(self) -> None:
        self._inbox.close()
        self._process.terminate()
        self._process.join()
        self._process.close()


def _serve(outbox: Connection, spec: ViewSpec) -> None:
    """Run in the other process: send the roads, then the vehicles of each frame, or the fault."""
    # An interrupt is the business of the process that asked.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from slipstream_lab.simulation.sumo_view.net import read_roads
    from slipstream_lab.simulation.sumo_view.world import SumoViewWorld, drive

    try:
        with SumoViewWorld(
            spec.net, spec.routes, spec.additional, spec.seed, spec.start_s
        ) as world:
            outbox.send(read_roads(spec.x_m, spec.y_m, spec.radius_m))
            world.subscribe_around(spec.x_m, spec.y_m, spec.radius_m)
            for vehicles in drive(world, spec.begin_s, spec.fps, spec.frames):
                outbox.send(vehicles)
    except InputError as error:
        outbox.send(error)
    except (BrokenPipeError, ConnectionResetError):
        return  # the parent has closed the connection
