"""StreetDrive: roadside camera clips of rendered traffic with exact ground truth.

`traffic` says who drives where, `vehicles` builds their meshes, `rendering` paints them, and `clip`
writes video, truth and calibration.
"""

from slipstream_lab.simulation.streetdrive.calibration import Point, SegmentText, calibration_text
from slipstream_lab.simulation.streetdrive.clip import PALETTE, ClipSummary, render_clip
from slipstream_lab.simulation.streetdrive.rendering import Conditions
from slipstream_lab.simulation.streetdrive.settings import ClipSettings
from slipstream_lab.simulation.streetdrive.traffic.scenarios import SCENARIOS
from slipstream_lab.simulation.streetdrive.writer import Progress, make_folder, write_clip

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
