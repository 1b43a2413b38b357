"""Sightings in a window → the six kinematic features of a road segment (paper, section V-A).

Speeds and accelerations come from smoothing each vehicle's positions over the window, never from
differences between frames: a second difference of positions with 0.3 m of noise would drown every
threshold. Each feature is the posterior mean over the segment's vehicles and times, with the
posterior's standard error.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.camera.pose import CameraPose
from edge_daemon.course import Course, learn_course
from edge_daemon.motion import Fit, Motion, condense, estimate_components
from edge_daemon.tracking import Sightings
from slipstream.messages import Estimate, KinematicFeatures

MIN_FOLLOWED_S: Final = 1.0
MIN_SIGHTINGS: Final = 8
_REACH_M: Final = 25.0
_PLACES: Final = 8
_LONGEST_PAUSE_S: Final = 1.0
MARGIN_M: Final = 15.0
"""So far before and behind the segment positions still help to smooth those within."""
NOMINAL_LENGTH_M: Final = (4.5, 8.5, 12.0, 2.2)
"""Length by vehicle class, m: turns distances between vehicles into gaps."""
LENGTH_STD_M: Final = 0.7
"""How far lengths spread within a class."""
NOMINAL_SIZE_M: Final = ((1.8, 1.5), (2.4, 3.0), (2.5, 3.1), (0.8, 1.6))
"""Width and height by vehicle class, m: what makes a box's lower edge differ from the middle."""


OWN_SPEED_STD: Final = 0.005
COMMON_SPEED_STD: Final = 0.003
OWN_ACCELERATION_STD_MPS2: Final = 0.08
COMMON_ACCELERATION_STD_MPS2: Final = 0.03
"""Errors that last for a vehicle's way, as renders show them; those of speed are relative."""


@dataclass(frozen=True)
class VehicleMotion:
    """One vehicle's smoothed motion along a segment.

    Attributes:
        track: the vehicle's track.
        motion: at its condensed positions; `along_m` is the vehicle's middle.
        weight_s: time that each position stands for while the vehicle was in the segment and the
            window, shape (n,); 0 outside.
        lane: lane index.
        length_m: nominal length.
    """

    track: int
    motion: Motion
    weight_s: Array
    lane: int
    length_m: float

    @property
    def speed_std_mps(self) -> Array:
        """Standard error of the speed at each position, m/s, shape (n,)."""
        lasting = np.hypot(OWN_SPEED_STD, COMMON_SPEED_STD) * self.motion.speed_mps
        variance = np.maximum(np.diag(self.motion.speed_covariance), 0.0)
        return np.asarray(np.sqrt(variance + lasting**2))


@dataclass(frozen=True)
class WindowFeatures:
    """The features of one window and the motions that they rest on."""

    features: KinematicFeatures
    vehicles: tuple[VehicleMotion, ...]


class SegmentKinematics:
    """Measures one segment, window after window.

    Vehicles that have gone on keep the fit that they had: most of a window is the last one's.
    """

    def __init__(self, segment: WatchedSegment, pose: CameraPose | None) -> None:
        """Set it up.

        Args:
            segment: the watched segment.
            pose: of the camera; without one, vehicles' middles are guessed from their lengths.
        """
        self._segment = segment
        self._pose = pose
        self._paths: dict[_Key, _Path | None] = {}

    def features(
        self, sightings: Sightings, begin_s: float, observed_s: float
    ) -> WindowFeatures | None:
        """Features over one window.

        Args:
            sightings: of the window and, if there are, some from before it; any order.
            begin_s: media time at which the window begins.
            observed_s: how much of the window was covered by frames, s, > 0.

        Returns:
            None if no vehicle was followed long enough.
        """
        vehicles = self._motions(sightings, begin_s)
        return _features(vehicles, observed_s * self._segment.length_m) if vehicles else None

    def _motions(self, sightings: Sightings, begin_s: float) -> list[VehicleMotion]:
        segment = self._segment
        parts = _by_vehicle(sightings, segment)
        course = learn_course([(segment.along(p.point_m), p.point_m @ segment.left) for p in parts])
        known, self._paths = self._paths, {}
        new = [part for part in parts if _key(part) not in known]
        for part, offset in zip(new, _to_middle(new, segment, self._pose), strict=True):
            middle = replace(part, point_m=part.point_m + offset)
            known[_key(part)] = _path(middle, segment, course)
        self._paths = {_key(part): known[_key(part)] for part in parts}
        paths = [path for path in self._paths.values() if path is not None]
        if not paths:
            return []
        components = estimate_components([path.fit for path in paths])
        low, high = (float(end) for end in course.arc(_ends(segment)))
        vehicles = []
        for path in paths:
            motion = path.fit.smooth(components)
            weight = _weights(motion, path, low, high, begin_s)
            if weight.sum() > 0:
                vehicle = VehicleMotion(path.track, motion, weight, path.lane, path.length_m)
                vehicles.append(vehicle)
        return vehicles


