"""Sightings in a window → the six kinematic features of a road segment (paper, section V-A).

Each is the posterior mean over the segment's vehicles and times, with its standard error, of
positions smoothed over the window: a second difference of positions with 0.3 m of noise would drown
every threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.camera.pose import CameraPose
from edge_daemon.features.centreline import Centreline, fit_centreline
from edge_daemon.features.moments import (
    VariancePosterior,
    posterior_moments,
    with_persistent_errors,
)
from edge_daemon.features.occlusion import VirtualCars, correct_for_occlusion
from edge_daemon.features.smoother import ComponentsPosterior, Motion, Smoother
from edge_daemon.features.trajectories import (
    GroupedSightings,
    Trajectory,
    VehicleKey,
    count_oncoming,
    count_wrong_way,
    find_trajectories,
    group_by_vehicle,
)
from edge_daemon.tracking import Sightings
from slipstream.messages import Estimate, KinematicFeatures

LENGTH_STD_M: Final = 0.7
"""Standard deviation of the length within a vehicle class, m."""
OWN_SPEED_STD: Final = 0.005
COMMON_SPEED_STD: Final = 0.003
OWN_ACCELERATION_STD_MPS2: Final = 0.08
COMMON_ACCELERATION_STD_MPS2: Final = 0.03
"""Standard errors that persist along a vehicle's trajectory, measured on renders; those of speed
are relative."""


@dataclass(frozen=True)
class VehicleMotion:
    """One vehicle's smoothed motion along a segment.

    Attributes:
        motion: at its condensed positions; `along_m` is the vehicle's middle.
        weight_s: time that each position stands for while the vehicle was in the segment and the
            window, shape (n,); 0 outside.
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
    """The features of one window, corrected for occlusion, and what they rest on: those of the
    visible vehicles, what σ²_a may be, the share of the segment that was hidden, None where the
    pose is unknown, and the motions.
    """

    features: KinematicFeatures
    seen: KinematicFeatures
    variance: VariancePosterior
    occluded_share: float | None
    vehicles: tuple[VehicleMotion, ...]


class SegmentKinematics:
    """Measures one segment, window after window; trajectories of vehicles that have left are
    reused. Without a pose, vehicles' middles are guessed from their lengths, and nothing is known
    of what they hide.

    Attributes:
        oncoming: vehicles that drove against the segment's direction, at the latest features.
        wrong_way: those of them that certainly did so on it, and not beside it.
    """

    def __init__(self, segment: WatchedSegment, pose: CameraPose | None) -> None:
        self._segment = segment
        self._pose = pose
        self._virtual_cars = None if pose is None else VirtualCars(segment, pose)
        self._trajectories: dict[VehicleKey, Trajectory | None] = {}
        self.oncoming = self.wrong_way = 0

    def features(
        self, sightings: Sightings, begin_s: float, observed_s: float
    ) -> WindowFeatures | None:
        """Features over the window from `begin_s` on, of which frames covered `observed_s` > 0;
        None if no vehicle was grouped long enough. The sightings, in any order, may begin before
        the window.
        """
        segment = self._segment
        grouped = group_by_vehicle(sightings, segment)
        self.oncoming = count_oncoming(grouped, segment)
        self.wrong_way = count_wrong_way(grouped, segment) if self.oncoming else 0
        centreline = _centreline(grouped, segment)
        trajectories = self._find_trajectories(grouped, centreline)
        if not trajectories:
            return None
        smoother = Smoother([trajectory.positions for trajectory in trajectories])
        components = smoother.components()
        motion = smoother.smooth(components.mean)
        ends = centreline.arc_length(np.array([segment.begin_m, segment.end_m]))
        weights = _weights(motion, trajectories, ends, begin_s)
        vehicles = tuple(
            VehicleMotion(
                trajectory.track,
                motion.of(i, n),
                weights[i, :n],
                trajectory.lane,
                trajectory.length_m,
            )
            for i, (trajectory, n) in enumerate(
                (trajectory, len(trajectory.positions)) for trajectory in trajectories
            )
            if weights[i].sum() > 0
        )
        if not vehicles:
            return None
        variance = _acceleration_variance(smoother, components, weights)
        area = observed_s * segment.length_m
        seen = _features(motion, variance.estimate, weights, vehicles, area)
        if self._virtual_cars is None:
            return WindowFeatures(seen, seen, variance, None, vehicles)
        share = self._virtual_cars.occluded_share(sightings, begin_s)
        features = correct_for_occlusion(seen, share)
        variance = variance.corrected(features.acceleration_variance_m2ps4)
        return WindowFeatures(features, seen, variance, share, vehicles)

    def _find_trajectories(
        self, grouped: GroupedSightings, centreline: Centreline
    ) -> list[Trajectory]:
        """Paths of the vehicles on this segment; those that have gone on keep the one they had."""
        keys = grouped.keys()
        new = np.array([key not in self._trajectories for key in keys], dtype=np.bool_)
        found = iter(find_trajectories(grouped.take(new), self._segment, self._pose, centreline))
        self._trajectories = {
            key: next(found) if is_new else self._trajectories[key]
            for key, is_new in zip(keys, new, strict=True)
        }
        return [trajectory for trajectory in self._trajectories.values() if trajectory is not None]


