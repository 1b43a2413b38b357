"""From sightings to the stability flag: smoothed motion, occlusion, six features, the flag."""

from edge_daemon.features.kinematics import SegmentKinematics, VehicleMotion, WindowFeatures
from edge_daemon.features.stability import Flag, StabilityJudge, classify

__all__ = [
    "Flag",
    "SegmentKinematics",
    "StabilityJudge",
    "VehicleMotion",
    "WindowFeatures",
    "classify",
]
