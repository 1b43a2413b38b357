"""Where an RSU's camera hangs: beside its stretch, looking along the traffic towards its end."""

from __future__ import annotations

import math

import numpy as np

from simulation.scenarios.perception import Rsu
from simulation.sumo_view import (
    Floats,
    MastSettings,
    RsuSettings,
    ViewSettings,
    WatchSettings,
    at,
    distances,
)
from slipstream.roads import RoadNetwork, Segment

_VIEW_M = 85.0
"""From the mast's foot to the end of the stretch: a camera watches 20 to 80 m away."""
_LOOK_M = 40.0
_LANE_M = 3.2
_BESIDE_M = 4.0


def camera_site(rsu: Rsu, network: RoadNetwork, width_px: int, height_px: int) -> RsuSettings:
    """A camera for the first stretch of an RSU; the other ones are left out.

    The last 60 m in view are watched, so that what the camera tells of is the stretch before the
    junction's queue. What is left open (height, lens, light) is drawn from the scene's seed.
    """
    stretch = rsu.watch[0]
    segment = network.segments[stretch.segment]
    foot_m = max(0.0, stretch.to_m - _VIEW_M)
    mast, _ = _beside(segment, foot_m, segment.lanes * _LANE_M / 2 + _BESIDE_M)
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
            "watch": (WatchSettings(edge=segment.id, from_lane=stretch.from_lane),),
        }
    )


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
