"""What a detector finds of the hand-made boxes of real cameras, as the edge daemon runs it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from edge_daemon.detection import open_detector
from edge_daemon.detection.protocol import MIN_SCORE
from edge_daemon.settings import DetectorSettings
from edge_daemon.tracking import HIGH_SCORE
from slipstream_lab.simulation.training.distillation.sources import RealCamera
from slipstream_lab.simulation.training.metrics import Boxes, judge

JUDGED_HEIGHT_PX: Final = 16.0
"""Least height of boxes that are judged, px of a picture 640 px wide."""
_WIDTH: Final = 640
_SAME_IOU: Final = 0.5


@dataclass(frozen=True)
class RealFigures:
    """Boxes of vehicles of any class, at an overlap (IoU) of 0.5.

    Attributes:
        labelled: hand-made boxes.
        found: boxes of the detector.
        right: of both, those that are the same.
    """

    score: float
    labelled: int
    found: int
    right: int

    @property
    def recall(self) -> float | None:
        """Share of the hand-made boxes that is found; None without any."""
        return self.right / self.labelled if self.labelled else None

    @property
    def precision(self) -> float | None:
        """Share of the found boxes that is hand-made; None without any."""
        return self.right / self.found if self.found else None


def judge_cameras(
    model: Path,
    cameras: Iterable[RealCamera],
    scores: Sequence[float] = (HIGH_SCORE, MIN_SCORE),
    threads: int = 0,
) -> dict[str, tuple[RealFigures, ...]]:
    """Figures for each score, by the name of each camera that has labels. Raises InputError: the
    model, a picture or its labels are unreadable.
    """
    detector = open_detector(DetectorSettings(model=str(model), threads=threads))
    result = {}
    for camera in cameras:
        if camera.labels is None:
            continue
        pairs = []
        for image, boxes in camera.pictures():
            unit = _WIDTH / image.shape[1]
            answer = detector.detect(image)
            none = np.zeros(len(answer), dtype=np.int64)
            found = Boxes(
                answer.boxes.astype(np.float64) * unit, none, answer.scores.astype(np.float64)
            )
            if boxes is not None:
                pairs.append((found, boxes.corners * unit))
        result[camera.name] = tuple(_figures(pairs, score) for score in scores)
    return result


def _figures(pairs: Sequence[tuple[Boxes, np.ndarray]], score: float) -> RealFigures:
    labelled = found = right = 0
    for answer, true in pairs:
        order = np.argsort(-answer.scores, kind="stable")
        order = order[answer.scores[order] >= score]
        counts, hit = judge(answer.corners[order], true, _SAME_IOU, JUDGED_HEIGHT_PX)
        labelled += int((true[:, 3] - true[:, 1] >= JUDGED_HEIGHT_PX).sum())
        found += int(counts.sum())
        right += int(hit.sum())
    return RealFigures(score, labelled, found, right)
