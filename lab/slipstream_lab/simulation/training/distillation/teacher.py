"""What a detector trained on real pictures answers at each place of the student's network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from edge_daemon.detection import VEHICLE_CLASSES
from edge_daemon.detection.fixed_input import STRIDES, resized
from edge_daemon.detection.protocol import vehicle_class_of
from edge_daemon.frame import Image
from slipstream.errors import InputError
from slipstream_lab.simulation.training.distillation.samples import halved, planes

Floats = NDArray[np.float32]
Halves = NDArray[np.float16]
_FINER: Final = 0.9
"""What a score of the look at twice the size is worth."""


@dataclass(frozen=True)
class Answer:
    """For the n places of the student's network, finest stride first.

    Attributes:
        boxes: x1, y1, x2, y2, px of the student's input, shape (n, 4).
        scores: by VEHICLE_CLASSES, shape (n, 4).
        features: what the teacher's heads look at, (channels, height, width) for each stride.
    """

    boxes: Floats
    scores: Floats
    features: tuple[Halves, ...]


class Teacher(Protocol):
    """Answers for pictures."""

    def answer(self, fine: Image, detailed: bool) -> Answer:
        """For a picture at twice the student's size, (2 height, 2 width, 3), BGR. A `detailed` one
        shows more at that size."""
        ...


class CocoTeacher:
    """A YOLO11 export for OpenVINO of the student's own layout, with COCO's classes."""

    def __init__(self, model: Path, shape: tuple[int, int], threads: int) -> None:
        """For a student's input of (height, width). Raises InputError: no such model, one of
        another kind, or one without vehicles."""
        import openvino as ov

        try:
            network = ov.Core().read_model(model)
        except RuntimeError:
            raise InputError(model, "not an OpenVINO model", "give its .xml") from None
        self._shape = shape
        self._classes = _columns(model, network)
        _expose_features(model, network)
        self._near = _compiled(model, network, shape, threads)
        self._fine = _compiled(model, network, (2 * shape[0], 2 * shape[1]), threads)

    def answer(self, fine: Image, detailed: bool) -> Answer:
        """See Teacher."""
        boxes, scores, features = self._look(self._near, halved(fine))
        if detailed:
            finer, sure, _ = self._look(self._fine, fine)
            boxes, scores = joined(
                *(boxes, scores, np.float32(0.5) * finer, np.float32(_FINER) * sure),
                shape=self._shape,
            )
        return Answer(boxes, scores, features)

    def _look(self, compiled: Any, image: Image) -> tuple[Floats, Floats, tuple[Halves, ...]]:
        answers = compiled(planes([image]))
        rows = np.asarray(answers[0][0].T, dtype=np.float32)
        half = rows[:, 2:4] / 2
        boxes = np.concatenate([rows[:, :2] - half, rows[:, :2] + half], axis=1)
        features = tuple(np.array(answers[k][0], dtype=np.float16) for k in (1, 2, 3))
        return boxes, rows[:, 4:][:, self._classes], features


def joined(
    boxes: Floats, scores: Floats, finer: Floats, sure: Floats, shape: tuple[int, int]
) -> tuple[Floats, Floats]:
    """At each place, the best of what is said there and at the places of a look at twice the size
    that cover the same part of the picture with the same cells, or with cells of half their width.

    `boxes` and `scores` belong to the places of `shape`, `finer` and `sure` to those of twice it.
    """
    height, width = shape
    out_boxes, out_scores = boxes.copy(), scores.copy()
    begins = _begins(shape)
    fine_begins = _begins((2 * height, 2 * width))
    for level, stride in enumerate(STRIDES):
        rows, columns = height // stride, width // stride
        own = slice(begins[level], begins[level] + rows * columns)
        candidates = [(boxes[own], scores[own])]
        if level + 1 < len(STRIDES):
            # Twice the picture at twice the stride: the same cells.
            same = slice(fine_begins[level + 1], fine_begins[level + 1] + rows * columns)
            candidates.append((finer[same], sure[same]))
        if level == 0:
            begin = fine_begins[0]
            four = np.arange(begin, begin + 4 * rows * columns).reshape(rows, 2, columns, 2)
            candidates += [
                (finer[four[:, i, :, j].ravel()], sure[four[:, i, :, j].ravel()])
                for i in (0, 1)
                for j in (0, 1)
            ]
        best = np.argmax([s.max(axis=1) for _, s in candidates], axis=0)
        which = np.arange(rows * columns)
        out_boxes[own] = np.stack([b for b, _ in candidates])[best, which]
        out_scores[own] = np.stack([s for _, s in candidates])[best, which]
    return out_boxes, out_scores


def _begins(shape: tuple[int, int]) -> list[int]:
    counts = [(shape[0] // s) * (shape[1] // s) for s in STRIDES]
    return [sum(counts[:level]) for level in range(len(counts))]


def _columns(model: Path, network: Any) -> list[int]:
    names = str(network.get_rt_info(["model_info", "labels"]).astype(str)).split()
    classes = vehicle_class_of(names, model)
    found = [np.flatnonzero(classes == k) for k in range(len(VEHICLE_CLASSES))]
    if any(not len(columns) for columns in found):
        raise InputError(model, "lacks a vehicle class", f"it needs {', '.join(VEHICLE_CLASSES)}")
    return [int(columns[0]) for columns in found]


def _expose_features(model: Path, network: Any) -> None:
    """Make what the heads' first convolutions look at outputs of the model."""
    for level in range(len(STRIDES)):
        heads = [
            op
            for op in network.get_ordered_ops()
            if op.get_type_name() == "Convolution"
            and f"model.23.cv2.{level}.0.conv/" in op.get_friendly_name()
        ]
        if len(heads) != 1:
            raise InputError(model, "not a YOLO11 export", "give one made by Ultralytics")
        source = heads[0].input_value(0)
        while source.get_node().get_type_name() == "FakeQuantize":
            source = source.get_node().input_value(0)
        network.add_outputs([source])


def _compiled(model: Path, network: Any, shape: tuple[int, int], threads: int) -> Any:
    import openvino as ov

    fitted = resized(network, shape)
    if fitted is None:
        raise InputError(model, "its input cannot be resized", "give an export by Ultralytics")
    settings = {"INFERENCE_NUM_THREADS": threads, "PERFORMANCE_HINT": "LATENCY"}
    return ov.Core().compile_model(fitted, "CPU", settings)