def _centreline(grouped: GroupedSightings, segment: WatchedSegment) -> Centreline:
    points = grouped.sightings.point_m.take(grouped.rows, axis=0)
    return fit_centreline(grouped.vehicle, segment.along(points), points @ segment.left)


def _weights(
    motion: Motion, trajectories: Sequence[Trajectory], ends: Array, begin_s: float
) -> Array:
    """Time that each condensed position of a stack (v, n) stands for, as far as it lies in the
    segment, between its two ends, and in the window; 0 for what fills up the stack.
    """
    last = np.array([[len(trajectory.positions) - 1] for trajectory in trajectories])
    first_s = np.array([[trajectory.first_s] for trajectory in trajectories])
    last_s = np.array([[trajectory.last_s] for trajectory in trajectories])
    time, place, speed = motion.time_s, motion.along_m, motion.speed_mps
    # Where the vehicle was at the borders between neighbouring positions, and at its ends.
    borders = np.hstack([first_s, (time[:, 1:] + time[:, :-1]) / 2, last_s])
    along = np.hstack([place[:, :1], (place[:, 1:] + place[:, :-1]) / 2, place[:, -1:]])
    along[:, :1] += (first_s - time[:, :1]) * speed[:, :1]
    end = (np.take_along_axis(each, last, axis=1) for each in (time, place, speed))
    end_s, end_m, end_mps = end
    over = np.arange(borders.shape[1]) > last
    borders = np.where(over, last_s, borders)
    along = np.where(over, end_m + (last_s - end_s) * end_mps, along)
    # Share of each interval in the segment and the window, motion within it taken as even.
    low, high = ends
    begin, moved = along[:, :-1], np.diff(along)
    in_segment = np.diff(np.clip(along, low, high)) / np.maximum(moved, 1e-6)
    in_segment = np.where(moved < 1e-3, (begin >= low) & (begin <= high), in_segment)
    in_window = np.diff(np.maximum(borders, begin_s))
    return np.asarray(in_window * np.clip(in_segment, 0.0, 1.0))


def _acceleration_variance(
    smoother: Smoother, components: ComponentsPosterior, weights_s: Array
) -> VariancePosterior:
    """σ²_a of the vehicles, for each of the components that the data allow for."""
    weights = weights_s / weights_s.sum()
    moments = with_persistent_errors(
        weights,
        posterior_moments(weights, *smoother.accelerations(components)),
        OWN_ACCELERATION_STD_MPS2,
        COMMON_ACCELERATION_STD_MPS2,
    )
    return VariancePosterior(components.weight, moments.variance, moments.variance_error)


def _features(
    motion: Motion,
    variance: Estimate,
    weights_s: Array,
    vehicles: Sequence[VehicleMotion],
    area: float,
) -> KinematicFeatures:
    """The six features.

    Args:
        motion: of all vehicles, a stack of (v, n).
        variance: σ²_a.
        weights_s: time that each position stands for, shape (v, n).
        vehicles: those of them that were in segment and window.
        area: the segment's length times the observed time, m s.
    """
    present_s = float(weights_s.sum())
    weights = weights_s / present_s
    speeds = posterior_moments(weights, motion.speed_mps, motion.speed_covariance)
    own, common = OWN_SPEED_STD * speeds.mean, COMMON_SPEED_STD * speeds.mean
    speeds = with_persistent_errors(weights, speeds, float(own), float(common))
    accelerations = with_persistent_errors(
        weights,
        posterior_moments(weights, motion.acceleration_mps2, motion.acceleration_covariance),
        OWN_ACCELERATION_STD_MPS2,
        COMMON_ACCELERATION_STD_MPS2,
    )
    std, error = float(np.sqrt(speeds.variance)), float(speeds.variance_error)
    return KinematicFeatures(
        mean_speed_mps=_estimate(speeds.mean, speeds.mean_error),
        mean_acceleration_mps2=_estimate(accelerations.mean, accelerations.mean_error),
        density_veh_per_m=Estimate(
            value=present_s / area, standard_error=_presence_error_s(vehicles) / area
        ),
        speed_std_mps=Estimate(
            value=std, standard_error=error / max(2 * std, np.sqrt(error), 1e-9)
        ),
        acceleration_variance_m2ps4=variance,
        mean_gap_m=_mean_gap(vehicles),
    )


def _estimate(value: Array, error: Array) -> Estimate:
    return Estimate(value=float(value), standard_error=float(error))


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
    lanes, lengths = np.array([(v.lane, v.length_m) for v in vehicles]).T
    # Each lane's vehicles in a row, those ahead after those behind, the absent ones at its end.
    order = np.lexsort((places, np.broadcast_to(lanes[:, None], places.shape)), axis=0)
    behind, ahead = order[:-1], order[1:]
    distance = np.diff(np.take_along_axis(places, order, axis=0), axis=0)
    pairs = (lanes[behind] == lanes[ahead]) & np.isfinite(distance)
    if not pairs.any():
        return None
    clear = np.maximum(0.0, distance - (lengths[behind] + lengths[ahead]) / 2)
    counts = np.bincount((behind * len(vehicles) + ahead)[pairs])
    error = LENGTH_STD_M / np.sqrt(2) * np.sqrt(np.sum((counts / counts.sum()) ** 2))
    return Estimate(value=float(clear[pairs].mean()), standard_error=float(error))
