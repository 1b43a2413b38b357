"""Sightings of tracked vehicles, and a buffer of those of the last frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Sightings:
    """Detections of confirmed tracks, one a row: what kinematics is made from.

    Attributes:
        track: the track's id, shape (n,).
        time_s: media time.
        point_m: measured point on the road, m, shape (n, 2).
        covariance_m2: of the point, shape (n, 2, 2).
        away: unit vector along which the camera looks past the point, shape (n, 2).
        vehicle_class: index into VEHICLE_CLASSES, of the track so far.
        box: of the detection, px, shape (n, 4).
    """

    track: npt.NDArray[np.int64]
    time_s: Array
    point_m: Array
    covariance_m2: Array
    away: Array
    vehicle_class: npt.NDArray[np.int64]
    box: npt.NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.track)

    def take(self, rows: Indices | npt.NDArray[np.bool_] | slice) -> Sightings:
        """Some of the rows."""
        return Sightings(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @staticmethod
    def join(parts: Sequence[Sightings]) -> Sightings:
        """All rows of the parts; there must be one part at least."""
        return Sightings(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in Sightings.__dataclass_fields__
            )
        )


class SightingBuffer:
    """Sightings, frame by frame; what was joined once stays joined, so that `all` costs little."""

    def __init__(self) -> None:
        self._parts: deque[Sightings] = deque()
        self._frames: deque[tuple[float, int]] = deque()
        self._dropped = 0

    def add(self, sightings: Sightings) -> None:
        """Append a frame's sightings, the latest of them last."""
        if len(sightings):
            self._parts.append(sightings)
            self._frames.append((float(sightings.time_s[-1]), len(sightings)))

    def drop(self, before_s: float) -> None:
        """Drop the frames whose latest sighting is older than a media time."""
        while self._frames and self._frames[0][0] < before_s:
            self._dropped += self._frames.popleft()[1]
        while self._parts and len(self._parts[0]) <= self._dropped:
            self._dropped -= len(self._parts.popleft())

    def all(self) -> Sightings | None:
        """All sightings in the order of their frames; None if there are none."""
        if not self._parts:
            return None
        joined = Sightings.join(self._parts).take(slice(self._dropped, None))
        self._parts, self._dropped = deque([joined]), 0
        return joined
