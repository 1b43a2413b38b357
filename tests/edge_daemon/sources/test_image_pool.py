"""Memory for pictures: never given out while somebody looks at it, and used again after."""

from __future__ import annotations

from itertools import count, islice
from pathlib import Path

import cv2
import numpy as np

from edge_daemon.sources.image_pool import _MAX_KEPT, ImagePool

SHAPE = (4, 6, 3)


def test_a_picture_that_is_held_is_not_given_out_again() -> None:
    """Nor one of which only a part is held, through however many views."""
    pool = ImagePool(SHAPE)
    held = [pool.acquire() for _ in range(3)]
    assert len({id(picture) for picture in held}) == 3
    part = np.asarray(held[0][1:3])[:, ::2]
    where = held[0].ctypes.data
    held.clear()
    assert {pool.acquire().ctypes.data for _ in range(5)} != {where}
    assert all(not np.shares_memory(pool.acquire(), part) for _ in range(5))


def test_memory_is_used_again_once_nobody_holds_it() -> None:
    """A reader who keeps up needs one picture, and what a burst needed is not kept for ever."""
    pool = ImagePool(SHAPE)
    assert len({pool.acquire().ctypes.data for _ in range(20)}) == 1
    burst = [pool.acquire() for _ in range(3 * _MAX_KEPT)]
    assert len({picture.ctypes.data for picture in burst}) == 3 * _MAX_KEPT
    burst.clear()
    later = [pool.acquire() for _ in range(_MAX_KEPT)]
    assert len(pool._kept) == _MAX_KEPT
    assert len({picture.ctypes.data for picture in later}) == _MAX_KEPT


def test_a_video_decodes_into_it(tmp_path: Path) -> None:
    """OpenCV writes into the memory it is given: what it returns is that very picture."""
    path = tmp_path / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for level in islice(count(40, 50), 4):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    capture = cv2.VideoCapture(str(path))
    pool = ImagePool((48, 64, 3))
    levels = []
    for _ in range(4):
        blank = pool.acquire()
        ok, image = capture.read(blank)
        assert ok
        assert image is blank
        levels.append(round(float(image.mean())))
        del blank, image
    capture.release()
    assert levels == sorted(levels)
    assert len(pool._kept) == 1
