"""The calibrated camera: image ↔ road plane, and the parts of road segments that it watches."""

from edge_daemon.camera.camera import Camera, hide, load_camera
from edge_daemon.camera.checks import polygon_mask
from edge_daemon.camera.homography import Array
from edge_daemon.camera.pose import CameraPose
from edge_daemon.camera.segment import WatchedSegment

__all__ = ["Array", "Camera", "CameraPose", "WatchedSegment", "hide", "load_camera", "polygon_mask"]
