"""The camera of a recording, from surveyed distances.

A plain camera: square pixels, the optical axis in the picture's middle, no distortion. The road's
coordinates have their origin under the camera and x along its view.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from edge_daemon.calibration.calibration import CLICK_PX
from edge_daemon.camera import Array, Camera, WatchedSegment
from slipstream_lab.benchmarks.real.brno import SIZE, GatedRecording, GateSurvey

_TAPE_STD: Final = 0.003
_TAPE_STD_M: Final = 0.005
"""Standard errors of a distance measured on site: a share of it, and of either end."""
_PARALLEL_STD_M: Final = 0.1
"""Of the offset of a line's end from the direction along the road."""
_SQUARE_STD: Final = 0.01
"""Of the angle of a line across the road, rad."""
_STARTS: Final = ((1500.0, 0.3), (1500.0, 0.5), (3000.0, 0.3), (3000.0, 0.5))
_STEP: Final = 1e-4


@dataclass(frozen=True)
class Surveyed:
    """A camera over a road, with its one segment between the gates. `speed_error`: relative
    standard error of a speed between the gates, from the calibration.
    """

    camera: Camera
    height_m: float
    speed_error: float

    @property
    def segment(self) -> WatchedSegment:
        """Between the gates, all lanes."""
        return self.camera.segments[0]


def from_survey(recording: GatedRecording) -> Surveyed:
    """Fit focal length, tilt, roll and height to the measured distances.

    Least squares over these four, the road's direction and the surveyed points' true pixels, which
    are a click off. Lines along the road are parallel, those across it are square to it. Four
    distances are as many as unknowns: what the directions add, and the clicks, give the errors,
    larger where the residuals are.
    """
    survey = recording.survey
    ends = np.round(np.concatenate([survey.begin_px, survey.end_px]), 3)
    points, of = np.unique(ends, axis=0, return_inverse=True)
    begin, end = of.reshape(2, -1)

    def misses(numbers: Array) -> Array:
        clicks = numbers[5:].reshape(-1, 2)
        road = _road(numbers[:4], points + CLICK_PX * clicks)
        return np.concatenate([_misses(road[end] - road[begin], numbers[4], survey), numbers[5:]])

    fits = [
        least_squares(
            misses, np.r_[np.log(focal), tilt, 0.0, np.log(10.0), 0.0, np.zeros(2 * len(points))]
        )
        for focal, tilt in _STARTS
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    middles = _gate_middles(recording)

    def length(numbers: Array) -> float:
        return float(np.hypot(*np.diff(_road(numbers, middles), axis=0)[0]))

    covariance = np.linalg.inv(best.jac.T @ best.jac)[:4, :4]
    gradient = np.array(
        [(length(best.x[:4] + step) - length(best.x[:4] - step)) for step in _STEP * np.eye(4)]
    ) / (2 * _STEP)
    error = float(np.sqrt(gradient @ covariance @ gradient)) / length(best.x[:4])
    freedom = len(best.fun) - len(best.x)
    error *= float(np.sqrt(max(1.0, 2 * best.cost / freedom))) if freedom > 0 else 1.0
    return _surveyed(recording, best.x[:4], error)


def distance_errors(recording: GatedRecording, surveyed: Surveyed) -> Array:
    """Relative errors of the measured distances along the road, shape (n,)."""
    survey = recording.survey
    begin, end = surveyed.camera.to_road(survey.begin_px), surveyed.camera.to_road(survey.end_px)
    length = np.linalg.norm(end - begin, axis=1)
    return np.asarray((length / survey.distance_m - 1)[survey.along])


def _misses(lines: Array, direction: float, survey: GateSurvey) -> Array:
    """What measured lines (n, 2), m, miss their lengths and directions by, over standard errors."""
    length = np.linalg.norm(lines, axis=1)
    angle = np.arctan2(lines[:, 1], lines[:, 0]) - direction
    along, across = _half_turn(angle), _half_turn(angle - np.pi / 2)
    tape = _TAPE_STD * survey.distance_m + _TAPE_STD_M
    return np.concatenate(
        [
            (length - survey.distance_m) / tape,
            (along * survey.distance_m / _PARALLEL_STD_M)[survey.along],
            (across / _SQUARE_STD)[~survey.along],
        ]
    )


def _half_turn(angle: Array) -> Array:
    """The same line's angle in (−π/2, π/2]."""
    return np.asarray(np.angle(np.exp(2j * angle)) / 2)


def _road(numbers: Array, image_px: Array) -> Array:
    """Pixels (n, 2) to the road, x ahead and y left, m; log f, tilt, roll, log height."""
    focal, tilt, roll, height = np.exp(numbers[0]), numbers[1], numbers[2], np.exp(numbers[3])
    u, v = (image_px - np.array(SIZE) / 2).T / focal
    right, down = np.cos(roll) * u + np.sin(roll) * v, np.cos(roll) * v - np.sin(roll) * u
    below = np.cos(tilt) * down + np.sin(tilt)
    ahead = np.cos(tilt) - np.sin(tilt) * down
    return np.asarray(height * np.column_stack([ahead, -right]) / below[:, None])


def _gate_middles(recording: GatedRecording) -> Array:
    """The middle of the road at the first and the last gate that a vehicle crosses, px, (2, 2)."""
    return np.asarray(_outline(recording).reshape(2, 2, 2).mean(axis=1))


def _outline(recording: GatedRecording) -> Array:
    """The road between the gates: corners in the picture, two at the first gate, px, (4, 2)."""
    first, last = recording.gates[-1], recording.gates[0]
    right, left = recording.lane_lines[0], recording.lane_lines[-1]
    pairs = ((first, right), (first, left), (last, left), (last, right))
    corners = np.array([np.cross(*pair) for pair in pairs])
    return np.asarray(corners[:, :2] / corners[:, 2:])


def _surveyed(recording: GatedRecording, numbers: Array, error: float) -> Surveyed:
    outline = _outline(recording)
    polygon = _road(numbers, outline)
    travel = polygon[2:].mean(axis=0) - polygon[:2].mean(axis=0)
    direction = travel / np.linalg.norm(travel)
    lanes = len(recording.lane_lines) - 1
    width = float(np.ptp(polygon @ np.array([-direction[1], direction[0]])))
    segment = WatchedSegment(
        "gates", polygon, direction, float(np.ptp(polygon @ direction)), lanes, width / lanes
    )
    camera = Camera(recording.name, SIZE, polygon, outline, (segment,))
    return Surveyed(camera, float(np.exp(numbers[3])), error)
