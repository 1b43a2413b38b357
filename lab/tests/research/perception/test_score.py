"""Figures over several clips: classes."""

from __future__ import annotations

import numpy as np
import pytest

from slipstream_lab.research.perception.score import ClassScore, TrackComparison, TrueBoxes, score

CAR, MOTORCYCLE = 0, 3


def clip(kinds: list[int], followed: list[bool], errors: list[float]) -> TrackComparison:
    """A box for each of the vehicles 0, 1, ..., and a speed for those with an error."""
    return TrackComparison(
        frames=[],
        boxes=TrueBoxes(np.arange(len(kinds)), np.array(kinds), np.array(followed)),
        speed_errors_mps=np.array(errors),
        speed_covered=np.ones(len(errors), dtype=np.bool_),
        speed_kind=np.array(kinds[: len(errors)], dtype=np.int64),
        windows=[],
    )


def test_each_class_is_scored_by_itself_and_clips_are_added_up() -> None:
    """Vehicle 0 of one clip is not vehicle 0 of the other; a class that is not known is in none."""
    first = clip([CAR, MOTORCYCLE, -1], [True, False, False], [0.5])
    second = clip([CAR, CAR], [True, False], [-0.1])
    scores = score([first, second]).classes
    assert set(scores) == {"car", "motorcycle"}
    assert scores["car"] == ClassScore(3, pytest.approx(2 / 3), pytest.approx(0.3 * 3.6), 2)
    assert scores["motorcycle"] == ClassScore(1, 0.0, None, 0)
