"""StreetDrive: roadside camera clips of rendered traffic with exact ground truth.

`traffic` says who drives where, `vehicles` builds their meshes, `rendering` paints them, and `clip`
writes video, truth and calibration.
"""

from simulation.streetdrive.calibration import Point, SegmentText, calibration_text
from simulation.streetdrive.clip import PALETTE, ClipSummary, render_clip
from simulation.streetdrive.rendering import Conditions
from simulation.streetdrive.settings import ClipSettings
from simulation.streetdrive.traffic.scenarios import SCENARIOS
from simulation.streetdrive.writer import Progress, make_folder, write_clip

__all__ = [
    "PALETTE",
    "SCENARIOS",
    "ClipSettings",
    "ClipSummary",
    "Conditions",
    "Point",
    "Progress",
    "SegmentText",
    "calibration_text",
    "make_folder",
    "render_clip",
    "write_clip",
]
