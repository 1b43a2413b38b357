"""The judges of a camera's faults: their protocol, and the list that orders them.

To add a fault: its name in `slipstream.messages.CameraFault`, a module here with its judge, a
place in `make_judges`, and its limits in `edge_daemon.settings.WatchSettings`. Debouncing, metrics,
health messages and the dashboard follow from these.
"""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from edge_daemon.camera import Camera
from edge_daemon.frame import Image
from edge_daemon.settings import WatchSettings
from edge_daemon.watch.background import Background
from edge_daemon.watch.faults.blind import BlindJudge
from edge_daemon.watch.faults.camera_moved import CameraMovedJudge, ViewShift
from edge_daemon.watch.faults.clock_jump import ClockJumpJudge
from edge_daemon.watch.faults.corrupt import CorruptJudge, repeated
from edge_daemon.watch.faults.exposure import BrightJudge, DarkJudge
from edge_daemon.watch.faults.frozen import FrozenJudge
from edge_daemon.watch.faults.obscured import ObscuredJudge
from edge_daemon.watch.motion import MotionFinder
from edge_daemon.watch.sample import Sample, grid_step, road_mask, sampled, small_grey
from edge_daemon.watch.trails import BareRoad
from slipstream.messages import CameraFault

_VEHICLE_MARGIN = 0.06


class FaultJudge(Protocol):
    """Looks for one fault of a camera.

    Attributes:
        fault: its name in states and health messages.
        every_frame: True: it looks at every frame, whatever the others see. False: at frames
            `sample_interval_s` apart, unless an earlier judge sees a fault that hides the scene.
        hides_scene: while this fault is seen, the judges after this one cannot look.
        after_s: evidence without a break for so long begins the fault, s.
    """

    fault: ClassVar[CameraFault]
    every_frame: ClassVar[bool]
    hides_scene: ClassVar[bool]
    after_s: float

    def look(self, sample: Sample) -> bool:
        """Whether there is evidence of the fault in a frame; frames come in order of time."""
        ...

    def interrupt(self, by: CameraFault | None) -> None:
        """The next frame does not follow the last one that this judge looked at.

        Args:
            by: the fault that hid the scene; None if the scene or the time line was cut.
        """
        ...


@runtime_checkable
class Explains(Protocol):
    """A judge that says what it found.

    Attributes:
        detail: the figure that was last found above its limit, with the limit.
    """

    detail: str


def make_judges(
    camera: Camera, settings: WatchSettings, reference: Image | None
) -> tuple[FaultJudge, ...]:
    """All judges, in order of precedence: of several faults the first one is reported. Without a
    reference, an image of the calibrated view, that of the first good seconds is taken for it.
    """
    width, height = camera.size
    step = grid_step(width)
    grid = (len(range(step // 2, height, step)), len(range(step // 2, width, step)))
    rows, columns = small_grey(np.zeros((height, width, 3), np.uint8)).shape
    lanes = road_mask(camera, (rows, columns), 0.0)
    background = Background()
    moved = CameraMovedJudge(
        ViewShift(
            settings.max_shift_share,
            settings.moved_after_s,
            road_mask(camera, (rows, columns), _VEHICLE_MARGIN),
            None if reference is None else small_grey(reference),
        )
    )
    blind = BlindJudge(MotionFinder(background, lanes, columns / width, camera))
    return (
        ClockJumpJudge(settings.clock_step_s),
        DarkJudge(settings.exposure_after_s),
        BrightJudge(settings.exposure_after_s),
        CorruptJudge(
            settings.max_repeated_share,
            0.0 if reference is None else float(repeated(sampled(reference)).mean()),
            road_mask(camera, grid, 0.0),
            background,
            BareRoad(lanes, columns / width),
            lambda: blind.is_blind,
        ),
        ObscuredJudge(settings.exposure_after_s, lambda: moved.sharpness),
        FrozenJudge(settings.frozen_after_s, road_mask(camera, grid, 0.0), camera),
        moved,
        blind,
    )
