"""Average precision equals values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.detection.region import Region
from slipstream_lab.simulation.training.metrics import Boxes, average_precision, box_iou, evaluate
from slipstream_lab.simulation.training.validation import decode, letterbox


def boxes(*rows: tuple[float, float, float, float, int, float]) -> Boxes:
    """Boxes from rows x1, y1, x2, y2, class, score."""
    table = np.array(rows, dtype=float).reshape(-1, 6)
    return Boxes(table[:, :4], table[:, 4].astype(np.int64), table[:, 5])


A = (0.0, 0.0, 10.0, 10.0, 0, 1.0)
B = (20.0, 0.0, 30.0, 10.0, 0, 1.0)


def test_iou_of_half_overlap_is_a_third():
    """Two equal boxes that share half their area have IoU 1/3."""
    assert box_iou(np.array([[0.0, 0, 10, 10]]), np.array([[5.0, 0, 15, 10]]))[
        0, 0
    ] == pytest.approx(1 / 3)


def test_perfect_answers_score_one():
    """Found equal to true gives mAP 1 at every threshold, whatever the other classes."""
    figures = evaluate([boxes(A, B)], [boxes(A, B)], 2)
    assert figures.map50 == figures.map50_95 == pytest.approx(1.0)
    assert figures.boxes == (2, 0)


def test_one_of_two_found_scores_half():
    """Precision 1 up to recall 0.5 fills 51 of 101 recall points."""
    assert average_precision([boxes(A)], [boxes(A, B)], 0, 0.5) == pytest.approx(51 / 101)


def test_a_false_box_before_a_true_one_halves_precision():
    """A better-scored miss leaves precision 1/2 at full recall."""
    false = (50.0, 50.0, 60.0, 60.0, 0, 0.9)
    found = boxes(false, (*A[:4], 0, 0.5))
    assert average_precision([found], [boxes(A)], 0, 0.5) == pytest.approx(0.5)


def test_a_true_box_counts_once():
    """The second box on the same vehicle is false, but costs nothing after full recall."""
    found = boxes((*A[:4], 0, 0.9), (*A[:4], 0, 0.8))
    assert average_precision([found], [boxes(A)], 0, 0.5) == pytest.approx(1.0)
    late = boxes((*A[:4], 0, 0.9), (*A[:4], 0, 0.8), (*B[:4], 0, 0.7))
    expected = (51 + 50 * 2 / 3) / 101
    assert average_precision([late], [boxes(A, B)], 0, 0.5) == pytest.approx(expected)


def test_nothing_found_scores_zero():
    """No answer gives AP 0."""
    assert average_precision([boxes()], [boxes(A)], 0, 0.5) == 0.0


def test_low_boxes_are_left_out_on_both_sides():
    """With a least height, a low true box is not missed and a low answer is not held against us."""
    low, lower = (50.0, 0.0, 60.0, 8.0, 0, 0.95), (70.0, 0.0, 80.0, 5.0, 0, 0.9)
    found = boxes(low, lower, (*A[:4], 0, 0.8))
    assert average_precision([found], [boxes(A, low)], 0, 0.5, 9.0) == pytest.approx(1.0)
    assert average_precision([found], [boxes(A, low)], 0, 0.5) < 1.0
    figures = evaluate([found], [boxes(A, low)], 1, 9.0)
    assert figures.boxes == (1,)


def test_letterbox_and_decode_are_inverse():
    """A box in the network's pixels comes back in picture pixels, without the bars."""
    image = np.full((720, 1280, 3), 200, dtype=np.uint8)
    planes, placement = letterbox(image, (384, 640))
    assert planes.shape == (1, 3, 384, 640)
    assert placement.inner == Region(0, 12, 640, 372)
    assert planes[0, 0, 0, 0] == pytest.approx(114 / 255)
    assert planes[0, 0, 12, 0] == pytest.approx(200 / 255)
    output = np.zeros((1, 8, 3), dtype=np.float32)
    output[0, :4, 0] = (100.0, 112.0, 20.0, 40.0)
    output[0, 4 + 2, 0] = 0.8
    output[0, :, 1] = output[0, :, 0] * np.array([1, 1, 1, 1, 1, 1, 0.5, 1])
    found = decode(output, placement, np.array([3, 0, 1, -1]))
    assert found.classes.tolist() == [1]
    assert found.corners[0] == pytest.approx([180.0, 160.0, 220.0, 240.0])
    assert found.scores[0] == pytest.approx(0.8)
