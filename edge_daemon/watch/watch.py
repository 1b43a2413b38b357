"""All judges together: what, if anything, is wrong with the camera now."""

from __future__ import annotations

import numpy as np

from edge_daemon.camera import Camera
from edge_daemon.frame import Frame, Image
from edge_daemon.settings import WatchSettings
from edge_daemon.watch.clocks import ClockJudge
from edge_daemon.watch.corrupt import CorruptJudge
from edge_daemon.watch.exposure import exposure, is_obscured, sharpness
from edge_daemon.watch.frozen import FrozenJudge
from edge_daemon.watch.hold import Hold
from edge_daemon.watch.sample import Sample, grid_step, road_mask, small_grey, take_sample, texture
from edge_daemon.watch.view import ViewJudge
from slipstream.messages import CameraFault

_VEHICLE_REACH = 0.06
_VIEW_EVERY = 4


class Watch:
    """Looks at the frames of one camera for faults; pure but for its memory.

    The first fault in this order is named: clock_jump, dark, bright, corrupt, obscured, frozen,
    camera_moved. While one of the picture's faults lasts, the later ones are not looked for.
    """

    def __init__(
        self, camera: Camera, settings: WatchSettings, reference: Image | None = None
    ) -> None:
        """Set it up.

        Args:
            camera: what the pictures should show; all have its size.
            settings: thresholds.
            reference: a picture of the calibrated view, BGR, of the camera's size; None: the first
                good seconds are taken for it.
        """
        self._settings = settings
        width, height = camera.size
        step = grid_step(width)
        grid = (len(range(step // 2, height, step)), len(range(step // 2, width, step)))
        small = None if reference is None else small_grey(reference)
        shape = small_grey(np.zeros((height, width, 3), np.uint8)).shape
        self._clocks = ClockJudge(settings.clock_step_s)
        self._corrupt = CorruptJudge(settings.max_repeated_share)
        self._frozen = FrozenJudge(settings.frozen_after_s, road_mask(camera, grid, 0.0))
        self._view = ViewJudge(
            settings.max_shift_share,
            settings.moved_after_s,
            road_mask(camera, (shape[0], shape[1]), _VEHICLE_REACH),
            small,
        )
        self._usual = None if small is None else sharpness(small, texture(small))
        waits: dict[CameraFault, float] = {
            "clock_jump": 0.0,
            "dark": settings.exposure_after_s,
            "bright": settings.exposure_after_s,
            "corrupt": 0.0,
            "obscured": settings.exposure_after_s,
            "frozen": 0.0,
            "camera_moved": 0.0,
        }
        self._holds = {
            reason: Hold(after_s, settings.clear_after_s) for reason, after_s in waits.items()
        }
        self._sampled_s: float | None = None
        self._samples = 0
        self._obscured = self._moved = False
        self.fault: CameraFault | None = None

    def look(self, frame: Frame) -> CameraFault | None:
        """Judge one frame of the calibrated size.

        Returns:
            Why the camera cannot be trusted now; None while it can.
        """
        now_s = frame.media_time_s
        jumped = self._clocks.look(frame)
        if jumped or frame.cut:
            self._restart()
        if (
            self._sampled_s is not None
            and 0 <= now_s - self._sampled_s < self._settings.sample_interval_s
        ):
            if not jumped:
                return self.fault
            seen: CameraFault | None = None
        else:
            self._sampled_s = now_s
            seen = self._look_at(take_sample(now_s, frame.image))
        for reason, hold in self._holds.items():
            hold.update(now_s, jumped if reason == "clock_jump" else reason == seen)
        self.fault = next((r for r, hold in self._holds.items() if hold.active), None)
        return self.fault

    def absent(self, idle_s: float) -> CameraFault | None:
        """What to say while no picture comes.

        Args:
            idle_s: time since the last one.
        """
        if idle_s >= self._settings.stale_after_s:
            self._restart()
            return "stale"
        return self.fault

    def _restart(self) -> None:
        self._frozen.restart()
        self._view.restart()
        for hold in self._holds.values():
            hold.restart()

    def _look_at(self, sample: Sample) -> CameraFault | None:
        self._samples += 1
        seen: CameraFault | None = exposure(sample.grey)
        if seen is None and self._corrupt.look(sample):
            seen = "corrupt"
        if seen is None and self._samples % _VIEW_EVERY == 1:
            self._look_at_view(sample)
        if seen is None and self._obscured:
            seen = "obscured"
        if seen is not None:
            self._frozen.restart()
            return seen
        if self._frozen.look(sample.time_s, sample.grey):
            return "frozen"
        return "camera_moved" if self._moved else None

    def _look_at_view(self, sample: Sample) -> None:
        small = small_grey(sample.image)
        picture = texture(small)
        self._obscured = is_obscured(small, picture, self._usual)
        if self._obscured:
            self._view.restart()
            return
        was_learned = self._view.is_learned
        self._moved = self._view.look(sample.time_s, small, picture)
        if not was_learned and self._view.is_learned:
            self._usual = sharpness(small, picture)
