"""StreetDrive: roadside camera clips of rendered traffic with exact ground truth."""

from simulation.streetdrive.clip import ClipSummary, render_clip
from simulation.streetdrive.settings import ClipSettings
from simulation.streetdrive.traffic import SCENARIOS

__all__ = ["SCENARIOS", "ClipSettings", "ClipSummary", "render_clip"]
