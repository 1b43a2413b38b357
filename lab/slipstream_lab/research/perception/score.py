"""Tracks and states of a clip against its truth: the figures of `slipstream track --truth`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from edge_daemon.camera import Array, Camera, WatchedSegment
from edge_daemon.detection import VEHICLE_CLASSES
from edge_daemon.features.stability import MIN_COVERAGE
from edge_daemon.offline import Recorder
from edge_daemon.settings import StabilitySettings
from edge_daemon.tracking import Sightings
from slipstream.messages import SegmentState
from slipstream_lab.research.perception.identity import FrameIdentities, hota, idf1
from slipstream_lab.simulation.ground_truth import TrueWindow, Truth, true_window
from slipstream_lab.simulation.training.metrics import box_iou

_MPS_TO_KMH: Final = 3.6
_SAME_OVERLAP: Final = 0.5
_MIN_VISIBLE: Final = 0.4
_MANY_VEHICLES: Final = 8
_ROUNDING_S: Final = 0.02
_IDS_A_CLIP: Final = 10_000_000
_FEATURES: Final = (
    "mean_speed_mps",
    "mean_acceleration_mps2",
    "density_veh_per_m",
    "speed_std_mps",
    "acceleration_variance_m2ps4",
    "mean_gap_m",
)


@dataclass(frozen=True)
class FeatureScore:
    """How one feature compares over the windows. `covered_95`: share of true values within ± 1.96
    standard errors.
    """

    mean_abs_error: float
    bias: float
    covered_95: float | None
    windows: int


@dataclass(frozen=True)
class ClassScore:
    """How well the vehicles of one class are followed. `followed`: share of their true boxes that
    a track has; which boxes: see `Scores`.
    """

    vehicles: int
    followed: float
    speed_mae_kmh: float | None
    speeds: int


@dataclass(frozen=True)
class Scores:
    """The figures; None where nothing could be compared.

    Speeds are smoothed with data of one more second. Identities are compared for vehicles whose
    middle is in a watched segment and of which at least 40 % are visible. A window counts when it
    is covered; the variance's error where at least 8 vehicles were in it; y_e where it is known.
    """

    speed_mae_kmh: float | None
    speed_p95_kmh: float | None
    speed_covered_95: float | None
    speeds: int
    acceleration_variance_abs_error: float | None
    acceleration_variance_windows: int
    y_e_agreement: float | None
    y_e_agreement_outside_band: float | None
    y_e_known: float | None
    y_e_windows: int
    y_e_windows_outside_band: int
    idf1: float | None
    hota: float | None
    features: dict[str, FeatureScore]
    classes: dict[str, ClassScore]


@dataclass(frozen=True)
class TrueBoxes:
    """The true boxes that a tracker should have.

    Attributes:
        vehicle: identity, shape (n,).
        kind: index into `VEHICLE_CLASSES`, -1 where it is not known, shape (n,).
        followed: whether a track has it, shape (n,).
    """

    vehicle: npt.NDArray[np.int64]
    kind: npt.NDArray[np.int64]
    followed: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class TrackComparison:
    """One clip's recording matched with its truth.

    Attributes:
        speed_errors_mps: estimate less truth, shape (n,).
        speed_covered: whether the truth lies within ± 1.96 standard errors, shape (n,).
        speed_kind: the vehicle's index into `VEHICLE_CLASSES`, or -1, shape (n,).
    """

    frames: list[FrameIdentities]
    boxes: TrueBoxes
    speed_errors_mps: Array
    speed_covered: npt.NDArray[np.bool_]
    speed_kind: npt.NDArray[np.int64]
    windows: list[tuple[SegmentState, TrueWindow]]


def compare(
    recorder: Recorder, truth: Truth, camera: Camera, rule: StabilitySettings
) -> TrackComparison:
    """Match a recording with the truth of the same clip."""
    frames, owners, boxes = _match(recorder, truth, camera)
    errors, covered, kinds = _speed_errors(recorder, truth, owners)
    windows = true_windows(recorder, truth, camera, rule, MIN_COVERAGE)
    return TrackComparison(frames, boxes, errors, covered, kinds, windows)


def score(comparisons: Sequence[TrackComparison]) -> Scores:
    """The figures over all speeds, windows and frames of one or more clips."""
    errors = np.concatenate([np.zeros(0), *(c.speed_errors_mps for c in comparisons)])
    covered = np.concatenate([np.zeros(0, np.bool_), *(c.speed_covered for c in comparisons)])
    windows = [window for c in comparisons for window in c.windows]
    frames = _with_distinct_ids([c.frames for c in comparisons])
    many = [
        abs(s.features.acceleration_variance_m2ps4.value - t.acceleration_variance_m2ps4)
        for s, t in windows
        if s.features is not None and min(s.vehicles, t.vehicles) >= _MANY_VEHICLES
    ]
    flags = [(s, t) for s, t in windows if s.y_e is not None]
    outside = [(s, t) for s, t in flags if not t.near_threshold]
    return Scores(
        speed_mae_kmh=_mean(np.abs(errors) * _MPS_TO_KMH),
        speed_p95_kmh=(
            float(np.percentile(np.abs(errors), 95)) * _MPS_TO_KMH if len(errors) else None
        ),
        speed_covered_95=_mean(covered),
        speeds=len(errors),
        acceleration_variance_abs_error=_mean(many),
        acceleration_variance_windows=len(many),
        y_e_agreement=_mean([s.y_e == t.y_e for s, t in flags]),
        y_e_agreement_outside_band=_mean([s.y_e == t.y_e for s, t in outside]),
        y_e_known=len(flags) / len(windows) if windows else None,
        y_e_windows=len(flags),
        y_e_windows_outside_band=len(outside),
        idf1=idf1(frames),
        hota=hota(frames),
        features={
            name: scored for name in _FEATURES if (scored := _feature(name, windows)) is not None
        },
        classes={
            name: figures
            for kind, name in enumerate(VEHICLE_CLASSES)
            if (figures := _class(kind, comparisons)) is not None
        },
    )


def _class(kind: int, comparisons: Sequence[TrackComparison]) -> ClassScore | None:
    followed, errors, vehicles = [], [], 0
    for comparison in comparisons:
        of_class = comparison.boxes.kind == kind
        followed.append(comparison.boxes.followed[of_class])
        vehicles += len(np.unique(comparison.boxes.vehicle[of_class]))
        errors.append(comparison.speed_errors_mps[comparison.speed_kind == kind])
    if vehicles == 0:
        return None
    speeds = np.abs(np.concatenate(errors)) * _MPS_TO_KMH
    return ClassScore(vehicles, float(np.concatenate(followed).mean()), _mean(speeds), len(speeds))


def _with_distinct_ids(clips: Sequence[list[FrameIdentities]]) -> list[FrameIdentities]:
    """Frames of several clips with distinct identities."""
    return [
        FrameIdentities(f.true + k * _IDS_A_CLIP, f.found + k * _IDS_A_CLIP, f.overlap)
        for k, frames in enumerate(clips)
        for f in frames
    ]


def _mean(values: Array | npt.NDArray[np.bool_] | Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _match(
    recorder: Recorder, truth: Truth, camera: Camera
) -> tuple[list[FrameIdentities], dict[tuple[int, int], int], TrueBoxes]:
    """Identities by frame, by (track, frame) the true vehicle under the track's box, and the true
    boxes that were to be followed.
    """
    times = np.array(recorder.frame_times_s)
    everything = Sightings.join(recorder.sightings)
    # Those from before a track was confirmed came later: back to the frames they were seen in.
    everything = everything.take(np.argsort(everything.time_s, kind="stable"))
    places = np.searchsorted(everything.time_s, [*times, np.inf])
    frames: list[FrameIdentities] = []
    owners: dict[tuple[int, int], int] = {}
    none = truth.take(np.arange(0))
    boxes = [(none.vehicle, none.kind, np.zeros(0, dtype=np.bool_))]
    for i, true in enumerate(truth.at(times)):
        seen = everything.take(slice(places[i], places[i + 1]))
        wanted = _in_segments(true.centre_m, camera) & (true.visible >= _MIN_VISIBLE)
        followed = np.zeros(len(true), dtype=np.bool_)
        overlap = box_iou(true.box_px, seen.box.astype(np.float64))
        counts = _in_segments(seen.point_m, camera)
        for row, column in zip(*linear_sum_assignment(overlap, maximize=True), strict=True):
            if overlap[row, column] >= _SAME_OVERLAP:
                owners[int(seen.track[column]), i] = int(true.vehicle[row])
                followed[row] = True
                # On a vehicle outside, or one hidden: neither asked for nor held against.
                counts[column] = wanted[row]
        frames.append(
            FrameIdentities(
                true.vehicle[wanted], seen.track[counts], overlap[np.ix_(wanted, counts)]
            )
        )
        boxes.append((true.vehicle[wanted], true.kind[wanted], followed[wanted]))
    return frames, owners, TrueBoxes(*(np.concatenate(part) for part in zip(*boxes, strict=True)))


def _in_segments(points_m: Array, camera: Camera) -> npt.NDArray[np.bool_]:
    inside = np.zeros(len(points_m), dtype=np.bool_)
    for segment in camera.segments:
        inside |= segment.contains(points_m)
    return inside


def _speed_errors(
    recorder: Recorder, truth: Truth, owners: dict[tuple[int, int], int]
) -> tuple[Array, npt.NDArray[np.bool_], npt.NDArray[np.int64]]:
    """Errors, whether the truth lies in the interval, and the vehicle's class."""
    times = np.array(recorder.frame_times_s)
    motions = {
        int(vehicle): truth.take(np.flatnonzero(truth.vehicle == vehicle))
        for vehicle in np.unique(truth.vehicle)
    }
    errors, covered, kinds = [], [], []
    for track, time_s, speed, deviation in recorder.speeds:
        owner = owners.get((track, int(np.abs(times - time_s).argmin())))
        if owner is None:
            continue
        motion = motions[owner]
        error = speed - float(np.interp(time_s, motion.time_s, motion.speed_mps))
        errors.append(error)
        covered.append(abs(error) <= 1.96 * deviation)
        kinds.append(motion.kind[0])
    return (
        np.array(errors),
        np.array(covered, dtype=np.bool_),
        np.array(kinds, dtype=np.int64),
    )


