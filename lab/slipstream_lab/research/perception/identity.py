"""Identity metrics: IDF1 and HOTA over the frames of a clip.

IDF1: Ristani et al., ECCV workshops 2016. HOTA: Luiten et al., IJCV 129 (2021), the mean over the
localisation thresholds 0.05, 0.10, …, 0.95.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from edge_daemon.camera import Array

Ids = npt.NDArray[np.int64]

IDF1_OVERLAP: Final = 0.5
HOTA_OVERLAPS: Final = tuple(round(0.05 * i, 2) for i in range(1, 20))


@dataclass(frozen=True)
class FrameIdentities:
    """Identities and boxes in one frame.

    Attributes:
        true: identities of the true boxes, shape (n,).
        found: identities of the tracked boxes, shape (m,).
        overlap: intersection over union of their boxes, shape (n, m).
    """

    true: Ids
    found: Ids
    overlap: Array


def idf1(frames: Sequence[FrameIdentities], min_overlap: float = IDF1_OVERLAP) -> float | None:
    """Share of boxes with the right identity under the best one-to-one map of identities.

    2 IDTP / (true boxes + tracked boxes); None where there are neither.
    """
    true, found = _all_ids(frames)
    together = np.zeros((len(true), len(found)))
    boxes = 0
    for frame in frames:
        boxes += len(frame.true) + len(frame.found)
        rows, columns = np.nonzero(frame.overlap >= min_overlap)
        np.add.at(
            together,
            (np.searchsorted(true, frame.true[rows]), np.searchsorted(found, frame.found[columns])),
            1,
        )
    if boxes == 0:
        return None
    best = linear_sum_assignment(together, maximize=True)
    return float(2 * together[best].sum() / boxes)


def hota(frames: Sequence[FrameIdentities]) -> float | None:
    """Geometric mean of detection and association accuracy, averaged over the thresholds."""
    true, found = _all_ids(frames)
    if not len(true) and not len(found):
        return None
    places = [
        (np.searchsorted(true, f.true), np.searchsorted(found, f.found), f.overlap) for f in frames
    ]
    true_boxes, found_boxes = np.zeros(len(true)), np.zeros(len(found))
    likely = np.zeros((len(true), len(found)))
    for rows, columns, overlap in places:
        true_boxes[rows] += 1
        found_boxes[columns] += 1
        norm = overlap.sum(axis=0)[None] + overlap.sum(axis=1)[:, None] - overlap
        likely[np.ix_(rows, columns)] += np.divide(
            overlap, norm, out=np.zeros_like(overlap), where=norm > 0
        )
    either = true_boxes[:, None] + found_boxes[None]
    alignment = likely / np.maximum(either - likely, 1e-9)
    scores = [_hota_at(places, alignment, either, threshold) for threshold in HOTA_OVERLAPS]
    return float(np.mean(scores))


def _hota_at(
    places: Sequence[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Array]],
    alignment: Array,
    either: Array,
    threshold: float,
) -> float:
    matches = np.zeros_like(alignment)
    missed = extra = hits = 0
    for rows, columns, overlap in places:
        # Identities that go together over the clip are preferred; overlap decides between equals.
        score = (alignment[np.ix_(rows, columns)] + 1e-6 * overlap) * (overlap >= threshold)
        chosen = linear_sum_assignment(score, maximize=True)
        good = overlap[chosen] >= threshold
        matches[rows[chosen[0][good]], columns[chosen[1][good]]] += 1
        hits += int(good.sum())
        missed += len(rows) - int(good.sum())
        extra += len(columns) - int(good.sum())
    if hits == 0:
        return 0.0
    association = float((matches * matches / np.maximum(either - matches, 1)).sum()) / hits
    return float(np.sqrt(hits / (hits + missed + extra) * association))


def _all_ids(frames: Sequence[FrameIdentities]) -> tuple[Ids, Ids]:
    empty = np.zeros(0, dtype=np.int64)
    return (
        np.unique(np.concatenate([empty, *(f.true for f in frames)])),
        np.unique(np.concatenate([empty, *(f.found for f in frames)])),
    )
