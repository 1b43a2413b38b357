"""YOLO11 through Ultralytics: for .pt and .engine files, with the `train` extra's torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from edge_daemon.detection.protocol import MIN_SCORE, NMS_IOU, Detections, vehicle_class_of
from edge_daemon.frame import Image
from slipstream.errors import InputError


class UltralyticsDetector:
    """A YOLO11 model file, run by Ultralytics.

    Raises:
        InputError: the extra is missing, or the file is no YOLO detector with vehicle classes.
    """

    def __init__(self, path: Path) -> None:
        try:
            from ultralytics import YOLO
        except ImportError:
            raise InputError(
                path,
                "needs Ultralytics, which is not installed",
                "pip install ultralytics-opencv-headless, or give an OpenVINO .xml",
            ) from None
        try:
            self._model: Any = YOLO(str(path), task="detect")
            names = self._model.names
        except Exception as error:
            raise InputError(path, f"not a YOLO model: {error}", "export it again") from None
        self._vehicle_class = vehicle_class_of([names[i] for i in sorted(names)], path)

    @property
    def requests(self) -> int:
        """Frames at a time: one."""
        return 1

    def detect(self, image: Image) -> Detections:
        """Vehicles in a BGR frame (height, width, 3)."""
        result = (
            self._model.predict(
                image,
                conf=MIN_SCORE,
                iou=NMS_IOU,
                agnostic_nms=True,
                imgsz=640,
                verbose=False,
            )[0]
            .boxes.cpu()
            .numpy()
        )
        classes = self._vehicle_class[result.cls.astype(np.int64)]
        keep = classes >= 0
        return Detections(
            result.xyxy[keep].astype(np.float32),
            result.conf[keep].astype(np.float32),
            classes[keep],
        )
