"""Finding vehicles in pictures: one protocol, several backends."""

from edge_daemon.detection.protocol import (
    VEHICLE_CLASSES,
    Detections,
    Detector,
    DetectorSettings,
    open_detector,
)

__all__ = ["VEHICLE_CLASSES", "Detections", "Detector", "DetectorSettings", "open_detector"]
