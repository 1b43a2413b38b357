"""SUMO view: roadside camera clips of traffic simulated by SUMO, with SUMO's own ground truth.

`clip` renders what `process` simulates in a subprocess; `world` reads the vehicles around a camera,
`net` its roads, and `ground`, `roadside` and `shapes` paint them.
"""

from simulation.sumo_view.clip import SumoRenderer, render_sumo_clip
from simulation.sumo_view.examples import find_additional, find_net, find_routes, find_rsu
from simulation.sumo_view.lanes import Roads
from simulation.sumo_view.polylines import Floats, at, distances
from simulation.sumo_view.pose import Pose, draw_pose
from simulation.sumo_view.settings import (
    MastSettings,
    RsuSettings,
    SumoClipSettings,
    ViewSettings,
    WatchSettings,
)
from simulation.sumo_view.shapes import Kind, is_known
from simulation.sumo_view.traffic import Vehicle

__all__ = [
    "Floats",
    "Kind",
    "MastSettings",
    "Pose",
    "Roads",
    "RsuSettings",
    "SumoClipSettings",
    "SumoRenderer",
    "Vehicle",
    "ViewSettings",
    "WatchSettings",
    "at",
    "distances",
    "draw_pose",
    "find_additional",
    "find_net",
    "find_routes",
    "find_rsu",
    "is_known",
    "render_sumo_clip",
]
