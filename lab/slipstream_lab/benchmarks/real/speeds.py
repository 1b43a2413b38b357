"""Speeds between gates from a tracker's positions, by our measurement model and smoother."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array
from edge_daemon.detection import Detections
from edge_daemon.features import SegmentKinematics, VehicleMotion
from edge_daemon.features.kinematics import COMMON_SPEED_STD, OWN_SPEED_STD
from edge_daemon.features.trajectories import NOMINAL_LENGTH_M, NOMINAL_SIZE_M
from edge_daemon.tracking import Sightings
from edge_daemon.tracking.measurement import place_on_road
from slipstream_lab.benchmarks.real.brno import SIZE, GatedRecording, PixelTrack
from slipstream_lab.benchmarks.real.cameras import Surveyed

_WINDOW_S: Final = 10.0
_LEAD_S: Final = 3.0
_STEP_S: Final = 3.0
_BORDER_PX: Final = 10.0
_MIN_POSITIONS: Final = 6
_NEAREST: Final = 6
_BIN_M: Final = 1.0
_MIN_IN_BIN: Final = 30
_STALLED_SHARE: Final = 0.85
_KMH: Final = 3.6


@dataclass(frozen=True)
class VehicleSpeed:
    """One tracked vehicle between the gates. `error_kmh`: its standard error; the calibration's is
    part of it.
    """

    track: int
    lane: int
    end_s: float
    speed_kmh: float
    error_kmh: float


def counted(recording: GatedRecording) -> list[PixelTrack]:
    """Tracks that the set's rules count.

    More than five positions that are not at the picture's border, all in a lane, six between the
    gates, begun before the last passage.
    """
    last_s = max(passage.end_s for passage in recording.passages)
    kept = []
    for track in recording.tracks:
        inner = (track.image_px > _BORDER_PX) & (track.image_px < np.array(SIZE) - _BORDER_PX)
        inside = track.take(np.all(inner, axis=1))
        if (
            len(inside) >= _MIN_POSITIONS
            and inside.time_s[0] < last_s
            and (recording.lane_of(inside.image_px) >= 0).all()
            and _between_gates(recording, inside) >= _MIN_POSITIONS
        ):
            kept.append(inside)
    return kept


def measure(recording: GatedRecording, surveyed: Surveyed) -> list[VehicleSpeed]:
    """The speed of each track that our smoother can use."""
    tracks = {
        track.id: track for track in without_stalled_ends(counted(recording), recording, surveyed)
    }
    if not tracks:
        return []
    seen = _sightings(list(tracks.values()), surveyed)
    kinematics = SegmentKinematics(surveyed.segment, None)
    found: dict[int, VehicleSpeed] = {}
    for end_s in np.arange(_STEP_S, seen.time_s[-1] + 2 * _STEP_S, _STEP_S):
        rows = slice(*np.searchsorted(seen.time_s, [end_s - _WINDOW_S - _LEAD_S, end_s]))
        window = (
            kinematics.features(seen.take(rows), end_s - _WINDOW_S, _WINDOW_S)
            if rows.stop > rows.start
            else None
        )
        for vehicle in window.vehicles if window else ():
            if vehicle.track not in found and tracks[vehicle.track].time_s[-1] < end_s:
                speed, error = _mean_speed(vehicle, surveyed.speed_error)
                lane, crossed_s = _crossing(recording, tracks[vehicle.track])
                found[vehicle.track] = VehicleSpeed(vehicle.track, lane, crossed_s, speed, error)
    return list(found.values())


def without_stalled_ends(
    tracks: list[PixelTrack], recording: GatedRecording, surveyed: Surveyed
) -> list[PixelTrack]:
    """Tracks up to where the tracker's region of the picture ends.

    There the point of a vehicle that drives on stays where it is. The place is, by lane, the first
    metre in the second half of the way in which vehicles make less than 0.85 of their usual way.
    """
    segment = surveyed.segment
    bins, shares, lanes = [], [], []
    for track in tracks:
        along = segment.along(surveyed.camera.to_road(track.image_px)) - segment.begin_m
        speed = np.diff(along) / np.diff(track.time_s)
        usual = float(np.median(speed))
        if usual > 0:
            bins.append(np.floor((along[1:] + along[:-1]) / 2 / _BIN_M))
            shares.append(speed / usual)
            lanes.append(recording.lane_of(track.image_px[1:]))
    if not bins:
        return tracks
    place, share, lane = (np.concatenate(each) for each in (bins, shares, lanes))
    limit_m = np.full(segment.lanes, np.inf)
    for number in range(segment.lanes):
        for metre in np.unique(place[(lane == number) & (place * _BIN_M > segment.length_m / 2)]):
            there = share[(lane == number) & (place == metre)]
            if len(there) >= _MIN_IN_BIN and np.median(there) < _STALLED_SHARE:
                limit_m[number] = metre * _BIN_M
                break
    kept = []
    for track in tracks:
        along = segment.along(surveyed.camera.to_road(track.image_px)) - segment.begin_m
        beyond = along >= limit_m[recording.lane_of(track.image_px)]
        end = int(beyond.argmax()) if beyond.any() else len(track)
        if end >= _MIN_POSITIONS:
            kept.append(track.take(slice(0, end)))
    return kept


def _mean_speed(vehicle: VehicleMotion, calibration_error: float) -> tuple[float, float]:
    """Mean over the time between the gates, and its standard error, km/h."""
    weights = vehicle.weight_s / vehicle.weight_s.sum()
    speed = float(weights @ vehicle.motion.speed_mps)
    variance = float(weights @ vehicle.motion.speed_covariance @ weights)
    lasting = np.linalg.norm([OWN_SPEED_STD, COMMON_SPEED_STD, calibration_error]) * speed
    return _KMH * speed, _KMH * float(np.hypot(np.sqrt(max(variance, 0.0)), lasting))


def _sightings(tracks: list[PixelTrack], surveyed: Surveyed) -> Sightings:
    """Positions as the road points of cars' boxes, each with the covariance of such a box."""
    number = np.concatenate([np.full(len(track), track.id) for track in tracks])
    time_s = np.concatenate([track.time_s for track in tracks])
    image = np.concatenate([track.image_px for track in tracks])
    rows = np.argsort(time_s, kind="stable")
    number, time_s, image = number[rows], time_s[rows], image[rows]
    # No box is known, so none that covers another.
    cars = Detections(
        _car_boxes(image, surveyed),
        np.ones(len(image), dtype=np.float32),
        np.arange(len(image), dtype=np.int64),
    )
    found = place_on_road(cars, np.zeros(len(image)), surveyed.camera)
    kept = found.classes
    return Sightings(
        number[kept],
        time_s[kept],
        found.points_m,
        found.covariances_m2,
        # The tracker's point is the vehicle's, not its box's: nothing lies between.
        np.zeros((len(kept), 2)),
        np.zeros(len(kept), dtype=np.int64),
        found.boxes,
    )


