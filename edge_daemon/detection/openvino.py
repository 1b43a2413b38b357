"""YOLO11 on OpenVINO: the default backend, without torch."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import openvino as ov
from openvino.preprocess import ColorFormat, PrePostProcessor

from edge_daemon.camera import Camera
from edge_daemon.detection.fixed_input import resized
from edge_daemon.detection.placement import Placement, place_aligned, place_dynamic, place_static
from edge_daemon.detection.processor import float_precision
from edge_daemon.detection.protocol import MIN_SCORE, NMS_IOU, Detections, vehicle_class_of
from edge_daemon.detection.region import Region, road_region
from edge_daemon.frame import Image
from edge_daemon.settings import BUILTIN_MODEL, DetectorSettings
from slipstream.errors import InputError
from slipstream.files import check_file, silent_libraries

log = logging.getLogger(__name__)

_GREY = 114  # what YOLO's letterbox is padded with in training
_DEFAULT_SHAPE = (640, 640)
_MAX_XML_BYTES = 64_000_000


class OpenVinoDetector:
    """A YOLO11 export; cutting out, colour order and scaling run without copies.

    The model is compiled for the part of the frame that holds the road, at the scale that it was
    trained at. Where its input is fixed in a way that is not known, that part is letterboxed.

    Raises:
        InputError: not an OpenVINO model, not a YOLO11 detector, or without vehicle classes; the
            device is not there or cannot run it.
    """

    def __init__(
        self, path: Path, settings: DetectorSettings, camera: Camera | None = None
    ) -> None:
        self._core = _runtime()
        self._device = _device(self._core.available_devices, settings.device)
        check_file(path, _MAX_XML_BYTES, "give an OpenVINO model")
        try:
            with silent_libraries():
                self._model = self._core.read_model(path)
        except (RuntimeError, ValueError):
            raise InputError(path, "not an OpenVINO model", "export one from YOLO11") from None
        self._static, self._trained, names = _check(self._model, path)
        self._path = path
        self._vehicle_class = vehicle_class_of(names, path)
        self._settings = settings
        self._camera = camera
        self._compile_lock = threading.Lock()
        self._network: _Network | None = None
        if camera is not None:
            self._network_for(camera.size)

    @property
    def requests(self) -> int:
        """Frames at a time."""
        return min(2, _threads(self._settings)) if self._device == "CPU" else 2

    def detect(self, image: Image) -> Detections:
        """Vehicles in a BGR frame (height, width, 3); from so many threads as `requests`."""
        network = self._network_for((image.shape[1], image.shape[0]))
        output = network.infer(image)
        boxes, scores, classes = _candidate_boxes(output, self._vehicle_class)
        # Classes compete: one vehicle is either a car or a truck, so overlap is judged across them.
        kept = np.asarray(
            cv2.dnn.NMSBoxes(
                boxes.tolist(),
                scores.tolist(),
                MIN_SCORE,
                NMS_IOU,
            ),
            dtype=np.int64,
        ).reshape(-1)
        corners = boxes[kept]
        corners[:, 2:] += corners[:, :2]
        corners = network.placement.to_picture(corners)
        whole = network.placement.uncut(corners)
        return Detections(corners[whole], scores[kept][whole], classes[kept][whole])

    def _network_for(self, picture: tuple[int, int]) -> _Network:
        """The model compiled for frames of (width, height)."""
        network = self._network
        if network is None or network.placement.picture != picture:
            with self._compile_lock:
                network = self._network
                if network is None or network.placement.picture != picture:
                    network = self._network = self._compile(picture)
        return network

    def _compile(self, picture: tuple[int, int]) -> _Network:
        region = None
        if self._camera is not None and self._camera.size == picture:
            region = road_region(self._camera)
        wanted = region or Region(0, 0, *picture)
        height, width = self._trained
        scale = self._settings.scale or min(width / picture[0], height / picture[1])
        # The shipped weights find as much at any place; others were trained on whole pictures.
        place = place_dynamic if self._settings.model == BUILTIN_MODEL else place_aligned
        placement = place(picture, wanted, scale)
        if self._static:
            resized_model = resized(self._model, placement.shape)
            if resized_model is None:
                placement = place_static(picture, wanted, self._trained)
            model = resized_model or self._model.clone()
        else:
            model = self._model.clone()
            try:
                model.reshape([1, 3, *placement.shape])
            except RuntimeError:
                raise InputError(
                    self._path,
                    f"cannot take an input of {placement.shape[1]}×{placement.shape[0]} px",
                    "export it again with `slipstream model export`",
                ) from None
        hints: dict[str, Any] = {"PERFORMANCE_HINT": "LATENCY"}
        if self._device == "CPU":
            hints = {
                "INFERENCE_NUM_THREADS": _threads(self._settings),
                "NUM_STREAMS": self.requests,
                "INFERENCE_PRECISION_HINT": float_precision(),
                # Pinned, the threads of two daemons would meet on one core.
                "ENABLE_CPU_PINNING": False,
            }
        try:
            compiled = self._core.compile_model(_with_preprocessing(model), self._device, hints)
        except RuntimeError as error:
            reason = str(error).strip().rpartition("\n")[2]
            problem = f"the {self._device} cannot run {self._path.name}: {reason}"
            raise InputError("detector.device", problem, "give another") from None
        return _Network(placement, compiled, self.requests)


class _Network:
    """A compiled model with its requests and their input frames."""

    def __init__(self, placement: Placement, compiled: ov.CompiledModel, requests: int) -> None:
        self.placement = placement
        self._free: SimpleQueue[tuple[ov.InferRequest, Image]] = SimpleQueue()
        for _ in range(requests):
            canvas: Image = np.full((1, *placement.shape, 3), _GREY, dtype=np.uint8)
            request = compiled.create_infer_request()
            request.set_input_tensor(ov.Tensor(canvas, shared_memory=True))
            self._free.put((request, canvas))

    def infer(self, image: Image) -> npt.NDArray[np.float32]:
        """Raw output of a frame, shape (4 + classes, places); waits for a free request."""
        crop, inner = self.placement.crop, self.placement.inner
        request, canvas = self._free.get()
        try:
            cv2.resize(
                image[crop.top : crop.bottom, crop.left : crop.right],
                (inner.width, inner.height),
                dst=canvas[0, inner.top : inner.bottom, inner.left : inner.right],
                interpolation=cv2.INTER_AREA if inner.width < crop.width else cv2.INTER_LINEAR,
            )
            request.infer()
            # A copy: the request's own memory is overwritten by the next frame.
            return np.array(request.get_output_tensor(0).data[0], dtype=np.float32)
        finally:
            self._free.put((request, canvas))


def _device(there: Sequence[str], wanted: str) -> str:
    """The wanted kind of device of those that OpenVINO has here, as CPU or GPU.0."""
    kinds = {name.partition(".")[0] for name in there}
    if wanted == "auto":
        found = next((kind for kind in ("GPU", "NPU") if kind in kinds), "CPU")
        log.info("the detector computes on the %s", found)
        return found
    if wanted not in kinds:
        has = " and ".join(sorted(kinds)) or "no device"
        raise InputError("detector.device", f"no {wanted}: OpenVINO has {has} here", "give another")
    return wanted


def _threads(settings: DetectorSettings) -> int:
    return settings.threads or len(os.sched_getaffinity(0))


def _candidate_boxes(
    output: npt.NDArray[np.float32], vehicle_class: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.int64]]:
    """Boxes (x, y, width, height), scores and classes of places that are likely a vehicle."""
    scores_all = output[4:]
    is_vehicle = vehicle_class >= 0
    vehicles = scores_all if is_vehicle.all() else scores_all[is_vehicle]
    likely = np.flatnonzero(vehicles.max(axis=0) >= MIN_SCORE)
    scores_all = scores_all[:, likely]
    best = scores_all.argmax(axis=0)
    classes = vehicle_class[best]
    keep = classes >= 0
    boxes = output[:4, likely[keep]].T
    boxes[:, :2] -= boxes[:, 2:] / 2
    return boxes, scores_all.max(axis=0)[keep], classes[keep]


def _check(model: ov.Model, path: Path) -> tuple[bool, tuple[int, int], list[str]]:
    """Whether the input is static, its (height, width) in training, and the class names."""
    try:
        names = str(model.get_rt_info(["model_info", "labels"]).astype(str)).split()
    except (RuntimeError, ValueError):  # none, or no text
        raise InputError(path, "the model names no classes", "export it with Ultralytics") from None
    shape = model.input(0).partial_shape
    known = shape.rank.is_static and len(shape) == 4 and shape[1] == 3
    if len(model.inputs) != 1 or not known or (shape[0].is_static and shape[0] != 1):
        raise InputError(path, f"input is {shape}", "export it with a 1×3×H×W input")
    output = model.output(0).partial_shape
    if output.rank.is_dynamic or len(output) != 3 or output[1] != 4 + len(names):
        raise InputError(
            path, f"output {output} does not fit {len(names)} classes", "export a YOLO11 detector"
        )
    if shape.is_static:
        return True, (shape[2].get_length(), shape[3].get_length()), names
    try:
        size = str(model.get_rt_info(["model_info", "trained_size"]).astype(str)).split()
        height, width = (int(number) for number in size)
    except (RuntimeError, ValueError):
        height, width = _DEFAULT_SHAPE
    return False, (height, width), names


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


@cache
def _runtime() -> ov.Core:
    """One for the process, and for good. The CPU plugin gives the thread that loads it a stack for
    its signals, and frees it when it is unloaded, by whichever thread: the next signal then kills
    the process.
    """
    return ov.Core()
