"""What a calibration looks at: a picture, or seconds of a clip or a camera and their median."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from edge_daemon.frame import Frame, Image, read_image
from edge_daemon.settings import SourceSettings
from edge_daemon.sources import mark_repeats
from edge_daemon.sources.camera import open_camera
from edge_daemon.sources.clip import FastClip, open_clip
from slipstream.config import check
from slipstream.errors import InputError

SECONDS: Final = 10.0
_MAX_FPS: Final = 31.0
_MEDIAN_OF: Final = 25
_JPEG_QUALITY: Final = 95
_STALL_S: Final = 15.0


@dataclass(frozen=True)
class Recording:
    """Some seconds of a view: their median, or the picture that was given; media times of the
    frames, none repeated, and the frames as JPEG, none of a picture.
    """

    picture: Image
    times_s: tuple[float, ...]
    jpegs: tuple[bytes, ...]

    def frames(self) -> Iterator[tuple[float, Image]]:
        """Time and picture of each frame."""
        for time_s, data in zip(self.times_s, self.jpegs, strict=True):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
            yield time_s, np.asarray(image, dtype=np.uint8)


def record(image: str, fps: float | None = None) -> Recording:
    """Look at a picture, the first seconds of a clip, which was filmed at `fps` if it does not say,
    or some seconds of a camera by its URL.

    Raises:
        InputError: it is none of them, or no frame came.
    """
    if "://" in image:
        url = check({"url": image}, SourceSettings, "--image").url
        assert url is not None
        source = open_camera(url, _STALL_S)
        try:
            return _recorded(source.frames(), image)
        finally:
            source.close()
    path = Path(image)
    picture = read_image(path)
    if picture is not None:
        return Recording(picture, (), ())
    clip = FastClip(open_clip(path, loop=False, fps=fps))
    try:
        return _recorded(clip.frames(), image)
    finally:
        clip.close()


def _recorded(frames: Iterator[Frame | None], name: str) -> Recording:
    times: list[float] = []
    jpegs: list[bytes] = []
    waited = 0
    for frame in mark_repeats(frames):
        if frame is None:
            waited += 1
            if waited > _STALL_S:
                break
            continue
        if times and frame.media_time_s - times[0] > SECONDS:
            break
        if frame.repeated or (times and frame.media_time_s - times[-1] < 1 / _MAX_FPS):
            continue
        ok, data = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        if ok:
            times.append(frame.media_time_s)
            jpegs.append(data.tobytes())
    if not jpegs:
        raise InputError(name, "no picture came", "check the address and the camera")
    recording = Recording(np.zeros((1, 1, 3), np.uint8), tuple(times), tuple(jpegs))
    chosen = {int(i) for i in np.linspace(0, len(jpegs) - 1, min(_MEDIAN_OF, len(jpegs)))}
    some = [image for i, (_, image) in enumerate(recording.frames()) if i in chosen]
    median = np.asarray(np.median(np.stack(some), axis=0), dtype=np.uint8)
    return Recording(median, tuple(times), tuple(jpegs))
