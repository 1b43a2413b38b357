"""SUMO view: roadside camera clips of traffic simulated by SUMO, with SUMO's own ground truth."""

from simulation.sumo.clip import render_sumo_clip
from simulation.sumo.settings import SumoClipSettings

__all__ = ["SumoClipSettings", "render_sumo_clip"]
