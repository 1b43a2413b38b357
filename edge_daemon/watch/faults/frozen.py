"""`frozen`: the same frame again and again.

A sensor's noise changes every pixel a little from frame to frame, on an empty road too. A repeated
frame changes nothing, or, encoded again, some pixels by a level or two. Where noise was added to
the repeated frame, its vehicles tell: all have stopped at once.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, Camera
from edge_daemon.detection import box_feet
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.sample import Mask, Sample
from slipstream.messages import CameraFault

_STILL_S: Final = 5.0
"""Without any change on the road, not even noise, for so long the frame is frozen."""
_STILL_LEVELS: Final = 0.12
LEVELS: Final = 12
SHARE: Final = 0.002
_MIN_STILL_SHARE: Final = 0.75
_MIN_ROAD_SHARE: Final = 0.03
_MIN_FRAMES: Final = 4
_FAST_MPS: Final = 8.0
_MAX_BRAKING_S: Final = 0.65
"""Nothing brakes from `_FAST_MPS` to a stand within this time, let alone everything."""
_MIN_FAST: Final = 2
_BOX_ERROR_PX: Final = 1.5
_MAX_MPS: Final = 60.0
_AT_REST_M: Final = 0.3
_STEADY_M: Final = 0.5
"""More than a change of speed displaces a vehicle in the time between two samples."""
_MIN_AT_REST: Final = 0.8


class FrozenJudge(FaultJudge):
    """Compares the road's pixels and its vehicles' places with those of the sample before, for
    `still_s`.

    Other pixels are left out, as a clock drawn into the frame may go on; all count where little of
    the frame is road.
    """

    fault: ClassVar[CameraFault] = "frozen"

    def __init__(self, road: Mask, camera: Camera) -> None:
        self._road = road if road.mean() >= _MIN_ROAD_SHARE else np.ones_like(road)
        self._last: npt.NDArray[np.int16] | None = None
        self._still: deque[tuple[float, bool]] = deque()
        self._halt = _Halt(camera)

    def look(self, sample: Sample) -> bool:
        """True if the road has not changed, or all vehicles have stood at once, for so long."""
        halted_s = self._halt.update(sample)
        return self._is_unchanged(sample) or halted_s >= _STILL_S

    def interrupt(self, by: CameraFault | None) -> None:
        """The next frame has no predecessor."""
        self._last = None
        self._still.clear()
        self._halt.restart()

    def _is_unchanged(self, sample: Sample) -> bool:
        time_s = sample.time_s
        pixels = sample.grey[self._road].astype(np.int16)
        last, self._last = self._last, pixels
        if last is None:
            return False
        change = np.abs(pixels - last)
        if np.count_nonzero(change > LEVELS) > SHARE * change.size:
            self._still.clear()
            return False
        self._still.append((time_s, bool(change.mean() < _STILL_LEVELS)))
        began = self._still[0][0]
        while len(self._still) > 1 and self._still[1][0] <= time_s - _STILL_S:
            self._still.popleft()
        # A key frame changes many pixels a little even where the scene is frozen.
        still = sum(is_still for _, is_still in self._still)
        long_enough = time_s - began >= _STILL_S and len(self._still) >= _MIN_FRAMES
        return long_enough and still >= _MIN_STILL_SHARE * len(self._still)


class _Halt:
    """For how long all vehicles have stood that were moving fast the moment before."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.restart()

    def restart(self) -> None:
        """The next frame has no predecessor."""
        self._recent: deque[_Places] = deque(maxlen=2)
        self._fast: tuple[float, _Places] | None = None
        self._began: _Places | None = None

    def update(self, sample: Sample) -> float:
        """Take in a sample and tell how long the halt has lasted, s; 0: there is none."""
        if sample.boxes is not None:
            now = _places(self._camera, sample)
            if len(self._recent) == 2:
                self._compare(now, *self._recent)
            self._recent.append(now)
        return 0.0 if self._began is None else sample.time_s - self._began.time_s

    def _compare(self, now: _Places, earlier: _Places, last: _Places) -> None:
        if self._began is not None:
            if not now.stands_on(self._began):
                self._began = None
        elif now.fast_ones(last, earlier) >= _MIN_FAST:
            self._fast = now.time_s, last
        elif self._fast is not None:
            fast_s, before = self._fast
            # Of those that stand now some were moving: others may have stood all the time.
            if now.time_s - fast_s > _MAX_BRAKING_S:
                self._fast = None
            elif now.stands_on(last) and now.arrived_since(before) >= _MIN_FAST:
                self._began = last


@dataclass(frozen=True)
class _Places:
    """Where the vehicles of a sample are on the road, shape (n, 2), and how far a box that is off
    by `_BOX_ERROR_PX` displaces each, shape (n,).
    """

    time_s: float
    road_m: Array
    error_m: Array

    def _moved_m(self, before: _Places) -> Array:
        """Distance of each vehicle from the nearest place of an earlier sample, shape (n,)."""
        if not len(before.road_m):
            return np.full(len(self.road_m), np.inf)
        apart = np.linalg.norm(self.road_m[:, None] - before.road_m[None], axis=2)
        return np.asarray(apart.min(axis=1))

    def fast_ones(self, last: _Places, earlier: _Places) -> int:
        """How many vehicles surely went faster than `_FAST_MPS` through three samples. One that was
        not detected for a moment has others beside it, not behind it: a place that was left counts
        only if nobody stands there now.
        """
        step_s, step_before_s = self.time_s - last.time_s, last.time_s - earlier.time_s
        if not (len(self.road_m) and len(last.road_m) and len(earlier.road_m)) or step_s <= 0:
            return 0
        left = last.road_m[last._moved_m(self) > _AT_REST_M + 2 * last.error_m]
        count = 0
        for place, error_m in zip(self.road_m, self.error_m, strict=True):
            steps = place - left
            before = left - steps * step_before_s / step_s
            speeds = (np.linalg.norm(steps, axis=1) - 2 * error_m) / step_s
            apart = np.linalg.norm(before[:, None] - earlier.road_m[None], axis=2).min(axis=1)
            goes_on = apart <= _STEADY_M + 3 * error_m
            count += bool(((speeds > _FAST_MPS) & (speeds < _MAX_MPS) & goes_on).any())
        return count

    def arrived_since(self, before: _Places) -> int:
        """How many vehicles are surely where none was in an earlier sample."""
        return int(np.count_nonzero(self._moved_m(before) > _AT_REST_M + 2 * self.error_m))

    def stands_on(self, before: _Places) -> bool:
        """Whether nearly all vehicles are where some were in an earlier sample."""
        at_rest = self._moved_m(before) <= _AT_REST_M + 2 * self.error_m
        return len(at_rest) >= _MIN_FAST and float(at_rest.mean()) >= _MIN_AT_REST


def _places(camera: Camera, sample: Sample) -> _Places:
    assert sample.boxes is not None
    places = box_feet(sample.boxes.astype(np.float64))
    road_m, jacobian = camera.to_road_with_jacobian(places)
    known = np.isfinite(road_m).all(axis=1)
    error_m = _BOX_ERROR_PX * np.linalg.norm(jacobian, axis=(1, 2))
    return _Places(sample.time_s, road_m[known], error_m[known])
