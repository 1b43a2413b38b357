"""The ordered list of judges, and what a further one needs."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from edge_daemon.camera import Camera
from edge_daemon.frame import Frame, Image
from edge_daemon.settings import WatchSettings
from edge_daemon.watch import Watch
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.judges import make_judges
from edge_daemon.watch.sample import Sample
from edge_daemon.watch.view import View
from slipstream.messages import CAMERA_FAULTS, CameraFault

ROAD = np.random.default_rng(0).integers(60, 200, (720, 1280, 3), dtype=np.uint8)


class OnesJudge(FaultJudge):
    """A judge of a test's own: frames whose first pixel is 1."""

    fault: ClassVar[CameraFault] = "obscured"
    hides_scene: ClassVar[bool] = True
    after_s: ClassVar[float] = 0.5

    def look(self, sample: Sample) -> bool:
        """Whether the first pixel is 1."""
        return bool((sample.frame.image[0, 0] == 1).all())


def at(time_s: float, image: Image) -> Frame:
    """A frame whose clocks all agree."""
    return Frame(image, time_s, round(1e18 + 1e9 * time_s), time_s)


def test_every_fault_has_one_judge_in_the_order_of_precedence(camera: Camera) -> None:
    """`stale` alone has none: it is a fault without frames."""
    faults = [
        judge.fault for judge in make_judges(camera, WatchSettings(), None, View(camera, None))
    ]
    assert faults == [
        "clock_jump",
        "dark",
        "bright",
        "corrupt",
        "obscured",
        "frozen",
        "camera_moved",
        "blind",
    ]
    assert {*faults, "stale"} == set(CAMERA_FAULTS)


def test_a_judge_in_the_list_is_debounced_and_reported(
    camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing else has to know of it; a later one is told what hid the scene."""
    interrupted: list[CameraFault | None] = []

    class Later(OnesJudge):
        fault: ClassVar[CameraFault] = "frozen"

        def interrupt(self, by: CameraFault | None) -> None:
            interrupted.append(by)

    judges: tuple[FaultJudge, ...] = (OnesJudge(), Later())
    monkeypatch.setattr("edge_daemon.watch.watch.make_judges", lambda *_: judges)
    watch = Watch(camera, WatchSettings())
    ones = ROAD.copy()
    ones[0, 0] = 1
    faults = [watch.look(at(0.25 * n, ones if 5 <= n < 10 else ROAD)) for n in range(25)]
    began, ended = faults.index("obscured"), len(faults) - faults[::-1].index("obscured")
    assert (began, ended) == (7, 17)
    assert set(faults) == {None, "obscured"}
    assert interrupted == ["obscured"] * 5
