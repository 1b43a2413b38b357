"""What the judges of a camera's faults have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from edge_daemon.watch.sample import Sample
from slipstream.messages import CameraFault


class FaultJudge(ABC):
    """Looks for one fault of a camera.

    Attributes:
        fault: its name in states and health messages.
        every_frame: it looks at every frame, whatever the others see; else at those that are
            sampled, unless an earlier judge sees a fault that hides the scene.
        hides_scene: while this fault is seen, the judges after this one cannot look.
        after_s: evidence without a break for so long begins the fault.
        detail: the figure that was last found above its limit, with the limit; empty: none.
    """

    fault: ClassVar[CameraFault]
    every_frame: ClassVar[bool] = False
    hides_scene: ClassVar[bool] = False
    after_s: ClassVar[float] = 0.0
    detail = ""

    @abstractmethod
    def look(self, sample: Sample) -> bool:
        """Whether there is evidence of the fault in a frame; frames come in order of time."""

    def interrupt(self, by: CameraFault | None) -> None:  # noqa: B027 - many have nothing to do
        """The next frame does not follow the last one that this judge looked at: another fault hid
        the scene, or, with None, the scene or the time line was cut.
        """
