"""A camera on loopback that shows a clip five times a second, and can fail as cameras do."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Final, Literal

import cv2
import numpy as np

from slipstream_lab.simulation.live.stream import LatestPicture, MjpegServer

CameraFaultKind = Literal["frozen", "black", "corrupt", "gone"]
FPS: Final = 5.0
"""Enough for flags, and a third of the processor time of the demo's cameras."""
NOTICED_S: Final[dict[CameraFaultKind, float]] = {
    "frozen": 6.0,
    "black": 2.0,
    "corrupt": 2.0,
    "gone": 4.0,
}
"""Within how long the edge notices each, s: docs/operations.md, camera faults."""


class FaultyCamera:
    """Shows a clip over and over. `fault`: what is wrong with it now; None: nothing."""

    def __init__(self, clip: Path) -> None:
        self.fault: CameraFaultKind | None = None
        self._pictures = _pictures(clip)
        self._black = _jpeg(np.zeros((720, 1280, 3), np.uint8))
        self._latest = LatestPicture()
        self._server = MjpegServer(self._latest)
        self.url = self._server.url
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Switch it off."""
        self._ended.set()
        self._thread.join()
        self._server.close()

    def _show(self) -> None:
        began, number, shown = time.monotonic(), 0, self._pictures[0]
        while not self._ended.wait(max(0.0, began + number / FPS - time.monotonic())):
            number += 1
            picture = self._pictures[number % len(self._pictures)]
            fault = self.fault
            if fault == "gone":
                continue
            if fault is None:
                shown = picture
            self._latest.put(
                {"black": self._black, "corrupt": _corrupt(picture)}.get(fault or "", shown),
                time.time(),
            )


def _pictures(clip: Path) -> list[bytes]:
    """Each third picture of a clip of 15 a second, as JPEG."""
    video = cv2.VideoCapture(str(clip))
    step = round(video.get(cv2.CAP_PROP_FPS) / FPS)
    found, number = [], 0
    while True:
        is_there, picture = video.read()
        if not is_there:
            break
        if number % step == 0:
            found.append(_jpeg(picture))
        number += 1
    video.release()
    return found


def _jpeg(picture: np.ndarray) -> bytes:
    is_done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
    assert is_done
    return data.tobytes()


def _corrupt(jpeg: bytes) -> bytes:
    """The upper two fifths arrive; the rest is lost, as on a bad line."""
    return jpeg[: 2 * len(jpeg) // 5] + b"\xff\xd9"
