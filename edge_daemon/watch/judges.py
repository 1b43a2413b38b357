"""The judges of a camera's faults, in the order that they have. To add one: CONTRIBUTING.md."""

from __future__ import annotations

import numpy as np

from edge_daemon.camera import Camera
from edge_daemon.frame import Image
from edge_daemon.settings import WatchSettings
from edge_daemon.watch.background import Background
from edge_daemon.watch.faults.blind import BlindJudge
from edge_daemon.watch.faults.camera_moved import CameraMovedJudge
from edge_daemon.watch.faults.clock_jump import ClockJumpJudge
from edge_daemon.watch.faults.corrupt import CorruptJudge, repeated
from edge_daemon.watch.faults.exposure import BrightJudge, DarkJudge
from edge_daemon.watch.faults.frozen import FrozenJudge
from edge_daemon.watch.faults.obscured import ObscuredJudge
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.motion import MotionFinder
from edge_daemon.watch.sample import grid_step, road_mask, sampled, small_grey
from edge_daemon.watch.trails import BareRoad
from edge_daemon.watch.view import View


def make_judges(
    camera: Camera, settings: WatchSettings, reference: Image | None, view: View
) -> tuple[FaultJudge, ...]:
    """All judges, in order of precedence: of several faults the first one is reported. The
    reference is an image of the calibrated view; the view measures its motion.
    """
    width, height = camera.size
    step = grid_step(width)
    grid = (len(range(step // 2, height, step)), len(range(step // 2, width, step)))
    rows, columns = small_grey(np.zeros((height, width, 3), np.uint8)).shape
    lanes = road_mask(camera, (rows, columns), 0.0)
    background = Background()
    moved = CameraMovedJudge(
        view,
        settings.max_shift_share * width,
        settings.max_shake_share * width,
        settings.moved_after_s,
    )
    blind = BlindJudge(MotionFinder(background, lanes, columns / width, camera))
    return (
        ClockJumpJudge(),
        DarkJudge(),
        BrightJudge(),
        CorruptJudge(
            0.0 if reference is None else float(repeated(sampled(reference)).mean()),
            road_mask(camera, grid, 0.0),
            background,
            BareRoad(lanes, columns / width),
            lambda: blind.is_blind,
        ),
        ObscuredJudge(lambda: moved.sharpness),
        FrozenJudge(road_mask(camera, grid, 0.0), camera),
        moved,
        blind,
    )
