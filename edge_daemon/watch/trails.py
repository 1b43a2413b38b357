"""Trails: what a decoder leaves on the road behind vehicles after lost or damaged packets.

A trail is fine contrast, at rest and under no box, where the bare road was seen to have none.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.watch.sample import Grey, Mask, texture

_CHANGED_LEVELS: Final = 10.0
_KNOWN_SAMPLES: Final = 20
_MEMORY_SAMPLES: Final = 150
_BOX_MARGIN: Final = 0.3
_BOX_MARGIN_PX: Final = 2.0
_MIN_SPOT_PX: Final = 12
_MIN_SPOTS: Final = 3
_MIN_SHARE: Final = 0.02
_MORE_THAN_VEHICLES: Final = 0.12
_REPEAT_LEVELS: Final = 0.12
"""Mean change of a repeated picture, encoded again, at most; a fixed real camera's are 0.19 and
more."""


class BareRoad:
    """Remembers what the road looks like where nothing covers it.

    What lies under a box, or moves, is not learned: a queue does not become road. What lies on the
    road for a minute or two does. The road is a mask of the small grey image, `zoom` times as wide
    as the frame.
    """

    def __init__(self, road: Mask, zoom: float) -> None:
        self._road = road
        self._zoom = zoom
        self.restart()

    def restart(self) -> None:
        """Forget all: the next frame may show another scene."""
        self._seen = np.zeros(self._road.shape, np.float32)
        self._levels = np.zeros(self._road.shape, np.float32)
        self._last: Grey | None = None

    def repeats(self, small: Grey) -> bool:
        """Whether a sample shows the road of the one before once more: what moves stands in it, and
        would look like trails now, and like road in a while.
        """
        last, self._last = self._last, small
        if last is None:
            return False
        change = cv2.absdiff(small, last)[self._road]
        return bool(change.sum() < _REPEAT_LEVELS * change.size)

    def has_trails(self, small: Grey, changed: Mask, boxes: npt.NDArray[np.float32]) -> bool:
        """Whether a sample shows trails; it is learned from then.

        Args:
            small: the `small_grey` copy of a frame.
            changed: where it differs from the sample before.
            boxes: of all that may be a vehicle in it, px of the frame, shape (n, 4).
        """
        bare = ~changed
        for left, top, right, bottom in (boxes * self._zoom).tolist():
            aside = _BOX_MARGIN * (right - left) + _BOX_MARGIN_PX
            above = _BOX_MARGIN * (bottom - top) + _BOX_MARGIN_PX
            rows = slice(max(0, int(top - above)), max(0, int(bottom + above) + 1))
            bare[rows, max(0, int(left - aside)) : max(0, int(right + aside) + 1)] = False
        found = self._is_marked(small, bare)
        self._seen[bare] += 1
        rate = 1 / np.minimum(self._seen[bare], _MEMORY_SAMPLES)
        self._levels[bare] += rate * (small[bare] - self._levels[bare])
        return found

    def _is_marked(self, small: Grey, bare: Mask) -> bool:
        known = bare & (self._seen >= _KNOWN_SAMPLES)
        changed = known & (np.abs(small - self._levels) > _CHANGED_LEVELS)
        if np.count_nonzero(changed & self._road) < _MIN_SHARE * np.count_nonzero(self._road):
            return False
        usual = np.where(known, self._levels, small.astype(np.float32))
        changed &= np.abs(texture(small - usual)) > _CHANGED_LEVELS
        on_road = changed & self._road
        road, rest = _share(changed, self._road), _share(changed, ~self._road)
        # A camera that has moved changes all of the picture, one undetected vehicle one spot.
        return road > max(_MIN_SHARE, rest) and (
            road > _MORE_THAN_VEHICLES or _spots(on_road) >= _MIN_SPOTS
        )


def _spots(found: Mask) -> int:
    """How many connected parts a mask has that are no specks."""
    near = cv2.dilate(found.astype(np.uint8), np.ones((3, 3), np.uint8))
    _, _, stats, _ = cv2.connectedComponentsWithStats(near, connectivity=8)
    return int(np.count_nonzero(stats[1:, cv2.CC_STAT_AREA] >= _MIN_SPOT_PX))


def _share(found: Mask, part: Mask) -> float:
    return float(np.count_nonzero(found & part)) / max(1, int(np.count_nonzero(part)))