_Key = tuple[int, float, float, int]


def _key(seen: Sightings) -> _Key:
    return int(seen.track[0]), float(seen.time_s[0]), float(seen.time_s[-1]), len(seen)


def _features(vehicles: Sequence[VehicleMotion], area: float) -> WindowFeatures:
    """The six features; the area is the segment's length times the observed time, m s."""
    present_s = sum(float(vehicle.weight_s.sum()) for vehicle in vehicles)
    weights = [vehicle.weight_s / present_s for vehicle in vehicles]
    speed, spread = _moments(
        weights,
        [vehicle.motion.speed_mps for vehicle in vehicles],
        [vehicle.motion.speed_covariance for vehicle in vehicles],
    )
    own, common = OWN_SPEED_STD * speed.value, COMMON_SPEED_STD * speed.value
    speed, spread = _with_lasting_errors(weights, speed, spread, own, common)
    acceleration, variance = _with_lasting_errors(
        weights,
        *_moments(
            weights,
            [vehicle.motion.acceleration_mps2 for vehicle in vehicles],
            [vehicle.motion.acceleration_covariance for vehicle in vehicles],
        ),
        OWN_ACCELERATION_STD_MPS2,
        COMMON_ACCELERATION_STD_MPS2,
    )
    std = float(np.sqrt(spread.value))
    error = spread.standard_error or 0.0
    return WindowFeatures(
        KinematicFeatures(
            mean_speed_mps=speed,
            mean_acceleration_mps2=acceleration,
            density_veh_per_m=Estimate(
                value=present_s / area, standard_error=_presence_error_s(vehicles) / area
            ),
            speed_std_mps=Estimate(
                value=std, standard_error=error / max(2 * std, np.sqrt(error), 1e-9)
            ),
            acceleration_variance_m2ps4=variance,
            mean_gap_m=_mean_gap(vehicles),
        ),
        tuple(vehicles),
    )


def _by_vehicle(sightings: Sightings, segment: WatchedSegment) -> list[Sightings]:
    """The sightings of each vehicle that was in the segment, in order."""
    order = np.lexsort((sightings.time_s, sightings.track))
    near = segment.along(sightings.point_m[order])
    low, high = segment.begin_m - _REACH_M, segment.begin_m + segment.length_m + _REACH_M
    sorted_ = sightings.take(order[(near >= low) & (near <= high)])
    # A vehicle that was away for longer has been somewhere else; it may even be another one.
    paused = np.diff(sorted_.time_s, prepend=0.0) > _LONGEST_PAUSE_S
    begins = np.flatnonzero((np.diff(sorted_.track, prepend=-1) != 0) | paused)
    inside = np.append(0, np.cumsum(segment.contains(sorted_.point_m + _half_length(sorted_))))
    return [
        sorted_.take(slice(begin, end))
        for begin, end in pairwise([*begins.tolist(), len(sorted_)])
        if end - begin >= MIN_SIGHTINGS and inside[end] - inside[begin] >= 2
    ]


def _ends(segment: WatchedSegment) -> Array:
    """Where the segment begins and ends along its direction, m, shape (2,)."""
    return np.array([segment.begin_m, segment.begin_m + segment.length_m])


def _half_length(seen: Sightings) -> Array:
    """Roughly from a box's lower edge to its vehicle's middle, m, shape (n, 2)."""
    return np.asarray(seen.away * np.array(NOMINAL_LENGTH_M)[seen.vehicle_class, None] / 2)


