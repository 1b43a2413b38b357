"""Memory for pictures: never given out while somebody looks at it, and used again after."""

from __future__ import annotations

from itertools import count, islice
from pathlib import Path

import cv2
import numpy as np

from edge_daemon.sources.pictures import _MOST_KEPT, Pictures

SHAPE = (4, 6, 3)


def test_a_picture_that_is_held_is_not_given_out_again() -> None:
    """Nor one of which only a part is held, through however many views."""
    pictures = Pictures(SHAPE)
    held = [pictures.blank() for _ in range(3)]
    assert len({id(picture) for picture in held}) == 3
    part = np.asarray(held[0][1:3])[:, ::2]
    where = held[0].ctypes.data
    held.clear()
    assert {pictures.blank().ctypes.data for _ in range(5)} != {where}
    assert all(not np.shares_memory(pictures.blank(), part) for _ in range(5))


def test_memory_is_used_again_once_nobody_holds_it() -> None:
    """A reader who keeps up needs one picture, and what a burst needed is not kept for ever."""
    pictures = Pictures(SHAPE)
    assert len({pictures.blank().ctypes.data for _ in range(20)}) == 1
    burst = [pictures.blank() for _ in range(3 * _MOST_KEPT)]
    assert len({picture.ctypes.data for picture in burst}) == 3 * _MOST_KEPT
    burst.clear()
    later = [pictures.blank() for _ in range(_MOST_KEPT)]
    assert len(pictures._kept) == _MOST_KEPT
    assert len({picture.ctypes.data for picture in later}) == _MOST_KEPT


def test_a_video_decodes_into_it(tmp_path: Path) -> None:
    """OpenCV writes into the memory it is given: what it returns is that very picture."""
    path = tmp_path / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for level in islice(count(40, 50), 4):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    capture = cv2.VideoCapture(str(path))
    pictures = Pictures((48, 64, 3))
    levels = []
    for _ in range(4):
        blank = pictures.blank()
        ok, image = capture.read(blank)
        assert ok
        assert image is blank
        levels.append(round(float(image.mean())))
        del blank, image
    capture.release()
    assert levels == sorted(levels)
    assert len(pictures._kept) == 1
