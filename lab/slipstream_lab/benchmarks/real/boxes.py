"""A model's boxes against those that a person drew on real frames."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from edge_daemon.camera import Array
from edge_daemon.detection import Detector
from edge_daemon.detection.protocol import VEHICLE_CLASSES
from edge_daemon.frame import Image
from edge_daemon.sources.clip import FastClip, open_clip
from slipstream.errors import InputError
from slipstream_lab.simulation.training.metrics import box_iou

_COLUMNS: Final = ["frame", "class", "x1", "y1", "x2", "y2"]
_SAME_OVERLAP: Final = 0.5
_HEIGHTS_PX: Final = (0.0, 12.0, 20.0, 40.0, np.inf)


@dataclass(frozen=True)
class BoxLabels:
    """Boxes drawn on some frames of a clip, every vehicle of them. `boxes`: by frame, x1, y1, x2,
    y2 in px, shape (n, 4).
    """

    sha256: str
    boxes: dict[int, Array]


@dataclass(frozen=True)
class BoxScore:
    """Boxes of one range of heights, at an overlap (IoU) of 0.5.

    Attributes:
        recall: share of them that were found; None without any.
        precision: share of those that were drawn; None without any.
    """

    heights: str
    labelled: int
    recall: float | None
    found: int
    precision: float | None


def load_labels(path: Path) -> BoxLabels:
    """Read ``labels/*.csv``: a first line ``# sha256 of the clip``, columns as in `_COLUMNS`.
    Raises InputError: another first line or other columns, an unknown class, no box.
    """
    first, *rest = path.read_text(encoding="utf-8-sig").splitlines()
    sha256 = first.removeprefix("# ").strip()
    if len(sha256) != 64:
        raise InputError(
            path, "no clip is named", "begin with '# ' and the clip's SHA-256", key="1"
        )
    reader = csv.DictReader(rest)
    if reader.fieldnames != _COLUMNS:
        raise InputError(path, "other columns", f"name {','.join(_COLUMNS)}", key="2")
    boxes: dict[int, list[list[float]]] = {}
    for number, row in enumerate(reader, start=3):
        try:
            if row["class"] not in VEHICLE_CLASSES:
                raise ValueError(f"unknown class {row['class']}")
            box = [float(row[name]) for name in _COLUMNS[2:]]
            if not (box[2] > box[0] and box[3] > box[1]):
                raise ValueError("a box without area")
            boxes.setdefault(int(row["frame"]), []).append(box)
        except (TypeError, ValueError) as error:
            raise InputError(path, str(error), "mend the line", key=f"{number}") from None
    if not boxes:
        raise InputError(path, "holds no box", "draw some")
    return BoxLabels(sha256, {frame: np.array(rows) for frame, rows in boxes.items()})


def find_clip(labels: BoxLabels, folder: Path) -> Path | None:
    """The clip that the labels were drawn on, by its contents."""
    for path in sorted(folder.iterdir()):
        if (
            path.suffix.lower() == ".mp4"
            and hashlib.sha256(path.read_bytes()).hexdigest() == labels.sha256
        ):
            return path
    return None


def read_frames(clip: Path, numbers: Sequence[int]) -> dict[int, Image]:
    """Some frames of a clip, by their numbers from 0."""
    wanted = set(numbers)
    frames = FastClip(open_clip(clip, loop=False)).frames()
    return {number: frame.image for number, frame in enumerate(frames) if number in wanted}


def detect(detector: Detector, images: dict[int, Image], score: float) -> dict[int, Array]:
    """The model's boxes with this score at least, by frame."""
    return {
        number: detector.detect(image).boxes_above(score).astype(np.float64)
        for number, image in images.items()
    }


def score_boxes(labelled: dict[int, Array], found: dict[int, Array]) -> list[BoxScore]:
    """Recall by the heights of the drawn boxes, precision by those of the found; all heights last.

    Boxes are paired one to one for the largest sum of overlaps.
    """
    drawn_px, drawn_hit, found_px, found_hit = [], [], [], []
    for frame, boxes in labelled.items():
        others = found.get(frame, np.zeros((0, 4)))
        rows, columns = _pairs(boxes, others)
        drawn_px.append(boxes[:, 3] - boxes[:, 1])
        drawn_hit.append(np.isin(np.arange(len(boxes)), rows))
        found_px.append(others[:, 3] - others[:, 1])
        found_hit.append(np.isin(np.arange(len(others)), columns))
    drawn, hit = np.concatenate(drawn_px), np.concatenate(drawn_hit)
    seen, right = np.concatenate(found_px), np.concatenate(found_hit)
    ranges = [*pairwise(_HEIGHTS_PX), (0.0, np.inf)]
    return [_score(low, high, drawn, hit, seen, right) for low, high in ranges]


def _pairs(boxes: Array, others: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    overlap = np.asarray(box_iou(boxes, others))
    rows, columns = linear_sum_assignment(np.where(overlap >= _SAME_OVERLAP, -overlap, 0.0))
    same = overlap[rows, columns] >= _SAME_OVERLAP
    return rows[same], columns[same]


def _score(
    low: float,
    high: float,
    drawn: Array,
    hit: npt.NDArray[np.bool_],
    seen: Array,
    right: npt.NDArray[np.bool_],
) -> BoxScore:
    of_drawn, of_seen = (drawn >= low) & (drawn < high), (seen >= low) & (seen < high)
    words = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
    return BoxScore(
        "all" if low == 0 and not np.isfinite(high) else words,
        int(of_drawn.sum()),
        float(hit[of_drawn].mean()) if of_drawn.any() else None,
        int(of_seen.sum()),
        float(right[of_seen].mean()) if of_seen.any() else None,
    )
