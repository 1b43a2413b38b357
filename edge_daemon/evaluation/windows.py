"""The features and the flag that a window has in truth."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from edge_daemon.camera import WatchedSegment
from edge_daemon.evaluation.truth import Truth
from edge_daemon.stability import StabilitySettings


@dataclass(frozen=True)
class TrueWindow:
    """What a perfect observer would report of one segment and window.

    Attributes:
        mean_speed_mps: v̄.
        mean_acceleration_mps2: ā.
        density_veh_per_m: ρ.
        speed_std_mps: σ_v.
        acceleration_variance_m2ps4: σ²_a.
        mean_gap_m: Δd̄, None where nobody followed anybody.
        vehicles: different vehicles.
        y_e: the paper's rule on these values.
        near_threshold: whether one of the rule's quantities lies within the band around its
            threshold while the other does not already decide.
    """

    mean_speed_mps: float
    mean_acceleration_mps2: float
    density_veh_per_m: float
    speed_std_mps: float
    acceleration_variance_m2ps4: float
    mean_gap_m: float | None
    vehicles: int
    y_e: Literal[0, 1]
    near_threshold: bool


def true_window(
    truth: Truth,
    segment: WatchedSegment,
    begin_s: float,
    end_s: float,
    rule: StabilitySettings,
    band: float = 0.1,
) -> TrueWindow | None:
    """Features over all vehicles whose middle is in the segment in [begin_s, end_s].

    Args:
        truth: of the clip.
        segment: the watched segment.
        begin_s: media time.
        end_s: media time.
        rule: thresholds of the flag.
        band: relative width around a threshold within which a flag is a matter of luck.

    Returns:
        None if no vehicle was there.
    """
    seen = (truth.time_s >= begin_s - 1e-9) & (truth.time_s <= end_s + 1e-9)
    frames = len(np.unique(truth.frame[seen]))
    inside = truth.take(np.flatnonzero(seen))
    inside = inside.take(segment.contains(inside.centre_m))
    if not len(inside):
        return None
    mean, spread = float(inside.speed_mps.mean()), float(inside.speed_mps.std())
    variance = float(inside.acceleration_mps2.var())
    # Each quantity as a multiple of its threshold: the larger one decides.
    cv = spread / mean if mean > 0 else np.inf
    worst = max(cv / rule.max_speed_cv, variance / rule.max_acceleration_variance_m2ps4)
    return TrueWindow(
        mean,
        float(inside.acceleration_mps2.mean()),
        len(inside) / (frames * segment.length_m),
        spread,
        variance,
        _mean_gap(inside, segment),
        len(np.unique(inside.vehicle)),
        1 if worst <= 1 else 0,
        1 - band <= worst <= 1 + band,
    )


def _mean_gap(inside: Truth, segment: WatchedSegment) -> float | None:
    lane, along = segment.lane(inside.centre_m), segment.along(inside.centre_m)
    order = np.lexsort((along, lane, inside.frame))
    gaps = [
        along[ahead] - along[behind] - (inside.length_m[ahead] + inside.length_m[behind]) / 2
        for behind, ahead in pairwise(order)
        if inside.frame[behind] == inside.frame[ahead] and lane[behind] == lane[ahead]
    ]
    return float(np.mean(gaps)) if gaps else None
