"""YOLO11 on OpenVINO: the default backend, without torch."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import openvino as ov
from openvino.preprocess import ColorFormat, PrePostProcessor

from edge_daemon.detection.protocol import Detections, DetectorSettings, vehicle_class_of
from edge_daemon.frame import Image
from slipstream.errors import InputError

_GREY = 114  # what YOLO's letterbox is padded with in training


class OpenVinoDetector:
    """A YOLO11 export with a static input; colour order and scaling run inside the model."""

    def __init__(self, path: Path, settings: DetectorSettings) -> None:
        """Read and compile the model.

        Raises:
            InputError: not an OpenVINO model, not a YOLO11 detector, or without vehicle classes.
        """
        core = ov.Core()
        try:
            model = core.read_model(path)
        except RuntimeError:
            raise InputError(path, "not an OpenVINO model", "export one from YOLO11") from None
        shape, names = _check(model, path)
        self._height, self._width = shape
        self._vehicle_class = vehicle_class_of(names, path)
        self._settings = settings
        self._canvas: Image = np.full((1, *shape, 3), _GREY, dtype=np.uint8)
        self._compiled = core.compile_model(
            _with_preprocessing(model),
            "CPU",
            {
                "PERFORMANCE_HINT": "LATENCY",
                "INFERENCE_NUM_THREADS": settings.threads,
                "NUM_STREAMS": "1",
                "INFERENCE_PRECISION_HINT": _precision(),
            },
        )
        self._request = self._compiled.create_infer_request()
        self._placed: tuple[int, int] = (0, 0)

    @property
    def requests(self) -> int:
        """Pictures at a time: one."""
        return 1

    def detect(self, image: Image) -> Detections:
        """Vehicles in a BGR picture (height, width, 3)."""
        scale, left, top = self._place(image)
        output = self._request.infer({0: self._canvas}, share_inputs=True)[0][0]
        scores_all = output[4:].T
        best = scores_all.argmax(axis=1)
        scores = scores_all[np.arange(len(best)), best]
        classes = self._vehicle_class[best]
        keep = np.flatnonzero((scores >= self._settings.min_score) & (classes >= 0))
        centre_size = output[:4, keep].T
        scores, classes = scores[keep].astype(np.float32), classes[keep]
        corner = centre_size[:, :2] - centre_size[:, 2:] / 2 - (left, top)
        boxes = np.hstack([corner, corner + centre_size[:, 2:]]).astype(np.float32) / scale
        # Classes compete: one vehicle is either a car or a truck, so overlap is judged across them.
        kept = cv2.dnn.NMSBoxes(
            np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]]).tolist(),
            scores.tolist(),
            self._settings.min_score,
            self._settings.max_overlap,
        )
        index = np.asarray(kept, dtype=np.int64).reshape(-1)
        return Detections(boxes[index], scores[index], classes[index])

    def _place(self, image: Image) -> tuple[float, int, int]:
        """Put the picture into the middle of the model's canvas, its aspect kept."""
        height, width = image.shape[:2]
        scale = min(self._width / width, self._height / height)
        new = round(width * scale), round(height * scale)
        left, top = (self._width - new[0]) // 2, (self._height - new[1]) // 2
        if new != self._placed:
            self._canvas[:] = _GREY
            self._placed = new
        cv2.resize(
            image,
            new,
            dst=self._canvas[0, top : top + new[1], left : left + new[0]],
            interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR,
        )
        return scale, left, top


def _check(model: ov.Model, path: Path) -> tuple[tuple[int, int], list[str]]:
    """(height, width) of the input and the class names.

    Raises:
        InputError: it is not a YOLO11 detector with a static input.
    """
    try:
        names = str(model.get_rt_info(["model_info", "labels"]).astype(str)).split()
    except RuntimeError:
        raise InputError(path, "the model names no classes", "export it with Ultralytics") from None
    shape = model.input(0).partial_shape
    if len(model.inputs) != 1 or not shape.is_static or len(shape) != 4 or shape[1] != 3:
        raise InputError(path, f"input is {shape}", "export it with a static 1×3×H×W input")
    output = model.output(0).partial_shape
    if len(output) != 3 or output[1] != 4 + len(names):
        raise InputError(
            path, f"output {output} does not fit {len(names)} classes", "export a YOLO11 detector"
        )
    return (shape[2].get_length(), shape[3].get_length()), names


def _precision() -> ov.Type:
    """bf16 only where the processor has matrix tiles for it (AMX): without, f32 is faster."""
    try:
        tiles = " amx_bf16" in Path("/proc/cpuinfo").read_text()
    except OSError:
        tiles = False
    return ov.Type.bf16 if tiles else ov.Type.f32


def _with_preprocessing(model: ov.Model) -> ov.Model:
    steps = PrePostProcessor(model)
    steps.input().tensor().set_element_type(ov.Type.u8).set_layout(
        ov.Layout("NHWC")
    ).set_color_format(ColorFormat.BGR)
    steps.input().model().set_layout(ov.Layout("NCHW"))
    steps.input().preprocess().convert_element_type(ov.Type.f32).convert_color(
        ColorFormat.RGB
    ).scale(255.0)
    return steps.build()
