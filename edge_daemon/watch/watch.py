"""All judges together: what, if anything, is wrong with the camera now."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Camera
from edge_daemon.detection import Detections, box_feet
from edge_daemon.frame import Frame, Image
from edge_daemon.settings import WatchSettings
from edge_daemon.watch.debounce import Debounce
from edge_daemon.watch.judges import make_judges
from edge_daemon.watch.sample import Sample
from edge_daemon.watch.view import View, ViewMotion
from slipstream.messages import CameraFault

SAMPLE_INTERVAL_S: Final = 0.2
"""Media time between two frames that are examined."""
STALE_AFTER_S: Final = 3.0
"""Time without a new frame."""
_CLEAR_AFTER_S: Final = 2.0
"""Every fault ends after so long without evidence of it."""


class Watch:
    """Looks at the frames of one camera for faults; no I/O and no clock of its own. Of several
    faults it reports the first one in the order of `make_judges`, whose arguments it takes.
    """

    def __init__(
        self, camera: Camera, settings: WatchSettings, reference: Image | None = None
    ) -> None:
        self._view = View(camera, reference)
        self._judges = make_judges(camera, settings, reference, self._view)
        self._debounces = {
            judge.fault: Debounce(judge.after_s, _CLEAR_AFTER_S) for judge in self._judges
        }
        self._sampled_s: float | None = None
        self._samples = 0
        self.fault: CameraFault | None = None

    @property
    def detail(self) -> str:
        """What is known of the fault beside its name; empty: nothing."""
        return next((judge.detail for judge in self._judges if judge.fault == self.fault), "")

    def look(
        self,
        frame: Frame,
        boxes: npt.NDArray[np.float32] | None = None,
        all_boxes: npt.NDArray[np.float32] | None = None,
    ) -> CameraFault | None:
        """Judge one frame of the calibrated size, with the boxes of a `Sample`: why the camera
        cannot be trusted now; None while it can.
        """
        now_s = frame.media_time_s
        is_sampled = self._sampled_s is None or not (
            0 <= now_s - self._sampled_s < SAMPLE_INTERVAL_S
        )
        sample = Sample(frame, self._samples + is_sampled, boxes, all_boxes)
        if not frame.repeated:
            self._view.measure(sample.detail)
        motion = self._view.motion
        if motion is not None:
            sample.shift = motion.shift
            sample.boxes = None if boxes is None else _taken_back(boxes, motion)
            sample.all_boxes = None if all_boxes is None else _taken_back(all_boxes, motion)
        seen = {judge.fault for judge in self._judges if judge.every_frame and judge.look(sample)}
        if seen or frame.cut:
            self._interrupt()
        if not is_sampled and not seen:
            return self.fault
        if is_sampled:
            self._sampled_s, self._samples = now_s, sample.number
            seen |= self._look_at(sample)
        for fault, debounce in self._debounces.items():
            debounce.update(now_s, fault in seen)
        self.fault = next((f for f, debounce in self._debounces.items() if debounce.active), None)
        return self.fault

    def steady(self, found: Detections) -> Detections:
        """The detections of the frame that was looked at last, where they would be in the
        calibrated view: the camera's own movement is taken out. As they are where it is not known.
        """
        motion = self._view.motion
        return found if motion is None else replace(found, boxes=_taken_back(found.boxes, motion))

    def absent(self, idle_s: float) -> CameraFault | None:
        """The fault while no frame comes, `idle_s` after the last one."""
        if idle_s >= STALE_AFTER_S:
            self._interrupt()
            return "stale"
        return self.fault

    def _interrupt(self) -> None:
        for judge in self._judges:
            judge.interrupt(None)
        for debounce in self._debounces.values():
            debounce.restart()

    def _look_at(self, sample: Sample) -> set[CameraFault]:
        """The first fault that is seen in a sampled frame, if any."""
        seen: list[CameraFault] = []
        hidden_by: CameraFault | None = None
        for judge in self._judges:
            if judge.every_frame:
                continue
            if hidden_by is not None:
                judge.interrupt(hidden_by)
            elif judge.look(sample):
                seen.append(judge.fault)
                hidden_by = judge.fault if judge.hides_scene else None
        return set(seen[:1])


def _taken_back(boxes: npt.NDArray[np.float32], motion: ViewMotion) -> npt.NDArray[np.float32]:
    """Boxes (n, 4), px, where they would be in the calibrated view."""
    moved = motion.at(box_feet(boxes)).astype(np.float32)
    return np.asarray(boxes - np.hstack([moved, moved]))