def _car_boxes(image_px: Array, surveyed: Surveyed) -> npt.NDArray[np.float32]:
    """Boxes of a car whose front stands at each point, px, shape (n, 4)."""
    camera, segment = surveyed.camera, surveyed.segment
    pose = camera.pose
    if pose is None:
        raise RuntimeError(f"{camera.name}: the fit is no plain camera")
    width, height = NOMINAL_SIZE_M[0]
    front = camera.to_road(image_px)
    corners = [
        front - length * segment.direction + side * segment.left
        for length in (0.0, NOMINAL_LENGTH_M[0])
        for side in (-width / 2, width / 2)
    ]
    seen = np.stack(
        [
            pose.project(np.column_stack([corner, np.full(len(corner), z)]))
            for corner in corners
            for z in (0.0, height)
        ]
    )
    size = seen.max(axis=0) - seen.min(axis=0)
    half = size[:, 0] / 2
    x, y = image_px.T
    boxes = np.column_stack([x - half, y - size[:, 1], x + half, y])
    return boxes.astype(np.float32)


def _between_gates(recording: GatedRecording, track: PixelTrack) -> int:
    """How many positions lie between the first and the last gate."""
    lines = recording.gates[[0, -1]]
    lines = lines * np.sign(lines[:, 1:2])
    side = np.column_stack([track.image_px, np.ones(len(track))]) @ lines.T > 0
    return int((side[:, 0] != side[:, 1]).sum())


def _crossing(recording: GatedRecording, track: PixelTrack) -> tuple[int, float]:
    """Lane and time at the last gate, by a line through the six positions nearest to it."""
    gate = recording.gates[0] / np.linalg.norm(recording.gates[0][:2])
    distance = np.column_stack([track.image_px, np.ones(len(track))]) @ gate
    near = np.argsort(np.abs(distance), kind="stable")[:_NEAREST]
    matrix = np.column_stack([np.ones(len(near)), distance[near] - distance[near].mean()])
    target = np.column_stack([track.time_s, track.image_px])[near]
    middle, slope = np.linalg.lstsq(matrix, target, rcond=None)[0]
    time_s, x, y = middle - slope * distance[near].mean()
    return int(recording.lane_of(np.array([[x, y]]))[0]), float(time_s)