def true_windows(
    recorder: Recorder,
    truth: Truth,
    camera: Camera,
    rule: StabilitySettings,
    min_coverage: float | None = None,
) -> list[tuple[SegmentState, TrueWindow]]:
    """States with what was true in their windows, where that was enough vehicles for a flag.

    Args:
        min_coverage: of a state's window; None: of all windows that lie in the clip, those too that
            a camera's fault has emptied.
    """
    segments: dict[str, WatchedSegment] = {s.id: s for s in camera.segments}
    pairs = []
    for time_s, state in recorder.states:
        begins_s = time_s - state.window_s
        if begins_s < -_ROUNDING_S if min_coverage is None else state.coverage < min_coverage:
            continue
        true = true_window(truth, segments[state.segment], begins_s, time_s, rule)
        if true is not None and true.vehicles >= rule.min_vehicles:
            pairs.append((state, true))
    return pairs


def _feature(name: str, windows: Sequence[tuple[SegmentState, TrueWindow]]) -> FeatureScore | None:
    errors, covered = [], []
    for state, true in windows:
        estimate = getattr(state.features, name, None)
        value = getattr(true, name)
        if estimate is None or value is None:
            continue
        errors.append(estimate.value - value)
        if estimate.standard_error is not None:
            covered.append(abs(errors[-1]) <= 1.96 * estimate.standard_error)
    if not errors:
        return None
    return FeatureScore(
        float(np.mean(np.abs(errors))), float(np.mean(errors)), _mean(covered), len(errors)
    )
