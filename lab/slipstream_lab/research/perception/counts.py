"""Counted vehicles of a clip against its truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, get_args

import numpy as np

from edge_daemon.camera import Camera, WatchedSegment
from edge_daemon.detection import VEHICLE_CLASSES
from slipstream.messages import CountedClass, SegmentCounts
from slipstream_lab.simulation.ground_truth import Truth

CLASSES: Final[tuple[CountedClass, ...]] = get_args(CountedClass)
_MPS_TO_KMH: Final = 3.6
_SURE: Final = 1.96
_QUANTILE: Final = 0.85


@dataclass(frozen=True)
class TruePassage:
    """A vehicle whose middle passed the middle of a watched segment.

    Attributes:
        time_s: media time.
        kind: index into `VEHICLE_CLASSES`; -1: not known.
    """

    time_s: float
    kind: int
    speed_mps: float


@dataclass(frozen=True)
class CountScore:
    """Counts over one or more segments and clips beside the truth.

    Attributes:
        true, counted: vehicles.
        by_class: both, by class.
        covered_95: share of the segments whose true number lies within ± 1.96 standard errors.
        segments: their number.
        mean_error_kmh: mean absolute error of the mean speed; None: none was measured.
        v85_error_kmh: the same of the 85th percentile.
    """

    true: int
    counted: int
    by_class: dict[CountedClass, tuple[int, int]]
    covered_95: float | None
    segments: int
    mean_error_kmh: float | None
    v85_error_kmh: float | None

    @property
    def error(self) -> float | None:
        """Relative error of the number of vehicles; None: there was none."""
        return (self.counted - self.true) / self.true if self.true else None

    @property
    def class_errors(self) -> dict[CountedClass, float]:
        """The same of each class that there was."""
        return {
            name: (counted - true) / true for name, (true, counted) in self.by_class.items() if true
        }


def true_passages(truth: Truth, segment: WatchedSegment) -> list[TruePassage]:
    """Who passed, in order of time; on the segment, and each once."""
    place_m = segment.begin_m + segment.length_m / 2
    along, inside = segment.along(truth.centre_m), segment.contains(truth.centre_m)
    found = []
    order = np.lexsort((truth.time_s, truth.vehicle))
    vehicles, begins = np.unique(truth.vehicle[order], return_index=True)
    for rows in np.split(order, begins[1:]) if len(vehicles) else ():
        passed = np.flatnonzero((along[rows[:-1]] <= place_m) & (along[rows[1:]] > place_m))
        if not len(passed):
            continue
        before, after = rows[passed[0]], rows[passed[0] + 1]
        if inside[before] or inside[after]:
            share = (place_m - along[before]) / (along[after] - along[before])
            time_s = truth.time_s[before] + share * (truth.time_s[after] - truth.time_s[before])
            found.append(
                TruePassage(float(time_s), int(truth.kind[before]), float(truth.speed_mps[before]))
            )
    return sorted(found, key=lambda passage: passage.time_s)


def compare_counts(
    counts: Iterable[SegmentCounts], truth: Truth, camera: Camera
) -> list[tuple[SegmentCounts, list[TruePassage]]]:
    """The counts of each segment beside who passed on it while they run."""
    segments = {segment.id: segment for segment in camera.segments}
    found = []
    for told in counts:
        begin_s, end_s = told.began_ns / 1e9, told.until_ns / 1e9
        every = true_passages(truth, segments[told.segment])
        found.append((told, [one for one in every if begin_s <= one.time_s < end_s]))
    return found


def score_counts(pairs: Sequence[tuple[SegmentCounts, Sequence[TruePassage]]]) -> CountScore:
    """The figures over all of them."""
    by_class = {}
    for kind, name in enumerate(VEHICLE_CLASSES):
        true = sum(one.kind == kind for _, passages in pairs for one in passages)
        counted = sum(
            one.vehicles.value
            for told, _ in pairs
            for one in told.classes
            if one.vehicle_class == name
        )
        by_class[CLASSES[kind]] = true, round(counted)
    covered = [
        abs(told.vehicles.value - len(passages)) <= _SURE * (told.vehicles.standard_error or 0.0)
        for told, passages in pairs
    ]
    means, v85s = [], []
    for told, passages in pairs:
        speeds = [one.speed_mps for one in passages]
        if speeds and told.mean_speed_mps is not None:
            means.append(abs(told.mean_speed_mps.value - float(np.mean(speeds))))
        if speeds and told.v85_mps is not None:
            v85s.append(abs(told.v85_mps.value - float(np.quantile(speeds, _QUANTILE))))
    return CountScore(
        true=sum(len(passages) for _, passages in pairs),
        counted=round(sum(told.vehicles.value for told, _ in pairs)),
        by_class=by_class,
        covered_95=float(np.mean(covered)) if covered else None,
        segments=len(pairs),
        mean_error_kmh=_MPS_TO_KMH * float(np.mean(means)) if means else None,
        v85_error_kmh=_MPS_TO_KMH * float(np.mean(v85s)) if v85s else None,
    )
