"""A first guess of a camera from the traffic alone, without any survey. See docs/calibration.md,
"The page".

The lines of vehicles' feet meet in the road's vanishing point; how large cars' boxes are, near and
far, tells height and focal length. The camera is taken to hang level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from edge_daemon.camera import Array
from edge_daemon.detection import Detections, box_feet
from edge_daemon.settings import CalibrationPoint

_CAR_M: Final = (4.4, 1.8, 1.5)
_SHAPE: Final = np.array(
    [(x, y, 0.0) for x in (0.17, 0.83) for y in (-0.5, 0.5)]  # wheels
    + [(x, y, z) for x in (0.0, 1.0) for y in (-0.5, 0.5) for z in (0.2, 0.55)]  # body
    + [(x, y, 1.0) for x in (0.2, 0.78) for y in (-0.35, 0.35)]  # roof
)
"""Corners of a car as shares of its size, from the middle of its near end on the road."""
_SIZE_ERRORS: Final = (0.08, 0.04, 0.06)
"""Standard errors of the mean size of a place's cars, and of their shape, relative."""
_MIN_SCORE: Final = 0.5
_MIN_OVERLAP: Final = 0.3
_MIN_LINKS: Final = 6
_MIN_PATH_PX: Final = 30.0
_MIN_TRACKS: Final = 4
_EDGE_PX: Final = 4.0
_VANISHING_PX: Final = 10.0
_BOX_ERROR: Final = 0.05
_RESAMPLED: Final = 8
_DISTANCES: Final = (0.0, 0.33, 0.67, 1.0)


@dataclass(frozen=True)
class Guess:
    """A guessed camera: points as if surveyed, the standard error of its lengths, relative, and how
    many vehicles it rests on.
    """

    points: tuple[CalibrationPoint, ...]
    relative_error: float
    vehicles: int


def guess(detections: list[Detections], size: tuple[int, int]) -> Guess | None:
    """Guess a camera from the boxes of successive frames of (width, height); None where too few
    cars move.
    """
    paths = [path for path in _paths(detections, size) if len(path) >= _MIN_LINKS]
    feet = [box_feet(path) for path in paths]
    moving = [i for i, foot in enumerate(feet) if np.hypot(*(foot[-1] - foot[0])) >= _MIN_PATH_PX]
    paths, feet = [paths[i] for i in moving], [feet[i] for i in moving]
    if len(paths) < _MIN_TRACKS:
        return None
    try:
        whole = _camera(paths, feet, size)
        rng = np.random.default_rng(0)
        scales = []
        for _ in range(_RESAMPLED):
            drawn = rng.integers(0, len(paths), len(paths))
            other = _camera([paths[i] for i in drawn], [feet[i] for i in drawn], size)
            scales.append(np.log(_length_scale(other) / _length_scale(whole)))
        by_size = []
        for axis, off in enumerate(_SIZE_ERRORS):
            car = [length * (1 + off * (i == axis)) for i, length in enumerate(_CAR_M)]
            other = _camera(paths, feet, size, tuple(car))
            by_size.append(np.log(_length_scale(other) / _length_scale(whole)))
    except (np.linalg.LinAlgError, ValueError):
        return None
    error = float(np.hypot(np.std(scales), np.linalg.norm(by_size)))
    rows = np.concatenate(feet)[:, 1]
    near, far = np.percentile(rows, 98), np.percentile(rows, 10)
    return Guess(_points(whole, near, far, size), error, len(paths))


def _paths(detections: list[Detections], size: tuple[int, int]) -> list[Array]:
    """Boxes of cars linked from frame to frame by overlap, each shape (n, 4)."""
    done: list[list[Array]] = []
    open_paths: list[list[Array]] = []
    for found in detections:
        boxes = found.boxes[(found.scores >= _MIN_SCORE) & (found.classes == 0)].astype(np.float64)
        inside = (boxes[:, :2] > _EDGE_PX).all(axis=1)
        inside &= (boxes[:, 2:] < np.array(size) - _EDGE_PX).all(axis=1)
        left = list(boxes[inside])
        still = []
        for path in open_paths:
            shares = [_overlap(path[-1], box) for box in left]
            if shares and max(shares) >= _MIN_OVERLAP:
                path.append(left.pop(int(np.argmax(shares))))
                still.append(path)
            else:
                done.append(path)
        open_paths = still + [[box] for box in left]
    return [np.array(path) for path in done + open_paths]


def _overlap(one: Array, other: Array) -> float:
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    both = float(np.prod(np.clip(high - low, 0, None)))
    return both / float(np.prod(one[2:] - one[:2]) + np.prod(other[2:] - other[:2]) - both)


