"""SUMO view: roadside camera clips of traffic simulated by SUMO, with SUMO's own ground truth.

`clip` renders what `process` simulates in a subprocess; `world` reads the vehicles around a camera,
`net` its roads, and `ground`, `roadside` and `shapes` paint them.
"""

from slipstream_lab.simulation.sumo_view.clip import SumoRenderer, render_sumo_clip
from slipstream_lab.simulation.sumo_view.examples import (
    find_additional,
    find_net,
    find_routes,
    find_rsu,
)
from slipstream_lab.simulation.sumo_view.lanes import LaneRoads
from slipstream_lab.simulation.sumo_view.pose import Pose, camera_site, draw_pose
from slipstream_lab.simulation.sumo_view.settings import SumoClipSettings
from slipstream_lab.simulation.sumo_view.shapes import Kind, is_known
from slipstream_lab.simulation.sumo_view.traffic import ViewedVehicle

__all__ = [
    "Kind",
    "LaneRoads",
    "Pose",
    "SumoClipSettings",
    "SumoRenderer",
    "ViewedVehicle",
    "camera_site",
    "draw_pose",
    "find_additional",
    "find_net",
    "find_routes",
    "find_rsu",
    "is_known",
    "render_sumo_clip",
]
