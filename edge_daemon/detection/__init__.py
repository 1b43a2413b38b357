"""Finding vehicles in pictures: one protocol, several backends."""

from edge_daemon.detection.protocol import (
    VEHICLE_CLASSES,
    Detections,
    Detector,
    DetectorSettings,
    open_detector,
)
from edge_daemon.detection.stream import ahead, detect_stream

__all__ = [
    "VEHICLE_CLASSES",
    "Detections",
    "Detector",
    "DetectorSettings",
    "ahead",
    "detect_stream",
    "open_detector",
]