def _to_middle(
    parts: Sequence[Sightings], segment: WatchedSegment, pose: CameraPose | None
) -> list[Array]:
    """For each vehicle's sightings, from its boxes' lower edges to its middle, m, shape (n, 2)."""
    if pose is None:
        return [_half_length(part) for part in parts]
    # It varies slowly along the road: a few places are enough to draw it through.
    some = [np.unique(np.linspace(0, len(part) - 1, _PLACES).astype(np.intp)) for part in parts]
    kinds = [int(part.vehicle_class[-1]) for part in parts]
    sizes = [
        np.tile([NOMINAL_LENGTH_M[kind], *NOMINAL_SIZE_M[kind]], (len(rows), 1))
        for kind, rows in zip(kinds, some, strict=True)
    ]
    if not parts:
        return []
    points = np.concatenate([part.point_m[rows] for part, rows in zip(parts, some, strict=True)])
    headings = np.tile(segment.direction, (len(points), 1))
    offsets = pose.centre_offset(points, headings, np.concatenate(sizes))
    borders = np.cumsum([len(rows) for rows in some])[:-1]
    result = []
    for part, rows, offset in zip(parts, some, np.split(offsets, borders), strict=True):
        good = np.isfinite(offset).all(axis=1)
        if good.any():
            every = np.arange(len(part))
            columns = [np.interp(every, rows[good], column) for column in offset[good].T]
            result.append(np.column_stack(columns))
        else:
            result.append(_half_length(part))
    return result


@dataclass(frozen=True)
class _Path:
    track: int
    fit: Fit
    first_s: float
    last_s: float
    lane: int
    length_m: float


def _path(seen: Sightings, segment: WatchedSegment, course: Course) -> _Path | None:
    """The vehicle's positions along the segment; None if it is not one of this segment."""
    along = segment.along(seen.point_m)
    low, high = _ends(segment)
    near = np.flatnonzero((along >= low - MARGIN_M) & (along <= high + MARGIN_M))
    inside = segment.contains(seen.point_m)
    if len(near) < MIN_SIGHTINGS or inside.sum() < 2:
        return None
    times, along = seen.time_s[near], along[near]
    if times[-1] - times[0] < MIN_FOLLOWED_S:
        return None
    if along[-1] < along[0] - 1.0:
        return None  # oncoming traffic seen over this segment's edge
    variance = np.einsum(
        "i,nij,j->n", segment.direction, seen.covariance_m2[near], segment.direction
    )
    positions = condense(times, course.arc(along), variance)
    if len(positions) < 3:
        return None
    return _Path(
        int(seen.track[0]),
        Fit(positions),
        float(times[0]),
        float(times[-1]),
        int(np.median(segment.lane(seen.point_m[inside]))),
        NOMINAL_LENGTH_M[int(seen.vehicle_class[-1])],
    )


def _weights(motion: Motion, path: _Path, low: float, high: float, begin_s: float) -> Array:
    """Time that each condensed position stands for, as far as it lies in segment and window."""
    time = motion.time_s
    middles = (time[1:] + time[:-1]) / 2
    borders = np.concatenate([[path.first_s], middles, [path.last_s]])
    # Where the vehicle was at the borders between neighbouring positions.
    along = np.interp(borders, time, motion.along_m)
    along[0] += (borders[0] - time[0]) * motion.speed_mps[0]
    along[-1] += (borders[-1] - time[-1]) * motion.speed_mps[-1]
    # Share of each interval in the segment and the window, motion within it taken as even.
    moved = np.maximum(along[1:] - along[:-1], 1e-6)
    in_segment = (np.clip(along[1:], low, high) - np.clip(along[:-1], low, high)) / moved
    standing = along[1:] - along[:-1] < 1e-3
    in_segment[standing] = ((along[:-1] >= low) & (along[:-1] <= high))[standing]
    in_window = np.diff(np.maximum(borders, begin_s))
    return np.asarray(in_window * np.clip(in_segment, 0.0, 1.0))


