"""Roads that bend, crest and sag, before a camera on a pole, seen through lenses that distort."""

from __future__ import annotations

import cv2
import numpy as np

from edge_daemon.camera.curved import CurvedRoad

from .conftest import FOCAL_PX, POLE_M, TILT

SIZE = (1280, 720)
MIDDLE, HALF_M = np.array([54.0, 0.0]), 36.0


def road(arc: float = 0.0, crest: float = 0.0, lens: float = 0.0) -> CurvedRoad:
    """Such a road before a camera on a pole at station 0 that looks along the chord."""
    cos, sin = np.cos(TILT), np.sin(TILT)
    level = np.array([[0, -1, 0], [-sin, 0, -cos], [cos, 0, -sin]])
    yaw = -0.4 * 54 * arc
    turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    rotation = level @ turn
    vector = cv2.Rodrigues(rotation)[0].ravel()
    bare = CurvedRoad(
        MIDDLE, HALF_M, SIZE, FOCAL_PX, vector, np.zeros(3), lens, arc, crest
    )  # fmt: skip
    centre = bare.surface(np.zeros((1, 2)))[0] + (0, 0, POLE_M)
    return CurvedRoad(
        MIDDLE, HALF_M, SIZE, FOCAL_PX, vector, -rotation @ centre, lens, arc, crest
    )  # fmt: skip


SCENES = {
    "bend of 150 m to the left": road(arc=1 / 150),
    "bend of 200 m to the right": road(arc=-1 / 200),
    "crest": road(crest=-1 / 2000),
    "sag": road(crest=1 / 1500),
    "barrel": road(lens=-0.12),
    "bend, crest and barrel": road(arc=1 / 200, crest=-1 / 2500, lens=-0.1),
}