def _vanishing_point(feet: list[Array]) -> Array:
    """Where the lines of the paths meet, by least squares of angles, large misses weighing less."""
    middles = np.stack([foot.mean(axis=0) for foot in feet])
    directions = np.stack(
        [np.linalg.svd(foot - foot.mean(axis=0), full_matrices=False)[2][0] for foot in feet]
    )
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    weights = np.array([np.hypot(*np.ptp(foot, axis=0)) for foot in feet])
    point = np.linalg.lstsq(
        normals * weights[:, None], np.sum(normals * middles, axis=1) * weights, rcond=None
    )[0]
    for _ in range(20):
        away = np.hypot(*(point - middles).T)
        miss = np.sum(normals * (point - middles), axis=1) / away
        usual = max(1e-4, 1.5 * float(np.median(np.abs(miss))))
        robust = weights / away / np.sqrt(1 + (miss / usual) ** 2)
        point = np.linalg.lstsq(
            normals * robust[:, None], np.sum(normals * middles, axis=1) * robust, rcond=None
        )[0]
    return np.asarray(point)


@dataclass(frozen=True)
class _GuessedCamera:
    """A level camera: axes along the road, to its left and up, shape (3, 3), in camera axes."""

    axes: Array
    focal_px: float
    height_m: float
    middle_px: Array

    def project(self, points: Array) -> Array:
        """Pixels of points (..., 3) from the foot."""
        seen = (points - (0, 0, self.height_m)) @ self.axes
        return np.asarray(self.focal_px * seen[..., :2] / seen[..., 2:] + self.middle_px)

    def to_road(self, pixels: Array) -> Array:
        """Road points (n, 2) of pixels (n, 2) below the horizon."""
        shown = (pixels - self.middle_px) / self.focal_px
        rays = np.column_stack([shown, np.ones(len(shown))]) @ self.axes.T
        return np.asarray(rays[:, :2] * self.height_m / -rays[:, 2:])


def _level_camera(
    vanishing: Array, focal: float, height: float, size: tuple[int, int]
) -> _GuessedCamera:
    middle = np.array(size) / 2
    along = np.append((vanishing - middle) / focal, 1.0)
    along /= np.linalg.norm(along)
    # Level: up has no part to the right in the picture.
    up = np.array([0.0, -along[2], along[1]]) / np.hypot(along[1], along[2])
    left = np.cross(up, along)
    left /= np.linalg.norm(left)
    up = np.cross(along, left)
    return _GuessedCamera(np.stack([along, left, up]), focal, height, middle)


def _camera(
    paths: list[Array],
    feet: list[Array],
    size: tuple[int, int],
    car_m: tuple[float, ...] = _CAR_M,
) -> _GuessedCamera:
    vanishing = _vanishing_point(feet)
    boxes = np.concatenate([path[:: max(1, len(path) // 12)] for path in paths])
    foot = box_feet(boxes)
    below = foot[:, 1] > vanishing[1] + 2.5 * _VANISHING_PX + 8
    boxes, foot = boxes[below], foot[below]
    if len(boxes) < _MIN_LINKS:
        raise ValueError
    sizes = np.log(boxes[:, 2:] - boxes[:, :2])
    ends = _SHAPE * car_m

    def camera_of(parameters: Array) -> _GuessedCamera:
        focal, height = np.exp(parameters[:2]).tolist()
        return _level_camera(vanishing + _VANISHING_PX * parameters[2:], focal, height, size)

    def misses(parameters: Array) -> Array:
        camera = camera_of(parameters)
        places = camera.to_road(foot)
        corners = np.zeros((len(places), 1, 3))
        corners[:, 0, :2] = places
        seen = camera.project(corners + ends)
        off = np.log(np.maximum(np.ptp(seen, axis=1), 1e-3)) - sizes
        # Lower edges' middles do not run quite towards the vanishing point: sizes correct it.
        return np.append(off.ravel(), _BOX_ERROR * parameters[2:])

    best = None
    for of_width in (0.6, 1.2, 2.5, 5.0):
        start = np.array([np.log(of_width * size[0]), np.log(8.0), 0.0, 0.0])
        low = [np.log(0.3 * size[0]), np.log(2.0), -2.5, -2.5]
        high = [np.log(15.0 * size[0]), np.log(60.0), 2.5, 2.5]
        fit = least_squares(
            misses, start, bounds=(low, high), loss="soft_l1", f_scale=0.1, max_nfev=60
        )
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    return camera_of(np.asarray(best.x))


def _length_scale(camera: _GuessedCamera) -> float:
    """Lengths along the road go with focal length times height."""
    return camera.focal_px * camera.height_m


def _points(
    camera: _GuessedCamera, near: float, far: float, size: tuple[int, int]
) -> tuple[CalibrationPoint, ...]:
    middle = np.full(2, size[0] / 2)
    stations = camera.to_road(np.column_stack([middle, [near, far]]))[:, 0]
    # Equal steps of 1/x are equal steps in the picture.
    along = 1 / (1 / stations[0] + np.array(_DISTANCES) * (1 / stations[1] - 1 / stations[0]))
    points = []
    for x in along.round(1).tolist():
        row = camera.project(np.array([x, 0.0, 0.0]))
        sides = camera.to_road(
            np.array([[0.2, row[1] / size[0]], [0.8, row[1] / size[0]]]) * size[0]
        )
        for y in sides[:, 1].round(1).tolist():
            u, v = camera.project(np.array([x, y, 0.0]))
            if 0 <= u <= size[0] and 0 <= v <= size[1]:
                points.append(CalibrationPoint(image=(float(u), float(v)), road=(x, y)))
    return tuple(points)
