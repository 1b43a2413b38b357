"""IDF1 and HOTA on cases that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from slipstream_lab.research.perception.identity import FrameIdentities, hota, idf1
from slipstream_lab.simulation.training.metrics import box_iou


def frames(
    true: list[list[int]], found: list[list[int]], overlap: float = 1.0
) -> list[FrameIdentities]:
    """Frames in which the k-th true box lies under the k-th tracked one, and no others."""
    return [
        FrameIdentities(
            np.array(t, dtype=np.int64),
            np.array(f, dtype=np.int64),
            overlap * np.eye(len(t), len(f)),
        )
        for t, f in zip(true, found, strict=True)
    ]


def test_perfect_tracks_have_the_best_scores() -> None:
    """Whatever the identities are called."""
    perfect = frames([[1, 2]] * 10, [[7, 9]] * 10)
    assert idf1(perfect) == 1.0
    assert hota(perfect) == pytest.approx(1.0)


def test_one_switch_in_the_middle_halves_idf1() -> None:
    """Ten frames, a new identity after five: IDTP = 5, IDF1 = 2·5/20; HOTA's A = 1/2 throughout."""
    switched = frames([[1]] * 10, [[7]] * 5 + [[8]] * 5)
    assert idf1(switched) == pytest.approx(0.5)
    assert hota(switched) == pytest.approx(np.sqrt(0.5))


def test_missed_and_false_boxes_count() -> None:
    """Half of the frames missed: IDF1 = 2·5/15; one false box a frame: 2·10/30."""
    assert idf1(frames([[1]] * 10, [[7]] * 5 + [[]] * 5)) == pytest.approx(2 / 3)
    assert idf1(frames([[1]] * 10, [[7, 8]] * 10)) == pytest.approx(2 / 3)


def test_swapped_identities_are_seen_by_the_association() -> None:
    """Two vehicles that trade identities half-way: every box is found, none keeps its name."""
    swapped = frames([[1, 2]] * 10, [[7, 8]] * 5 + [[8, 7]] * 5)
    assert idf1(swapped) == pytest.approx(0.5)
    # Of each pair's 10 + 10 − 5 boxes 5 agree: A = 1/3, detection is perfect.
    assert hota(swapped) == pytest.approx(np.sqrt(1 / 3))


def test_loose_boxes_count_up_to_their_overlap() -> None:
    """At IoU 0.5 HOTA finds matches at ten of nineteen thresholds; IDF1 takes 0.5 as enough."""
    loose = frames([[1]] * 10, [[7]] * 10, overlap=0.5)
    assert hota(loose) == pytest.approx(10 / 19)
    assert idf1(loose) == 1.0
    assert idf1(frames([[1]] * 10, [[7]] * 10, overlap=0.49)) == 0.0


def test_nothing_to_compare_is_no_score() -> None:
    """Neither 0 nor 1."""
    assert idf1(frames([[]] * 3, [[]] * 3)) is None
    assert hota(frames([[]] * 3, [[]] * 3)) is None


def test_overlap_of_boxes() -> None:
    """Two unit squares shifted by half share a third."""
    one, other = np.array([[0.0, 0, 1, 1]]), np.array([[0.5, 0, 1.5, 1], [2, 2, 3, 3]])
    assert box_iou(one, other) == pytest.approx(np.array([[1 / 3, 0.0]]))