def _moments(
    weights: Sequence[Array], means: Sequence[Array], covariances: Sequence[Array]
) -> tuple[Estimate, Estimate]:
    """Mean and variance over all vehicles and times, each with its posterior standard error.

    With x̂ the posterior mean and P its covariance, E[Σ w (x − x̄)²] is Σ w (x̂ − x̄)² + Σ w P_ii less
    the variance of x̄ itself.
    """
    mean = float(sum(w @ m for w, m in zip(weights, means, strict=True)))
    mean_variance = float(sum(w @ p @ w for w, p in zip(weights, covariances, strict=True)))
    value = -mean_variance
    error = 0.0
    for w, m, p in zip(weights, means, covariances, strict=True):
        off = m - mean
        value += float(w @ off**2 + w @ np.diag(p))
        weighted = w * off
        error += float(4 * weighted @ p @ weighted + 2 * np.sum((w[:, None] * p * w) * p))
    return (
        Estimate(value=mean, standard_error=float(np.sqrt(max(0.0, mean_variance)))),
        Estimate(value=max(0.0, value), standard_error=float(np.sqrt(max(0.0, error)))),
    )


def _with_lasting_errors(
    weights: Sequence[Array], mean: Estimate, variance: Estimate, own_std: float, common_std: float
) -> tuple[Estimate, Estimate]:
    """Add errors that stay for a vehicle's whole way: its own and those that all vehicles share.

    A vehicle longer or higher than its class seems to change its speed as it comes nearer. Such
    errors spread the vehicles, which is taken off the variance, and do not average out over a
    vehicle's positions.
    """
    shares = np.array([w.sum() for w in weights])
    alike = float(shares @ shares)
    own = own_std**2
    excess = max(0.0, variance.value - (1 - alike) * own)
    of_mean = np.hypot(common_std, np.sqrt(alike * own))
    of_variance = np.sqrt(4 * excess * alike * own + 2 * alike * own**2)
    return (
        Estimate(
            value=mean.value,
            standard_error=float(np.hypot(mean.standard_error or 0.0, of_mean)),
        ),
        Estimate(
            value=excess,
            standard_error=float(np.hypot(variance.standard_error or 0.0, of_variance)),
        ),
    )


def _presence_error_s(vehicles: Sequence[VehicleMotion]) -> float:
    """Standard error of the time that vehicles spent in the segment.

    Each crosses its two ends at a time that is unsure by the spread of lengths over its speed.
    """
    speeds = np.array([max(v.motion.speed_mps.mean(), 1.0) for v in vehicles])
    return float(np.sqrt(np.sum(2 * (LENGTH_STD_M / 2 / speeds) ** 2)))


def _mean_gap(vehicles: Sequence[VehicleMotion]) -> Estimate | None:
    """Mean clear distance between followers and leaders in one lane, sampled twice a second.

    Its error is that of the vehicles' lengths: one draw a pair, however long it was seen.
    """
    first = min(float(v.motion.time_s[0]) for v in vehicles)
    last = max(float(v.motion.time_s[-1]) for v in vehicles)
    gaps: dict[tuple[int, int], list[float]] = defaultdict(list)
    grid = np.arange(first, last, 0.5)
    places = np.stack(
        [
            np.where(
                np.interp(grid, v.motion.time_s, v.weight_s, 0.0, 0.0) > 0,
                np.interp(grid, v.motion.time_s, v.motion.along_m),
                np.nan,
            )
            for v in vehicles
        ]
    )
    for lane in {vehicle.lane for vehicle in vehicles}:
        members = np.array([i for i, vehicle in enumerate(vehicles) if vehicle.lane == lane])
        for column in places[members].T:
            there = np.argsort(column)[: np.count_nonzero(np.isfinite(column))]
            for behind, ahead in pairwise(there):
                pair = int(members[behind]), int(members[ahead])
                lengths = vehicles[pair[0]].length_m + vehicles[pair[1]].length_m
                gaps[pair].append(max(0.0, float(column[ahead] - column[behind]) - lengths / 2))
    if not gaps:
        return None
    counts = np.array([len(of_pair) for of_pair in gaps.values()])
    value = float(np.mean([gap for of_pair in gaps.values() for gap in of_pair]))
    error = LENGTH_STD_M / np.sqrt(2) * np.sqrt(np.sum((counts / counts.sum()) ** 2))
    return Estimate(value=value, standard_error=float(error))
