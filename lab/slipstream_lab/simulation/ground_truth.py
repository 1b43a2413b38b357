"""Ground truth: where each vehicle is and how it moves, and the features and flag of a window."""

from __future__ import annotations

import csv
from array import array
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.detection import VEHICLE_CLASSES
from edge_daemon.settings import StabilitySettings
from slipstream.errors import InputError
from slipstream.files import check_file

_MAX_BYTES: Final = 512_000_000

_COLUMNS: Final = (
    "frame",
    "time_s",
    "vehicle_id",
    "x_m",
    "y_m",
    "speed_mps",
    "acceleration_mps2",
    "x1_px",
    "y1_px",
    "x2_px",
    "y2_px",
    "visible_fraction",
    "length_m",
)
_ROUNDING_S: Final = 2e-3
"""Containers round time stamps, to milliseconds at most."""
_MAX_STEPS: Final = 1.5
_KINDS: Final = {name: index for index, name in enumerate(VEHICLE_CLASSES)}


@dataclass(frozen=True)
class Truth:
    """One row a vehicle and frame, in the order of frames.

    Attributes:
        frame: number of the frame, shape (n,).
        time_s: media time, shape (n,).
        vehicle: identity, shape (n,).
        centre_m: middle of the vehicle on the road plane, m, shape (n, 2).
        speed_mps: along its lane, shape (n,).
        acceleration_mps2: along its lane, shape (n,).
        box_px: x1, y1, x2, y2, shape (n, 4).
        visible: share of it that is in the picture and not hidden, shape (n,).
        length_m: shape (n,).
        kind: index into `VEHICLE_CLASSES`, shape (n,); -1: not known.
    """

    frame: npt.NDArray[np.int64]
    time_s: Array
    vehicle: npt.NDArray[np.int64]
    centre_m: Array
    speed_mps: Array
    acceleration_mps2: Array
    box_px: Array
    visible: Array
    length_m: Array
    kind: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> Truth:
        """Some of the rows."""
        return Truth(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def at(self, times_s: Array) -> list[Truth]:
        """The vehicles at each of some media times, whatever frames a clip has of it.

        Between two frames of the truth they are interpolated. Where the truth has none so near,
        there is no vehicle.
        """
        own_s, begins = np.unique(self.time_s, return_index=True)
        ends = np.append(begins[1:], len(self))
        usual_s = float(np.median(np.diff(own_s))) if len(own_s) > 1 else _ROUNDING_S

        def frame(number: int) -> Truth:
            exists = 0 <= number < len(own_s)
            return self.take(np.arange(begins[number], ends[number]) if exists else np.arange(0))

        found = []
        for time_s in times_s:
            after = int(np.searchsorted(own_s, time_s))
            around = own_s[max(0, after - 1) : after + 1]
            apart_s = np.abs(around - time_s)
            nearest = max(0, after - 1) + int(apart_s.argmin()) if len(around) else -1
            if len(around) == 2 and apart_s.min() > _ROUNDING_S:
                before, behind = frame(after - 1), frame(after)
                if _follow(before, behind, usual_s):
                    found.append(_between(before, behind, float(time_s)))
                    continue
            is_near = len(around) > 0 and apart_s.min() <= max(_ROUNDING_S, usual_s / 2)
            found.append(frame(nearest if is_near else -1))
        return found


def load_truth(path: Path) -> Truth:
    """Read a ``truth.csv`` as `slipstream clip` writes it; other columns are ignored, and that of
    classes may be missing.

    Raises:
        InputError: it cannot be read, a column is missing, or a value is no number.
    """
    check_file(path, _MAX_BYTES)
    table = array("d")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise InputError(
                    path, "no such column", "give a truth.csv of `slipstream clip`", key=missing[0]
                )
            for row in reader:
                table.extend(float(row[name]) for name in _COLUMNS)
                table.append(_KINDS.get(row.get("class") or "", -1))
    except UnicodeDecodeError:
        raise InputError(path, "not UTF-8", "save it as UTF-8") from None
    except (OSError, csv.Error) as error:
        raise InputError(path, f"cannot be read ({error})", "give a CSV file") from None
    except (ValueError, TypeError):
        raise InputError(path, "a value is no number", "give a complete CSV file") from None
    values: Array = np.array(table).reshape(-1, len(_COLUMNS) + 1)
    # Numbers of frames and vehicles become integers.
    if not (np.abs(values) < 2**53).all():
        raise InputError(path, "a value is not finite", "give a complete CSV file")
    return _truth(values[np.argsort(values[:, 0], kind="stable")])


def _truth(table: Array) -> Truth:
    return Truth(
        table[:, 0].astype(np.int64),
        table[:, 1],
        table[:, 2].astype(np.int64),
        table[:, 3:5],
        table[:, 5],
        table[:, 6],
        table[:, 7:11],
        table[:, 11],
        table[:, 12],
        table[:, 13].astype(np.int64),
    )


def _follow(before: Truth, after: Truth, usual_s: float) -> bool:
    """Whether no frame lies between two: one without vehicles has no row."""
    step_s = after.time_s[0] - before.time_s[0]
    return bool(after.frame[0] - before.frame[0] == 1 or step_s <= _MAX_STEPS * usual_s)


def _between(before: Truth, after: Truth, time_s: float) -> Truth:
    """The vehicles that are in both of two frames, at a time between them."""
    _, first, second = np.intersect1d(before.vehicle, after.vehicle, return_indices=True)
    before, after = before.take(first), after.take(second)
    share = (time_s - before.time_s) / (after.time_s - before.time_s)

    def mixed(here: Array, there: Array) -> Array:
        return np.asarray(here + (share if here.ndim == 1 else share[:, None]) * (there - here))

    return replace(
        before,
        time_s=mixed(before.time_s, after.time_s),
        centre_m=mixed(before.centre_m, after.centre_m),
        speed_mps=mixed(before.speed_mps, after.speed_mps),
        acceleration_mps2=mixed(before.acceleration_mps2, after.acceleration_mps2),
        box_px=mixed(before.box_px, after.box_px),
        visible=mixed(before.visible, after.visible),
        length_m=mixed(before.length_m, after.length_m),
    )


@dataclass(frozen=True)
class TrueWindow:
    """What a perfect observer would report of one segment and window.

    Attributes:
        mean_gap_m: Δd̄, None where nobody followed anybody.
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
    """Features over all vehicles whose middle is in the segment in [begin_s, end_s]. `band`:
    relative width around a threshold within which a flag is a matter of luck.
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
