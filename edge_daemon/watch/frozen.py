"""A picture that stands still: exact repeats, or one picture encoded again and again.

A sensor's noise changes every pixel a little from picture to picture, also on an empty road. A
repeated picture changes nothing, or what an encoder makes of it: some pixels by a level or two.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from edge_daemon.watch.sample import Grey, Mask

_STILL_LEVELS = 0.12
_MOVED_LEVELS = 12
_MOVED_SHARE = 0.002
_STILL_SHARE = 0.75
_LEAST_ROAD_SHARE = 0.03
_FEWEST = 4


class FrozenJudge:
    """Compares sampled pixels of the road with those a moment ago."""

    def __init__(self, after_s: float, road: Mask) -> None:
        """Set it up.

        Args:
            after_s: without any change for so long the picture is frozen.
            road: which of the sampled pixels show the road. The rest is left out, since a clock
                drawn into the picture may go on; all count where the road is hardly in it.
        """
        self._after_s = after_s
        self._road = road if road.mean() >= _LEAST_ROAD_SHARE else np.ones_like(road)
        self._last: npt.NDArray[np.int16] | None = None
        self._still: deque[tuple[float, bool]] = deque()

    def look(self, time_s: float, grey: Grey) -> bool:
        """True if the road has not changed for `after_s`; pictures come in order of time."""
        pixels = grey[self._road].astype(np.int16)
        last, self._last = self._last, pixels
        if last is None:
            return False
        change = np.abs(pixels - last)
        if np.count_nonzero(change > _MOVED_LEVELS) > _MOVED_SHARE * change.size:
            self._still.clear()
            return False
        self._still.append((time_s, bool(change.mean() < _STILL_LEVELS)))
        began = self._still[0][0]
        while len(self._still) > 1 and self._still[1][0] <= time_s - self._after_s:
            self._still.popleft()
        # A key frame changes many pixels a little, also of a picture that stands still.
        still = sum(is_still for _, is_still in self._still)
        long_enough = time_s - began >= self._after_s and len(self._still) >= _FEWEST
        return long_enough and still >= _STILL_SHARE * len(self._still)

    def restart(self) -> None:
        """The next picture has no predecessor: after a cut."""
        self._last = None
        self._still.clear()
