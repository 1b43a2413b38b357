"""Average precision of boxes, by COCO's rule: greedy matching and 101-point interpolation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

IOU_THRESHOLDS = tuple(round(0.5 + 0.05 * i, 2) for i in range(10))


def box_iou(a: Floats, b: Floats) -> Floats:
    """Intersection over union, shape (n, m), of boxes x1, y1, x2, y2, shapes (n, 4) and (m, 4)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    inside = np.prod(np.clip(high - low, 0.0, None), axis=2)
    areas = [np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) for boxes in (a, b)]
    return np.asarray(inside / np.maximum(areas[0][:, None] + areas[1] - inside, 1e-9))


@dataclass(frozen=True)
class Boxes:
    """Boxes of one picture: corners (n, 4) as x1, y1, x2, y2, classes (n,), scores (n,)."""

    corners: Floats
    classes: NDArray[np.int64]
    scores: Floats


def _matches(found: Floats, true: Floats, threshold: float) -> NDArray[np.bool_]:
    """Which found boxes, best score first, take a true box that none before them took."""
    hit = np.zeros(len(found), dtype=np.bool_)
    if not len(true):
        return hit
    overlap = box_iou(found, true)
    free = np.ones(len(true), dtype=np.bool_)
    for i in range(len(found)):
        candidates = np.where(free, overlap[i], -1.0)
        best = int(candidates.argmax())
        if candidates[best] >= threshold:
            free[best] = False
            hit[i] = True
    return hit


def _heights(corners: Floats) -> Floats:
    return np.asarray(corners[:, 3] - corners[:, 1])


def judge(
    found: Floats, true: Floats, threshold: float, min_height_px: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which found boxes count, and which of them are hits, in one picture and class.

    True boxes lower than the bound are neither wanted nor held against an answer that finds them.
    """
    small = _heights(true) < min_height_px
    hit = _matches(found, true[~small], threshold)
    rest = ~hit
    ignored = np.zeros(len(found), dtype=np.bool_)
    ignored[rest] = _matches(found[rest], true[small], threshold)
    ignored[rest] |= _heights(found[rest]) < min_height_px
    return ~ignored, hit


def average_precision(
    found: Sequence[Boxes],
    true: Sequence[Boxes],
    number: int,
    threshold: float,
    min_height_px: float = 0.0,
) -> float:
    """AP of one class over pictures at one IoU threshold; nan where the class never occurs.

    With a least height, lower boxes are left out on both sides, as COCO does with area ranges.
    """
    scores: list[Floats] = []
    hits: list[NDArray[np.bool_]] = []
    total = 0
    for f, t in zip(found, true, strict=True):
        wanted = t.corners[t.classes == number]
        total += int((_heights(wanted) >= min_height_px).sum())
        chosen = f.classes == number
        order = np.argsort(-f.scores[chosen], kind="stable")
        counts, hit = judge(f.corners[chosen][order], wanted, threshold, min_height_px)
        scores.append(f.scores[chosen][order][counts])
        hits.append(hit[counts])
    if total == 0:
        return float("nan")
    order = np.argsort(-np.concatenate(scores), kind="stable")
    hit = np.concatenate(hits)[order]
    recall = np.cumsum(hit) / total
    precision = np.cumsum(hit) / np.arange(1, len(hit) + 1)
    envelope = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    at = np.searchsorted(recall, np.linspace(0, 1, 101), side="left")
    return float(envelope[at].mean())


@dataclass(frozen=True)
class DetectionFigures:
    """Mean average precisions, the AP50 of each class, and how many true boxes each class has."""

    map50: float
    map50_95: float
    ap50: tuple[float, ...]
    boxes: tuple[int, ...]


def evaluate(
    found: Sequence[Boxes], true: Sequence[Boxes], classes: int, min_height_px: float = 0.0
) -> DetectionFigures:
    """mAP50 and mAP50-95 over classes that occur, of boxes with at least this height."""
    table = np.array(
        [
            [average_precision(found, true, c, t, min_height_px) for t in IOU_THRESHOLDS]
            for c in range(classes)
        ]
    )
    counts = tuple(
        sum(int((_heights(t.corners[t.classes == c]) >= min_height_px).sum()) for t in true)
        for c in range(classes)
    )
    return DetectionFigures(
        map50=float(np.nanmean(table[:, 0])),
        map50_95=float(np.nanmean(table)),
        ap50=tuple(float(v) for v in table[:, 0]),
        boxes=counts,
    )
