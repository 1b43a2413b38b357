"""Runs an exported OpenVINO model on labelled pictures, as the edge daemon would."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edge_daemon.detection import VEHICLE_CLASSES
from edge_daemon.detection.placement import Placement, place_static
from edge_daemon.detection.protocol import vehicle_class_of
from edge_daemon.detection.region import Region
from edge_daemon.frame import Image, read_image
from slipstream.errors import InputError
from slipstream_lab.simulation.training.labelled import LabelledSet
from slipstream_lab.simulation.training.metrics import Boxes, DetectionFigures, evaluate

_SCORE, _IOU, _MAX_DETECTIONS = 0.001, 0.7, 300
_GREY = 114


def letterbox(image: Image, shape: tuple[int, int]) -> tuple[NDArray[np.float32], Placement]:
    """Network input (1, 3, height, width) in RGB 0..1, and where the picture lies in it.

    The picture keeps its aspect; grey bars fill up around it.
    """
    size = image.shape[1], image.shape[0]
    placement = place_static(size, Region(0, 0, *size), shape)
    canvas = np.full((*shape, 3), _GREY, dtype=np.uint8)
    fill(canvas, image, placement)
    return to_planes(canvas), placement


def fill(canvas: Image, image: Image, placement: Placement) -> None:
    """Scale a picture's crop into the canvas (height, width, 3)."""
    crop, inner = placement.crop, placement.inner
    part = image[crop.top : crop.bottom, crop.left : crop.right]
    size = inner.width, inner.height
    canvas[inner.top : inner.bottom, inner.left : inner.right] = (
        part
        if size == (crop.width, crop.height)
        else cv2.resize(
            part, size, interpolation=cv2.INTER_AREA if size[0] < crop.width else cv2.INTER_LINEAR
        )
    )


def to_planes(canvas: Image) -> NDArray[np.float32]:
    """A BGR picture as network input: (1, 3, height, width), RGB, 0..1."""
    planes = canvas[..., ::-1].transpose(2, 0, 1)[None].astype(np.float32) / np.float32(255)
    return np.ascontiguousarray(planes)


def decode(
    output: NDArray[np.float32], placement: Placement, vehicle_class: NDArray[np.int64]
) -> Boxes:
    """Boxes in picture pixels from the raw output (1, 4 + classes, n), after per-class NMS.

    Rows 0..3 are centre x, centre y, width and height in pixels of the network's input; the rest
    are class scores 0..1. Classes become indices of VEHICLE_CLASSES; others are left out.
    """
    rows = output[0].T.astype(np.float64)
    best = rows[:, 4:].argmax(axis=1)
    scores = rows[np.arange(len(rows)), 4 + best]
    classes = vehicle_class[best]
    keep = (scores >= _SCORE) & (classes >= 0)
    rows, classes, scores = rows[keep], classes[keep], scores[keep]
    corner = rows[:, :2] - rows[:, 2:4] / 2
    boxes = np.column_stack([corner, rows[:, 2:4]])
    chosen = np.asarray(
        cv2.dnn.NMSBoxesBatched(boxes.tolist(), scores.tolist(), classes.tolist(), _SCORE, _IOU),
        dtype=np.int64,
    ).reshape(-1)
    chosen = chosen[np.argsort(-scores[chosen], kind="stable")][:_MAX_DETECTIONS]
    corners = np.column_stack([boxes[chosen, :2], boxes[chosen, :2] + boxes[chosen, 2:]])
    found = placement.to_picture(corners.astype(np.float32)).astype(np.float64)
    limit = np.array(placement.picture * 2)
    return Boxes(np.clip(found, 0, limit), classes[chosen], scores[chosen])


def evaluate_model(
    model: Path | Any,
    labelled: LabelledSet,
    shape: tuple[int, int] | None = None,
    min_heights: Sequence[float] = (0.0,),
) -> list[DetectionFigures]:
    """Figures of an OpenVINO model on labelled pictures, for each least box height.

    Args:
        model: an .xml, or a model read from one; it is not changed.
        shape: (height, width) that a dynamic input is given; None: it is static.
        min_heights: px of a picture scaled to a width of 640 px.

    Raises:
        InputError: a picture or its labels are unreadable.
    """
    import openvino as ov

    core = ov.Core()
    network = core.read_model(model) if isinstance(model, Path) else model.clone()
    if shape is not None and network.is_dynamic():
        network.reshape([1, 3, *shape])
    size = tuple(int(n) for n in network.input(0).shape)[2:]
    names = str(network.get_rt_info(["model_info", "labels"]).astype(str)).split()
    vehicle_class = vehicle_class_of(names, "the model")
    compiled = core.compile_model(network, "CPU")
    found, true = [], []
    for path in labelled.pictures:
        picture = read_image(path)
        if picture is None:
            raise InputError(path, "not a readable picture", "remove it from the set")
        planes, placement = letterbox(picture, (size[0], size[1]))
        output = np.asarray(compiled(planes)[0], dtype=np.float32)
        # Heights are judged at one width, whatever the pictures' own.
        unit = 640 / placement.picture[0]
        found.append(_scaled(decode(output, placement, vehicle_class), unit))
        true.append(_scaled(labelled.boxes(path, placement.picture), unit))
    return [evaluate(found, true, len(VEHICLE_CLASSES), height) for height in min_heights]


def _scaled(boxes: Boxes, factor: float) -> Boxes:
    return Boxes(boxes.corners * factor, boxes.classes, boxes.scores)
