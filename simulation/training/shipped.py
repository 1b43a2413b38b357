"""Runs the exported OpenVINO model on the held-out pictures, as the edge daemon would."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.streetdrive.painter import Image
from simulation.training.metrics import Boxes, Figures, Floats, evaluate
from simulation.training.scenes import HELD_OUT, IMAGE_HEIGHT, IMAGE_WIDTH

_SCORE, _IOU, _MOST = 0.001, 0.7, 300
_GREY = 114


def letterbox(image: Image, height: int, width: int) -> tuple[NDArray[np.float32], float, float]:
    """Network input (1, 3, height, width) in RGB 0..1, the scale, and the upper bar's rows.

    The picture keeps its aspect; grey bars fill up above and below.
    """
    scale = min(width / image.shape[1], height / image.shape[0])
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    small = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR) if scale != 1 else image
    top, left = (height - size[1]) // 2, (width - size[0]) // 2
    canvas = np.full((height, width, 3), _GREY, dtype=np.uint8)
    canvas[top : top + size[1], left : left + size[0]] = small
    planes = canvas[..., ::-1].transpose(2, 0, 1)[None].astype(np.float32) / np.float32(255)
    return np.ascontiguousarray(planes), scale, float(top)


def decode(output: NDArray[np.float32], scale: float, top: float) -> Boxes:
    """Boxes in picture pixels from the raw output (1, 4 + classes, n), after per-class NMS.

    Rows 0..3 are centre x, centre y, width and height in pixels of the network's input; the rest
    are class scores 0..1.
    """
    rows = output[0].T.astype(np.float64)
    classes = rows[:, 4:].argmax(axis=1)
    scores = rows[np.arange(len(rows)), 4 + classes]
    keep = scores >= _SCORE
    rows, classes, scores = rows[keep], classes[keep], scores[keep]
    corner = rows[:, :2] - rows[:, 2:4] / 2
    boxes = np.column_stack([corner, rows[:, 2:4]])
    chosen = np.asarray(
        cv2.dnn.NMSBoxesBatched(boxes.tolist(), scores.tolist(), classes.tolist(), _SCORE, _IOU),
        dtype=np.int64,
    ).reshape(-1)
    chosen = chosen[np.argsort(-scores[chosen], kind="stable")][:_MOST]
    x1y1 = (boxes[chosen, :2] - np.array([0.0, top])) / scale
    corners = np.column_stack([x1y1, x1y1 + boxes[chosen, 2:] / scale])
    limit = np.array([IMAGE_WIDTH, IMAGE_HEIGHT] * 2)
    return Boxes(np.clip(corners, 0, limit), classes[chosen], scores[chosen])


def read_labels(path: Path) -> Boxes:
    """True boxes of one picture from its YOLO text."""
    rows: Floats = np.loadtxt(path, ndmin=2) if path.stat().st_size else np.empty((0, 5))
    half = rows[:, 3:5] / 2
    size = np.array([IMAGE_WIDTH, IMAGE_HEIGHT])
    corners = np.column_stack([(rows[:, 1:3] - half) * size, (rows[:, 1:3] + half) * size])
    return Boxes(corners, rows[:, 0].astype(np.int64), np.ones(len(rows)))


def openvino_map(
    xml: Path, dataset: Path, classes: int, least_heights_px: Sequence[float] = (0.0,)
) -> list[Figures]:
    """Figures of the exported model on a set's held-out pictures, for each least box height."""
    import openvino

    model = openvino.Core().compile_model(xml, "CPU")
    height, width = (int(n) for n in model.input(0).shape[2:])
    found, true = [], []
    for picture in sorted((dataset / "images" / HELD_OUT).glob("*.png")):
        image = np.asarray(cv2.imread(str(picture)), dtype=np.uint8)
        planes, scale, top = letterbox(image, height, width)
        output = np.asarray(model(planes)[0], dtype=np.float32)
        found.append(decode(output, scale, top))
        true.append(read_labels(dataset / "labels" / HELD_OUT / f"{picture.stem}.txt"))
    return [evaluate(found, true, classes, height) for height in least_heights_px]
