"""An RSU's camera in a subprocess: vehicles in, pictures over HTTP."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream.service import die_with_parent
from slipstream_lab.simulation.live.world_spec import CameraEndpoint
from slipstream_lab.simulation.rsus import RsuSettings
from slipstream_lab.simulation.sumo_view import LaneRoads, Pose, SumoClipSettings, ViewedVehicle

JPEG_QUALITY: Final = 85
_HELD: Final = 0.6
"""Share of the time between two pictures after which each is served: however long it was painted,
so that the times of arrival, which are all that a receiver has, are as even as the simulation."""


@dataclass(frozen=True)
class CameraSpec:
    """A camera to be. `clip`: seed and pictures a second; its files are named in complaints."""

    site: RsuSettings
    pose: Pose
    roads: LaneRoads
    clip: SumoClipSettings
    calibration: Path
    parent: int


class SimulatedCamera:
    """The camera as the simulation has it: `show` never waits."""

    def __init__(self, spec: CameraSpec) -> None:
        self._name = spec.site.name
        self.frames = 0
        self.skipped = 0
        self._busy = False
        context = get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, spec), daemon=True)
        self._process.start()
        other.close()

    def place(self) -> CameraEndpoint:
        """Wait until it serves.

        Raises:
            InputError: the stretch cannot be watched.
            ChildProcessError: the process died.
        """
        place = self._receive()
        assert isinstance(place, CameraEndpoint)
        return place

    def show(self, vehicles: list[ViewedVehicle], due_s: float) -> None:
        """Have a picture painted, unless the one before is not done. Raises ChildProcessError: the
        process died.
        """
        if self._busy and self._connection.poll():
            self._receive()
            self._busy = False
            self.frames += 1
        if self._busy:
            if not self._process.is_alive():
                raise ChildProcessError(f"camera {self._name} ended")
            self.skipped += 1
            return
        try:
            self._connection.send((vehicles, due_s))
        except OSError:
            raise ChildProcessError(f"camera {self._name} ended") from None
        self._busy = True

    def close(self) -> None:
        """Switch it off."""
        self._connection.close()  # which it takes as the end
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self._process.close()

    def _receive(self) -> object:
        try:
            received = self._connection.recv()
        except (EOFError, OSError):
            raise ChildProcessError(f"camera {self._name} ended") from None
        if isinstance(received, InputError):
            raise received
        return received


def _serve(connection: Connection, spec: CameraSpec) -> None:
    """Run in the other process: paint what comes until nothing does."""
    die_with_parent(spec.parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import cv2

    from slipstream_lab.simulation.live.stream import LatestPicture, MjpegServer
    from slipstream_lab.simulation.sumo_view import SumoRenderer

    cv2.setNumThreads(1)
    try:
        renderer = SumoRenderer(spec.clip, spec.site, spec.pose, spec.roads)
    except InputError as error:
        connection.send(error)
        return
    spec.calibration.write_text(renderer.camera_toml)
    latest = LatestPicture()
    server = MjpegServer(latest)
    segments = tuple(stretch.segment_id for stretch in renderer.stretches)
    connection.send(CameraEndpoint(spec.site.name, segments, server.url, spec.calibration))
    held_s = _HELD / spec.clip.fps
    due_s = 0.0

    def scenes() -> Iterator[list[ViewedVehicle]]:
        nonlocal due_s
        while True:
            try:
                vehicles, due_s = connection.recv()
            except (EOFError, OSError):
                return
            yield vehicles

    for image, _ in renderer.paint(scenes()):
        _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        connection.send(None)
        time.sleep(max(0.0, due_s + held_s - time.monotonic()))
        latest.put(jpeg.tobytes(), time.time() - (time.monotonic() - due_s))
    server.close()
