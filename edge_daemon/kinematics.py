"""Sightings in a window → the six kinematic features of a road segment (paper, section V-A).

Speeds and accelerations come from local quadratic fits to pieces of each vehicle's track, never
from differences between frames: a second difference of positions with 0.3 m of noise would drown
every threshold. The variance of the estimator is subtracted from the variances that it inflates.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.tracking import Sighting
from slipstream.messages import Estimate, KinematicFeatures

PIECE_S: Final = 2.0
MIN_PIECE_S: Final = 1.0
MIN_PIECE_SIGHTINGS: Final = 8
NOMINAL_LENGTH_M: Final = (4.5, 8.5, 12.0, 2.2)
"""Length by vehicle class, m: turns distances between vehicles into gaps."""


@dataclass(frozen=True)
class Piece:
    """A quadratic fit to a piece of one vehicle's track.

    Attributes:
        track: the vehicle.
        duration_s: length of the piece.
        speed_mps: at its middle, along the segment.
        acceleration_mps2: along the segment.
        covariance: of (speed, acceleration), shape (2, 2).
    """

    track: int
    duration_s: float
    speed_mps: float
    acceleration_mps2: float
    covariance: Array


@dataclass(frozen=True)
class WindowFeatures:
    """The features of one window, and how many vehicles they rest on."""

    features: KinematicFeatures
    vehicles: int


def features_of(
    sightings: Iterable[Sighting], segment: WatchedSegment, observed_s: float
) -> WindowFeatures | None:
    """Features of one segment over one window.

    Args:
        sightings: all sightings of the window, any order.
        segment: the watched segment.
        observed_s: how much of the window was covered by frames, s, > 0.

    Returns:
        None if no vehicle was followed long enough for a fit.
    """
    paths = _paths(sightings, segment)
    pieces = [piece for path in paths for piece in _pieces(path)]
    if not pieces:
        return None
    present_s = sum(path.times_s[-1] - path.times_s[0] for path in paths)
    speed, spread, mean_a, variance_a = _moments(pieces)
    return WindowFeatures(
        KinematicFeatures(
            mean_speed_mps=speed,
            mean_acceleration_mps2=mean_a,
            density_veh_per_m=Estimate(value=present_s / (observed_s * segment.length_m)),
            speed_std_mps=spread,
            acceleration_variance_m2ps4=variance_a,
            mean_gap_m=_mean_gap(paths),
        ),
        len({piece.track for piece in pieces}),
    )


@dataclass(frozen=True)
class _Path:
    track: int
    times_s: Array
    along_m: Array
    variance_m2: Array
    lane: int
    length_m: float


def _paths(sightings: Iterable[Sighting], segment: WatchedSegment) -> list[_Path]:
    by_track: dict[int, list[Sighting]] = defaultdict(list)
    for sighting in sightings:
        by_track[sighting.track].append(sighting)
    paths = []
    for track, seen in sorted(by_track.items()):
        points = np.stack([s.point_m for s in seen])
        inside = segment.contains(points)
        if inside.sum() < 2:
            continue
        times = np.array([s.time_s for s in seen])[inside]
        order = np.argsort(times)
        covariances = np.stack([s.covariance_m2 for s in seen])[inside]
        variance = np.einsum("i,nij,j->n", segment.direction, covariances, segment.direction)
        along = segment.along(points[inside])[order]
        if along[-1] < along[0] - 1.0:
            continue  # oncoming traffic seen over this segment's edge
        paths.append(
            _Path(
                track,
                times[order],
                along,
                variance[order],
                int(np.median(segment.lane(points[inside]))),
                NOMINAL_LENGTH_M[seen[-1].vehicle_class],
            )
        )
    return paths


def _pieces(path: _Path) -> list[Piece]:
    duration = path.times_s[-1] - path.times_s[0]
    if duration < MIN_PIECE_S:
        return []
    count = max(1, round(duration / PIECE_S))
    edges = np.linspace(path.times_s[0], path.times_s[-1], count + 1)
    edges[-1] += 1e-6
    pieces = []
    for begin, end in pairwise(edges):
        chosen = (path.times_s >= begin) & (path.times_s < end)
        if chosen.sum() >= MIN_PIECE_SIGHTINGS:
            pieces.append(_fit(path, chosen, (begin + end) / 2, end - begin))
    return pieces


def _fit(path: _Path, chosen: npt.NDArray[np.bool_], middle_s: float, duration_s: float) -> Piece:
    """Weighted least squares of along = s0 + v τ + a τ²/2.

    The boxes of one vehicle err alike from frame to frame, so the residuals of an AR(1) process
    widen the covariance by (1 + r)/(1 − r), r their lag-one correlation.
    """
    tau = path.times_s[chosen] - middle_s
    weight = 1.0 / np.sqrt(path.variance_m2[chosen])
    design = np.column_stack([np.ones_like(tau), tau, tau**2 / 2]) * weight[:, None]
    target = path.along_m[chosen] * weight
    inverse = np.linalg.inv(design.T @ design)
    solution = inverse @ (design.T @ target)
    residual = target - design @ solution
    scale = float(residual @ residual) / max(1, len(tau) - 3)
    lag = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-12)
    lag = min(max(lag, 0.0), 0.9)
    covariance: Array = np.asarray(inverse * scale * (1 + lag) / (1 - lag), dtype=np.float64)
    return Piece(
        path.track, float(duration_s), float(solution[1]), float(solution[2]), covariance[1:, 1:]
    )


def _moments(pieces: Sequence[Piece]) -> tuple[Estimate, Estimate, Estimate, Estimate]:
    """Mean speed, spread of speed, mean acceleration, variance of acceleration.

    Pieces weigh by their duration, as samples at equal times would. Variances are those between
    pieces less the estimator's own, plus what a piece's own acceleration spreads its speed,
    a²T²/12; they are not let below zero.
    """
    duration = np.array([p.duration_s for p in pieces])
    v = np.array([p.speed_mps for p in pieces])
    a = np.array([p.acceleration_mps2 for p in pieces])
    var_v = np.array([p.covariance[0, 0] for p in pieces])
    var_a = np.array([p.covariance[1, 1] for p in pieces])
    w = duration / duration.sum()
    mean_v, mean_a = float(w @ v), float(w @ a)
    # Acceleration variance weighs sure pieces more: a far vehicle's fit can be off by m/s².
    sure = duration / (_TYPICAL_VARIANCE + var_a)
    sure /= sure.sum()
    excess_a = float(sure @ ((a - mean_a) ** 2 - var_a))
    inside = np.maximum(a**2 - var_a, 0.0) * duration**2 / 12
    excess_v = float(w @ ((v - mean_v) ** 2 - var_v + inside))
    variance_a, variance_v = max(0.0, excess_a), max(0.0, excess_v)
    error_a = float(np.sqrt(np.sum(sure**2 * (4 * variance_a * var_a + 2 * var_a**2))))
    error_v = float(np.sqrt(np.sum(w**2 * (4 * variance_v * var_v + 2 * var_v**2))))
    spread = float(np.sqrt(variance_v))
    return (
        Estimate(value=mean_v, standard_error=float(np.sqrt(w**2 @ var_v))),
        Estimate(value=spread, standard_error=error_v / max(2 * spread, np.sqrt(error_v), 1e-9)),
        Estimate(value=mean_a, standard_error=float(np.sqrt(w**2 @ var_a))),
        Estimate(value=variance_a, standard_error=error_a),
    )


_TYPICAL_VARIANCE: Final = 0.5


def _mean_gap(paths: Sequence[_Path]) -> Estimate | None:
    """Mean clear distance between followers and leaders in one lane, sampled twice a second."""
    gaps: list[float] = []
    times = np.concatenate([path.times_s for path in paths])
    for at in np.arange(times.min(), times.max(), 0.5):
        there = [
            (path.lane, float(np.interp(at, path.times_s, path.along_m)), path.length_m)
            for path in paths
            if path.times_s[0] <= at <= path.times_s[-1]
        ]
        there.sort()
        for (lane, behind, own_m), (other, ahead, leader_m) in pairwise(there):
            if lane == other:
                # The seen point is the near end of a vehicle; half of each length is its share.
                gaps.append(max(0.0, ahead - behind - (own_m + leader_m) / 2))
    if not gaps:
        return None
    return Estimate(value=float(np.mean(gaps)))
