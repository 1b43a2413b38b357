"""Where a camera hangs and looks: its site beside the road, its pose in the net, and the axes along
the road in which its view is painted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from slipstream.errors import InputError
from slipstream.roads import RoadNetwork, Segment
from slipstream.roads.sumo_net import load_network
from slipstream_lab.simulation.rsus import (
    MastSettings,
    Rsu,
    RsuSettings,
    RsuWatchSettings,
    ViewSettings,
    is_one_camera,
    load_rsu,
    load_rsus,
)
from slipstream_lab.simulation.streetdrive.rendering import PinholeCamera
from slipstream_lab.simulation.sumo_view.polylines import Floats, at, distances

_VIEW_M: Final = 85.0
"""From the mast's foot to the end of the stretch: a camera watches 20 to 80 m away."""
_LOOK_M: Final = 40.0
_LANE_M: Final = 3.2
_BESIDE_M: Final = 4.0


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

    def camera(self, axis_rad: float) -> PinholeCamera:
        """The camera in axes whose origin is its foot and whose x points to `axis_rad`."""
        return PinholeCamera(
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
class CameraSite:
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


def camera_site(
    rsu: Rsu, network: RoadNetwork, width_px: int = 1280, height_px: int = 720
) -> RsuSettings:
    """A camera for the first stretch of an RSU; the other ones are left out.

    The last 60 m in view are watched, so that what the camera tells of is the stretch before the
    junction's queue. What is left open (height, lens, light) is drawn from the scene's seed. An RSU
    with a mast of its own watches all of its stretches from there.
    """
    if rsu.mast is not None and rsu.view is not None:
        own = tuple(
            RsuWatchSettings(edge=s.segment, from_m=s.from_m, to_m=s.to_m, from_lane=s.from_lane)
            for s in rsu.watch
        )
        return RsuSettings(
            schema=1, name=rsu.id, mast=rsu.mast, view=rsu.view, watch=own, scene=rsu.scene
        )
    stretch = rsu.watch[0]
    segment = network.segments[stretch.segment]
    foot_m = max(0.0, stretch.to_m - _VIEW_M)
    kerb_m = segment.lanes * _LANE_M / 2 + _BESIDE_M
    mast, _ = _beside(segment, foot_m, -kerb_m if network.left_hand else kerb_m)
    target, ahead = _beside(segment, min(foot_m + _LOOK_M, segment.length_m), 0.0)
    if foot_m + _LOOK_M > segment.length_m:
        target = mast + _LOOK_M * ahead
    return RsuSettings.model_validate(
        {
            "schema": 1,
            "name": rsu.id,
            "mast": MastSettings(x_m=float(mast[0]), y_m=float(mast[1])),
            "view": ViewSettings(
                look_at_m=(float(target[0]), float(target[1])),
                width_px=width_px,
                height_px=height_px,
            ),
            "watch": (RsuWatchSettings(edge=segment.id, from_lane=stretch.from_lane),),
            "scene": rsu.scene,
        }
    )


def load_camera(path: Path, net: Path, rsu_id: str | None) -> RsuSettings:
    """The camera of a file of RSUs, or of one camera.

    Args:
        rsu_id: which RSU; None: the file has one only.

    Raises:
        InputError: the file is malformed or does not fit the net, or has not that RSU.
    """
    if is_one_camera(path):
        one = load_rsu(path)
        if rsu_id not in (None, one.name):
            raise InputError(path, f"no RSU {rsu_id!r}", f"it has {one.name}", key="--rsu-id")
        return one
    network = load_network(net)
    rsus = {rsu.id: rsu for rsu in load_rsus(path, network)}
    if rsu_id is None and len(rsus) == 1:
        rsu_id = next(iter(rsus))
    if rsu_id not in rsus:
        problem = "several RSUs" if rsu_id is None else f"no RSU {rsu_id!r}"
        raise InputError(path, problem, f"name one: {', '.join(rsus)}", key="--rsu-id")
    return camera_site(rsus[rsu_id], network)


def _beside(segment: Segment, along_m: float, right_m: float) -> tuple[Floats, Floats]:
    """A point beside the centre line of a segment, and the segment's direction there."""
    line = np.array(segment.shape)
    ratio = float(distances(line)[-1]) / segment.length_m
    end_m = float(distances(line)[-1])
    here, low, high = (
        at(line, np.array([min(max(value, 0.0), end_m)]))[0]
        for value in (along_m * ratio, along_m * ratio - 1.0, along_m * ratio + 1.0)
    )
    angle = math.atan2(high[1] - low[1], high[0] - low[0])
    ahead = np.array([math.cos(angle), math.sin(angle)])
    return here + right_m * np.array([ahead[1], -ahead[0]]), ahead
