"""Occlusion: how much of a segment vehicles hide, by virtual cars that detected boxes would cover,
and the correction of the features for it. See docs/perception.md, "Occlusion".
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Final

import numpy as np
from msgspec.structs import replace

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.camera.pose import CameraPose
from edge_daemon.tracking import Sightings
from slipstream.messages import Estimate, KinematicFeatures

_CAR_M: Final = (4.5, 1.8, 1.5)
_SPACING_M: Final = 2.5
_INTERVAL_S: Final = 0.5
_SEEN_WITHIN_S: Final = 0.3
_OCCLUDED_COVER: Final = 0.6
"""The detector was trained on vehicles of which 40 % and more are visible."""
_NEARER_SHARE: Final = 0.25
"""A box is nearer than a virtual car if it ends lower by this share of the car's height."""
_MAX_OCCLUDED_SHARE: Final = 0.6


@dataclass(frozen=True)
class OcclusionCorrection:
    """The effect of occluded vehicles on one feature, as shares of its scale: at a ratio h of
    occluded to visible road the mean error is bias · h, and its variance share² + (growth · h)².
    """

    bias: float
    share: float
    growth: float


OcclusionCorrections = dict[str, OcclusionCorrection]

OCCLUSION_CORRECTIONS: Final[OcclusionCorrections] = {
    "mean_speed_mps": OcclusionCorrection(-0.098, 0.055, 0.066),
    "mean_acceleration_mps2": OcclusionCorrection(0.043, 0.068, 0.070),
    "density_veh_per_m": OcclusionCorrection(0.407, 0.029, 0.198),
    "speed_std_mps": OcclusionCorrection(-0.053, 0.054, 0.000),
    "acceleration_variance_m2ps4": OcclusionCorrection(-0.175, 0.079, 0.000),
    "mean_gap_m": OcclusionCorrection(-0.363, 0.084, 0.102),
}


class VirtualCars:
    """Virtual cars on the lanes of a segment, one every 2.5 m, projected into the frame."""

    def __init__(self, segment: WatchedSegment, pose: CameraPose) -> None:
        along = np.arange(segment.begin_m + _SPACING_M / 2, segment.end_m, _SPACING_M)
        across = segment.right_edge_m + (np.arange(segment.lanes) + 0.5) * segment.lane_width_m
        middles = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 1, 2)
        ends = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
        axes = np.stack([segment.direction, segment.left])
        corners = np.empty((len(middles), 8, 3))
        corners[:, :, :2] = (middles + ends[:, :2] * _CAR_M[:2]) @ axes
        corners[:, :, 2] = ends[:, 2] * _CAR_M[2]
        seen = pose.project(corners).reshape(-1, 8, 2)
        seen = seen[np.isfinite(seen).all(axis=(1, 2))]
        self._low, self._high = seen.min(axis=1), seen.max(axis=1)

    def occluded_share(self, sightings: Sightings, begin_s: float) -> float:
        """Share of the virtual cars that detected boxes hide since a media time, sampled twice a
        second.
        """
        times = np.unique(sightings.time_s[sightings.time_s >= begin_s])
        if not len(times) or not len(self._low):
            return 0.0
        instants = np.arange(begin_s + _INTERVAL_S / 2, times[-1] + _INTERVAL_S / 2, _INTERVAL_S)
        after = np.clip(np.searchsorted(times, instants), 1, max(len(times) - 1, 1))
        near = np.stack([times[after - 1], times[np.minimum(after, len(times) - 1)]])
        nearest = np.take_along_axis(near, np.abs(near - instants).argmin(axis=0)[None], axis=0)[0]
        chosen = np.unique(nearest[np.abs(nearest - instants) <= _SEEN_WITHIN_S])
        rows = np.flatnonzero(np.isin(sightings.time_s, chosen))
        instant = np.searchsorted(chosen, sightings.time_s[rows])
        covered = np.zeros((len(chosen), len(self._low)))
        np.add.at(covered, instant, self._covered(sightings.box[rows].astype(np.float64)).T)
        # At an instant without a detection nothing is occluded.
        return float((covered > _OCCLUDED_COVER).mean(axis=1).sum() / max(len(instants), 1))

    def _covered(self, boxes: Array) -> Array:
        """Share of each virtual car that each nearer box covers, shape (cars, boxes)."""
        low = np.maximum(self._low[:, None], boxes[None, :, :2])
        high = np.minimum(self._high[:, None], boxes[None, :, 2:])
        both = np.prod(np.clip(high - low, 0.0, None), axis=2)
        size = self._high - self._low
        edge = self._high[:, 1] + _NEARER_SHARE * size[:, 1]
        nearer = boxes[None, :, 3] > edge[:, None]
        return np.asarray(both * nearer / np.prod(size, axis=1)[:, None])


def correct_for_occlusion(
    seen: KinematicFeatures,
    occluded_share: float,
    allowances: OcclusionCorrections = OCCLUSION_CORRECTIONS,
) -> KinematicFeatures:
    """The features of all vehicles, from those of the visible ones and the share of the segment
    that is hidden.
    """
    ratio = occlusion_ratio(occluded_share)
    changed: dict[str, Estimate] = {}
    for name, scale in feature_scales(seen).items():
        estimate: Estimate | None = getattr(seen, name)
        if estimate is None:
            continue
        allowance = allowances[name]
        value = estimate.value + allowance.bias * ratio * scale
        if name != "mean_acceleration_mps2":
            value = max(0.0, value)
        spread = hypot(allowance.share, allowance.growth * ratio) * scale
        error = hypot(estimate.standard_error or 0.0, spread)
        changed[name] = Estimate(value=value, standard_error=error)
    return replace(seen, **changed)


def occlusion_ratio(occluded_share: float) -> float:
    """Occluded over visible road; bounded, as if some road were always visible."""
    share = min(occluded_share, _MAX_OCCLUDED_SHARE)
    return share / (1 - share)


def feature_scales(seen: KinematicFeatures) -> dict[str, float]:
    """The scale of each feature's error: the vehicles' spread, or the feature itself."""
    gap = seen.mean_gap_m
    return {
        "mean_speed_mps": seen.speed_std_mps.value,
        "mean_acceleration_mps2": sqrt(seen.acceleration_variance_m2ps4.value),
        "density_veh_per_m": seen.density_veh_per_m.value,
        "speed_std_mps": seen.speed_std_mps.value,
        "acceleration_variance_m2ps4": seen.acceleration_variance_m2ps4.value,
        "mean_gap_m": 0.0 if gap is None else gap.value,
    }
