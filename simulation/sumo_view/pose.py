"""The camera's pose in the net, and the axes along the road in which its view is painted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simulation.streetdrive.rendering import Camera
from simulation.sumo_view.polylines import Floats
from simulation.sumo_view.settings import RsuSettings
from slipstream.errors import InputError


@dataclass(frozen=True)
class Pose:
    """A camera in the net's coordinates; heading anticlockwise from +x, pitch downwards."""

    x_m: float
    y_m: float
    height_m: float
    heading_rad: float
    pitch_rad: float
    roll_rad: float
    focal_px: float
    width_px: int
    height_px: int

    def camera(self, axis_rad: float) -> Camera:
        """The camera in axes whose origin is its foot and whose x points to `axis_rad`."""
        return Camera(
            height_m=self.height_m,
            lateral_m=0.0,
            pitch_rad=self.pitch_rad,
            yaw_rad=self.heading_rad - axis_rad,
            focal_px=self.focal_px,
            roll_rad=self.roll_rad,
            width_px=self.width_px,
            height_px=self.height_px,
        )


@dataclass(frozen=True)
class Site:
    """Axes on the road plane: origin in the net's coordinates and where x points."""

    x_m: float
    y_m: float
    axis_rad: float

    def to_local(self, points_m: Floats) -> Floats:
        """Net points (..., 2) in these axes."""
        cos, sin = math.cos(self.axis_rad), math.sin(self.axis_rad)
        x, y = points_m[..., 0] - self.x_m, points_m[..., 1] - self.y_m
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)


def draw_pose(rsu: RsuSettings, seed: int, source: Path) -> Pose:
    """The RSU's pose; what its file leaves open is drawn as for StreetDrive's cameras.

    Each value has its own draw, so that fixing one leaves the others as they were.

    Raises:
        InputError: the point looked at is the mast's foot.
    """
    mast, view = rsu.mast, rsu.view
    rng = np.random.default_rng([seed, 10])
    height, focal, roll = rng.uniform((9.5, 960.0, -0.6), (11.5, 1100.0, 0.6))
    moved = rng.uniform(-1.0, 1.0, 4)
    height_m = float(height) if mast.height_m is None else mast.height_m
    focal_px = float(focal) * view.width_px / 1280 if view.focal_px is None else view.focal_px
    x_m = mast.x_m + mast.spread_m * float(moved[0])
    y_m = mast.y_m + mast.spread_m * float(moved[1])
    if view.look_at_m is not None:
        away_x = view.look_at_m[0] + view.spread_m * float(moved[2]) - x_m
        away_y = view.look_at_m[1] + view.spread_m * float(moved[3]) - y_m
        distance = math.hypot(away_x, away_y)
        if distance < 1.0:
            raise InputError(
                source, "the camera looks at its own foot", "look further", key="view.look_at_m"
            )
        heading, pitch = math.atan2(away_y, away_x), math.atan2(height_m, distance)
    else:
        heading = math.radians(90.0 - (view.heading_deg or 0.0))
        pitch = math.radians(view.pitch_deg or 0.0)
    return Pose(
        x_m,
        y_m,
        height_m,
        heading,
        pitch,
        math.radians(float(roll) if view.roll_deg is None else view.roll_deg),
        focal_px,
        view.width_px,
        view.height_px,
    )
