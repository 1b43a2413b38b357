"""`corrupt`: frames with decoding errors: flat or streaky parts, wrong macroblocks, trails.

How much of a view is flat is held against its own history, which begins with the picture that it
was calibrated on: a stream that is damaged from its first frame on is noticed too.

After lost or damaged packets a decoder goes on with what it has: vehicles leave trails on the road
until the next key frame, and no error is told (`trails`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import ClassVar, Final

import numpy as np

from edge_daemon.frame import Image
from edge_daemon.watch.background import Background
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.sample import Mask, Sample, grid_step, to_grey
from edge_daemon.watch.trails import BareRoad
from slipstream.messages import CameraFault

_MAX_REPEATED_SHARE: Final = 0.25
"""A frame is damaged if so much of what is not usually `repeated` is."""
_BLOCK_PX: Final = 16
_MAX_BLOCK_LEVELS: Final = 6.0
_BLACK: Final = 16
_WHITE: Final = 240
_RECENT_FRAMES: Final = 10
_MIN_DAMAGED: Final = 2
_TRAIL_SAMPLES: Final = 10
_RUN_SHARE: Final = 0.25
_MEMORY_SAMPLES: Final = 300
_KNOWN_SAMPLES: Final = 20
_MAX_SUDDEN: Final = 0.35
_MASK_S: Final = 60.0


def repeated(image: Image) -> Mask:
    """Which sampled pixels, BGR (h, w, 3), lie in long runs of exactly one colour, down or (if
    more) across, shape (h, w).

    A decoder fills lost parts with one colour or with streaks, over a good part of the picture.
    Smooth roads and low bit rates make neighbours agree too, but over short distances: in 18 real
    clips at most 3 % of a picture lie in runs of `_RUN_SHARE`. Black and white do not count: night,
    glare and drawn text agree too.
    """
    down, across = _same(image)
    lost_down, lost_across = _in_runs(down), _in_runs(across.T).T
    more_down = np.count_nonzero(lost_down) >= np.count_nonzero(lost_across)
    return lost_down if more_down else lost_across


def repeated_share(image: Image) -> float:
    """Share of sampled pixels that exactly equal the one above (or, if more, the one beside) them.

    Healthy views have 0.02 to 0.6, by how smooth they are and how they are encoded: it tells
    something only beside what is usual.
    """
    down, across = _same(image)
    return max(np.count_nonzero(down), np.count_nonzero(across)) / max(1, image.size // 3)


def _same(image: Image) -> tuple[Mask, Mask]:
    """Which sampled pixels equal the one above, (h - 1, w), and the one before, (h, w - 1)."""
    grey = to_grey(image)
    wide = image.astype(np.uint32)
    codes = wide[..., 0] << 16 | wide[..., 1] << 8 | wide[..., 2]
    counts = (grey >= _BLACK) & (grey <= _WHITE)
    return (codes[1:] == codes[:-1]) & counts[1:], (codes[:, 1:] == codes[:, :-1]) & counts[:, 1:]


def _in_runs(same: Mask) -> Mask:
    """Which pixels (n, m) lie in runs along the first axis that span `_RUN_SHARE` of it or more, by
    whether each equals the one before it, shape (n - 1, m).
    """
    length = len(same) + 1
    needed = max(1, round(_RUN_SHARE * length) - 1)
    steps = np.zeros((length + 1, same.shape[1]), np.int32)
    if len(same) >= needed:
        total = np.zeros_like(steps[:-1])
        same.cumsum(axis=0, out=total[1:])
        begins = total[needed:] - total[:-needed] == needed
        steps[: len(begins)] += begins
        steps[needed + 1 :] -= begins
    return np.asarray(steps[:-1].cumsum(axis=0) > 0)


def blockiness(image: Image) -> float:
    """How much stronger grey levels step at the edges of macroblocks than elsewhere, levels."""
    step = grid_step(image.shape[1])
    rows = to_grey(np.ascontiguousarray(image[step // 2 :: 2 * step])).astype(np.int16)
    steps = np.abs(np.diff(rows, axis=1)).mean(axis=0)
    at_edge = np.arange(1, steps.size + 1) % _BLOCK_PX == 0
    if not at_edge.any() or at_edge.all():
        return 0.0
    return float(steps[at_edge].mean() - steps[~at_edge].mean())


class CorruptJudge(FaultJudge):
    """Looks for damaged frames, of which a single one does no harm, and for trails.

    Args:
        usual_share: what is `repeated` in the calibrated view; 0 where it is not known.
        road: which of the sampled pixels show the road.
        background: of the view; this judge takes the samples in.
        bare_road: what trails are told from.
        is_blind: whether vehicles are not detected, which then look like trails.
    """

    fault: ClassVar[CameraFault] = "corrupt"
    hides_scene: ClassVar[bool] = True

    def __init__(
        self,
        usual_share: float,
        road: Mask,
        background: Background,
        bare_road: BareRoad,
        is_blind: Callable[[], bool],
    ) -> None:
        self._usual_share = usual_share
        self._road = road
        self._damaged_since_s: float | None = None
        self._usual_repeated, self._samples = 0.0, 0
        self._recent: deque[bool] = deque(maxlen=_RECENT_FRAMES)
        self._background = background
        self._bare_road = bare_road
        self._is_blind = is_blind
        self._trails: deque[bool] = deque(maxlen=_TRAIL_SAMPLES)

    def look(self, sample: Sample) -> bool:
        """True if this frame and another of the last ten are damaged, or trails last for 2 s."""
        damaged = self._is_filled(sample) | self._is_sudden(sample.colours) or self._is_blocky(
            sample
        )
        self._recent.append(damaged)
        if damaged:
            return sum(self._recent) >= _MIN_DAMAGED
        return self._has_trails(sample)

    def _is_filled(self, sample: Sample) -> bool:
        """Whether more of the frame is flat or streaked than the view's own history explains."""
        lost = repeated(sample.colours)
        share = float(lost.mean())
        limit = self._usual_share + _MAX_REPEATED_SHARE * (1 - self._usual_share)
        if share <= limit:
            self._damaged_since_s = None
            self._usual_share += (share - self._usual_share) / _MEMORY_SAMPLES
            return False
        self.detail = f"{share:.2f} of the picture is flat or streaked, limit {limit:.2f}"
        if self._damaged_since_s is None:
            self._damaged_since_s = sample.time_s
        hides_road = self._road.any() and lost[self._road].mean() > _MAX_REPEATED_SHARE
        if sample.time_s - self._damaged_since_s >= _MASK_S and not hides_road:
            # Beside the road, and there to stay: a mask, or what the camera draws.
            self._usual_share = share
        return True

    def _is_sudden(self, colours: Image) -> bool:
        """Whether far more pixels equal their neighbours than did over the last minute. It is
        learned from each frame: an encoder that is set anew is unusual for a minute only.
        """
        share = repeated_share(colours)
        limit = self._usual_repeated + _MAX_SUDDEN * (1 - self._usual_repeated)
        self._samples = min(self._samples + 1, _MEMORY_SAMPLES)
        self._usual_repeated += (share - self._usual_repeated) / self._samples
        if self._samples <= _KNOWN_SAMPLES or share <= limit:
            return False
        if self._damaged_since_s is None:
            self.detail = f"{share:.2f} of the pixels equal their neighbours, limit {limit:.2f}"
        return True

    def _is_blocky(self, sample: Sample) -> bool:
        levels = blockiness(sample.frame.image)
        if levels <= _MAX_BLOCK_LEVELS:
            return False
        self.detail = (
            f"macroblocks step by {levels:.1f} levels at their edges, limit {_MAX_BLOCK_LEVELS:g}"
        )
        return True

    def interrupt(self, by: CameraFault | None) -> None:
        """Damage counts across gaps; the road may look different after one."""
        self._background.restart()
        self._bare_road.restart()
        self._trails.clear()

    def _has_trails(self, sample: Sample) -> bool:
        boxes = sample.boxes if sample.all_boxes is None else sample.all_boxes
        if boxes is not None:
            self._background.update(sample.steady)
            changed = self._background.changed
            if not self._bare_road.repeats(sample.steady) and changed is not None:
                found = self._bare_road.has_trails(sample.steady, changed, boxes)
                self._trails.append(found and not self._is_blind())
        seen = sum(self._trails)
        if 2 * seen <= _TRAIL_SAMPLES:
            return False
        self.detail = f"trails on the road in {seen} of {len(self._trails)} samples"
        return True
