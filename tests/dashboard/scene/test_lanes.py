"""Roads drawn all at once lie where each of them would lie drawn alone."""

from __future__ import annotations

import numpy as np
import pytest

from dashboard.scene import geometry
from dashboard.scene.lanes import Lanes
from slipstream.roads import Segment, build_network
from slipstream.roads.sumo_net import load_network

DEMO = load_network("demo")


@pytest.fixture
def lanes() -> Lanes:
    """The demo's roads, with an arrow of 10 m each 300 m."""
    return Lanes(DEMO, arrow_every_m=300.0, arrow_m=10.0)


@pytest.fixture
def driven(lanes) -> tuple[np.ndarray, np.ndarray]:
    """All roads of the demo, the last one first and one of them twice, in lanes of their own."""
    roads = np.array([*reversed(range(len(DEMO.segments))), 3])
    return roads, np.linspace(5.0, 40.0, len(roads))


def _line(number: int, lane_m: float) -> np.ndarray:
    shape = list(DEMO.segments.values())[number].shape
    return geometry.offset(geometry.drop_repeated_points(shape), lane_m)


def test_lines_are_those_of_the_roads_drawn_alone(lanes, driven):
    """Each road's strokes are its line moved to its right, and say whose they are."""
    drawing = lanes.road_strokes(*driven)
    alone = [geometry.strokes(_line(*pair)) for pair in zip(*driven, strict=True)]
    np.testing.assert_allclose(drawing.strokes, np.concatenate(alone))
    owners = np.repeat(np.arange(len(alone)), [len(line) for line in alone])
    np.testing.assert_array_equal(drawing.part, owners)


def test_junctions_are_crossed_from_end_to_start(lanes, driven):
    """A stroke leads from where a road's line ends to where the next one's begins."""
    drawing = lanes.junction_strokes(*driven, np.array([0, 4]))
    ends = [_line(roads, lane) for roads, lane in zip(*driven, strict=True)]
    expected = [[ends[0][-1], ends[1][0]], [ends[4][-1], ends[5][0]]]
    np.testing.assert_allclose(drawing.strokes, expected)
    np.testing.assert_array_equal(drawing.part, [1, 5])


def test_arrows_are_on_their_lines_and_point_along_them(lanes, driven):
    """A road has an arrow each so many metres, at least one; all lie on its line, along it."""
    drawing = lanes.arrow_strokes(*driven)
    for part, (road, lane_m) in enumerate(zip(*driven, strict=True)):
        heads = drawing.strokes[drawing.part == part]
        centre = _line(road, 0.0)
        assert len(heads) == 2 * max(1, int(geometry.length_m(centre) // 300.0))
        line = _line(road, lane_m)
        for left, right in heads.reshape(-1, 2, 2, 2):
            np.testing.assert_allclose(left[1], right[1])
            tail = (left[0] + right[0]) / 2
            ahead = (left[1] - tail) / np.linalg.norm(left[1] - tail)
            place = left[1] - 5.0 * ahead
            starts, steps = line[:-1], np.diff(line, axis=0)
            length = np.linalg.norm(steps, axis=1)
            share = np.clip(np.sum((place - starts) * steps, axis=1) / length**2, 0.0, 1.0)
            away = np.linalg.norm(starts + share[:, None] * steps - place, axis=1)
            nearest = int(away.argmin())
            assert away[nearest] < 1e-6
            np.testing.assert_allclose(ahead, steps[nearest] / length[nearest], atol=1e-6)


def test_nothing_driven_is_nothing_drawn(lanes):
    """No roads give no strokes, not an error."""
    none = np.empty(0, dtype=np.int64)
    for drawing in (
        lanes.road_strokes(none, np.empty(0)),
        lanes.junction_strokes(none, np.empty(0), none),
        lanes.arrow_strokes(none, np.empty(0)),
    ):
        assert drawing.strokes.shape == (0, 2, 2)
        assert drawing.part.shape == (0,)


def test_odd_roads_stay_finite():
    """A road that repeats a point, turns back on itself or has no extent gives finite strokes."""
    shapes = {
        "repeats": ((0.0, 0.0), (0.0, 0.0), (50.0, 0.0)),
        "turns back": ((0.0, 0.0), (50.0, 0.0), (0.0, 0.0)),
        "nowhere": ((7.0, 7.0), (7.0, 7.0)),
    }
    segments = [Segment(name, "a", "b", 50.0, 10.0, 1, shape) for name, shape in shapes.items()]
    lanes = Lanes(build_network("odd", segments, {"a": (0, 0), "b": (50, 0)}, {}), 20.0, 5.0)
    roads, lanes_m = np.arange(3), np.full(3, 4.0)
    for drawing in (lanes.road_strokes(roads, lanes_m), lanes.arrow_strokes(roads, lanes_m)):
        assert set(drawing.part) == {0, 1, 2}
        assert np.isfinite(drawing.strokes).all()
