"""Detecting vehicles in frames: one protocol, several detectors, chosen by a registry."""

from edge_daemon.detection.protocol import (
    VEHICLE_CLASSES,
    Detections,
    Detector,
    box_feet,
    vehicle_class_of,
)
from edge_daemon.detection.registry import builtin_model, detector_names, open_detector
from edge_daemon.detection.stream import detect_stream, prefetch

__all__ = [
    "VEHICLE_CLASSES",
    "Detections",
    "Detector",
    "box_feet",
    "builtin_model",
    "detect_stream",
    "detector_names",
    "open_detector",
    "prefetch",
    "vehicle_class_of",
]
