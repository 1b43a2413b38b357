"""Vehicles in a recording: the detector's boxes, and the speeds that a calibration gives them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from edge_daemon.calibration.recording import Recording
from edge_daemon.camera import Array, Camera
from edge_daemon.detection import VEHICLE_CLASSES, Detections, box_feet, open_detector
from edge_daemon.settings import DetectorSettings
from edge_daemon.tracking import Sightings, Tracker, to_road_points

_MIN_SIGHTINGS: Final = 10
_MINM: Final = 8.0


@dataclass(frozen=True)
class SeenVehicle:
    """One vehicle of a recording: class, mean speed along the road, how far it was followed, and
    where its foot was seen, shape (n, 2).
    """

    kind: str
    speed_kmh: float
    metres: float
    path_px: Array


def detect(recording: Recording, model: str, progress: Callable[[float], None]) -> list[Detections]:
    """Boxes in all frames of a recording; `progress` is told the share that is done."""
    detector = open_detector(DetectorSettings(model=model))
    found = []
    for i, (_, image) in enumerate(recording.frames()):
        found.append(detector.detect(image))
        progress((i + 1) / len(recording.times_s))
    return found


def follow(
    recording: Recording,
    detections: list[Detections],
    camera: Camera,
    stations_m: tuple[float, float],
) -> list[SeenVehicle]:
    """Track the boxes of each frame on the road: each vehicle's mean speed, weighted by certainty,
    from the lowest to the highest station at which the calibration holds.
    """
    tracker = Tracker()
    parts = [
        tracker.update(time_s, to_road_points(boxes, camera))
        for time_s, boxes in zip(recording.times_s, detections, strict=True)
    ]
    parts = [part for part in parts if len(part)]
    if not parts:
        return []
    seen = Sightings.join(parts)
    station = seen.point_m[:, 0]
    seen = seen.take((station >= stations_m[0]) & (station <= stations_m[1]))
    vehicles = []
    for track in np.unique(seen.track):
        of_one = seen.take(seen.track == track)
        moved = float(np.hypot(*np.ptp(of_one.point_m, axis=0)))
        if len(of_one) < _MIN_SIGHTINGS or moved < _MINM:
            continue
        certainty = 1 / np.sqrt(np.trace(of_one.covariance_m2, axis1=1, axis2=2))
        velocity = np.polyfit(of_one.time_s - of_one.time_s[0], of_one.point_m, 1, w=certainty)[0]
        kind = VEHICLE_CLASSES[int(of_one.vehicle_class[-1])]
        vehicles.append(
            SeenVehicle(kind, 3.6 * float(np.hypot(*velocity)), moved, box_feet(of_one.box))
        )
    return vehicles
