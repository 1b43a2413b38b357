"""Measured speeds against the gates', by BrnoCompSpeed's rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from edge_daemon.camera import Array
from slipstream_lab.benchmarks.real.brno import Passage
from slipstream_lab.benchmarks.real.speeds import VehicleSpeed

_MAX_APART_S: Final = 0.2
_SURE: Final = 1.96


@dataclass(frozen=True)
class Matched:
    """Speeds of one or more recordings beside the truth.

    Attributes:
        true_kmh: of the valid passages that were matched, shape (n,).
        speed_kmh: measured, shape (n,).
        error_kmh: its standard error, shape (n,).
    """

    true_kmh: Array
    speed_kmh: Array
    error_kmh: Array
    passages: int
    unmatched: int

    def higher(self, share: float, spread: float) -> Matched:
        """The same where the tracked points stand higher over the road than it was taken."""
        speed = self.speed_kmh * (1 - share)
        return replace(
            self, speed_kmh=speed, error_kmh=np.hypot(self.error_kmh, spread * self.speed_kmh)
        )

    @staticmethod
    def join(parts: Sequence[Matched]) -> Matched:
        """All of the parts; there must be one part at least."""
        return Matched(
            true_kmh=np.concatenate([part.true_kmh for part in parts]),
            speed_kmh=np.concatenate([part.speed_kmh for part in parts]),
            error_kmh=np.concatenate([part.error_kmh for part in parts]),
            passages=sum(part.passages for part in parts),
            unmatched=sum(part.unmatched for part in parts),
        )


@dataclass(frozen=True)
class SpeedFigures:
    """What the rules ask for. `in_interval`: share of true speeds inside the 95 % interval."""

    matched: int
    bias_percent: float
    scatter_kmh: float
    median_kmh: float
    mean_kmh: float
    p95_kmh: float
    worst_kmh: float
    median_percent: float
    mean_percent: float
    in_interval: float
    recall: float
    precision: float


def match(passages: Sequence[Passage], measured: Sequence[VehicleSpeed]) -> Matched:
    """Each passage with the vehicle of its lane that crossed the last gate within 0.2 s of it."""
    lanes = np.array([vehicle.lane for vehicle in measured])
    times = np.array([vehicle.end_s for vehicle in measured])
    taken: set[int] = set()
    rows = []
    for passage in passages:
        apart = np.where(lanes == passage.lane, np.abs(times - passage.end_s), np.inf)
        if not len(apart) or apart.min() >= _MAX_APART_S:
            continue
        nearest = int(apart.argmin())
        taken.add(nearest)
        if passage.valid:
            vehicle = measured[nearest]
            rows.append((passage.speed_kmh, vehicle.speed_kmh, vehicle.error_kmh))
    first, last = min(p.end_s for p in passages), max(p.end_s for p in passages)
    unmatched = sum(
        first <= vehicle.end_s < last and number not in taken
        for number, vehicle in enumerate(measured)
    )
    true_kmh, speed_kmh, error_kmh = np.array(rows).reshape(-1, 3).T
    valid = sum(passage.valid for passage in passages)
    return Matched(true_kmh, speed_kmh, error_kmh, valid, unmatched)


def figures(matched: Matched) -> SpeedFigures | None:
    """The figures; None where nothing was matched."""
    if not len(matched.true_kmh):
        return None
    off = matched.speed_kmh - matched.true_kmh
    error, share = np.abs(off), np.abs(off) / matched.true_kmh
    count, bias = len(off), float(np.median(off / matched.true_kmh))
    return SpeedFigures(
        count,
        100 * bias,
        float(np.median(np.abs(off - bias * matched.true_kmh))),
        float(np.median(error)),
        float(error.mean()),
        float(np.percentile(error, 95)),
        float(error.max()),
        100 * float(np.median(share)),
        100 * float(share.mean()),
        float((error <= _SURE * matched.error_kmh).mean()),
        count / matched.passages,
        count / (count + matched.unmatched),
    )


def point_height_m(cameras: Sequence[tuple[Matched, float]]) -> tuple[float, float]:
    """Height of the tracked points over the road that the true speeds speak for, and its spread.

    What stands z over the road, under a camera at h, seems to go faster by z over h − z.

    Args:
        cameras: speeds taken as those of points on the road, and the height of the camera, m.

    Returns:
        Median over the cameras, and the standard deviation between them, m.
    """
    heights = []
    for matched, height_m in cameras:
        ratio = float(np.median(matched.speed_kmh / matched.true_kmh))
        heights.append(height_m * (1 - 1 / ratio))
    return float(np.median(heights)), float(np.std(heights, ddof=1))
