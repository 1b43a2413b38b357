"""Labels that a browser shows never overlap, whatever there is to label."""

from __future__ import annotations

import numpy as np
import pytest

from dashboard.scene import labelling
from dashboard.scene.canvas import FOV_RAD, fit_box
from dashboard.scene.labelling import MAX_LABELS, fitting, rectangles
from dashboard.scene.marks import Eye, Mark, at_pixel


def _eye(position, look_at, width_px=1000, height_px=700) -> Eye:
    ahead = np.asarray(look_at) - np.asarray(position)
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    turn = np.column_stack((right, np.cross(ahead, right), ahead))
    return Eye(np.asarray(position, dtype=float), turn, FOV_RAD, width_px, height_px)


EYE = _eye((0.0, -8.0, 9.0), (0.0, 0.0, 0.0))


def _marks(count: int, seed: int = 0, kind="van") -> list[Mark]:
    rng = np.random.default_rng(seed)
    return [
        Mark(kind, f"{kind}-{n}", f"{kind}-{n}" * (1 + n % 3), (*rng.uniform(-4, 4, 2), 0.1))
        for n in range(count)
    ]


def _overlaps(boxes: np.ndarray) -> int:
    left, top, right, bottom = boxes.T
    beside = (left[:, None] < right) & (right[:, None] > left)
    over = (top[:, None] < bottom) & (bottom[:, None] > top)
    return int((beside & over).sum() - len(boxes)) // 2


@pytest.mark.parametrize("count", [1, 30, 300, 3000])
def test_no_two_labels_overlap(count):
    """Of any number of marks those are labelled that fit, inside the canvas."""
    marks = _marks(count)
    shown = fitting(EYE, marks)
    boxes = rectangles(EYE, shown)
    assert _overlaps(boxes) == 0
    assert count < 30 or _overlaps(rectangles(EYE, marks)) > 0
    assert min(count, 15) <= len(shown) <= MAX_LABELS
    assert (boxes >= 0).all()
    assert (boxes[:, 2] <= EYE.width_px).all()
    assert (boxes[:, 3] <= EYE.height_px).all()


def test_what_matters_is_labelled_first():
    """Of labels in one place: the selected, what is in trouble, then by kind."""
    here = (0.0, 0.0, 0.1)
    road = Mark("road", "r", "a road", here)
    van = Mark("van", "v", "a van", here)
    rsu = Mark("rsu", "u", "a camera", here)
    silent = Mark("rsu", "s", "a silent camera", here, urgent=True)
    assert fitting(EYE, [road, rsu, van]) == [van]
    assert fitting(EYE, [road, rsu, van, silent]) == [silent]
    assert fitting(EYE, [road, rsu, van, silent], first=road) == [road]


def test_labels_stay_where_they_were():
    """Among equals those shown before are kept, though others come nearer."""
    near = Mark("van", "near", "a van", (0.0, -0.2, 0.1))
    far = Mark("van", "far", "a van", (0.0, -0.1, 0.1))
    assert fitting(EYE, [near, far]) == [near]
    assert fitting(EYE, [near, far], kept={("van", "far")}) == [far]


def test_nothing_behind_the_camera():
    """Marks behind the camera have no label and cannot be clicked."""
    behind = Mark("van", "v", "a van", (0.0, -20.0, 18.0))
    assert fitting(EYE, [behind]) == []
    middle = np.array([EYE.width_px / 2, EYE.height_px / 2])
    assert at_pixel(EYE, [behind], middle) is None


def test_a_click_takes_the_nearest_vehicle():
    """A click beside a vehicle selects it, far from all none; vehicles go before cameras."""
    vans, cameras = _marks(20, seed=3), _marks(20, seed=3, kind="rsu")
    pixels, _ = EYE.pixels(np.array([van.position for van in vans]))
    for van, pixel in zip(vans, pixels, strict=True):
        apart = np.sort(np.hypot(*(pixels - pixel).T))[1]
        if apart > 8.0:
            assert at_pixel(EYE, [*cameras, *vans], pixel + np.full(2, 2.0)) == van
    assert at_pixel(EYE, cameras, pixels[0]) == cameras[0]
    assert at_pixel(EYE, vans, np.array([2.0, 2.0])) is None


@pytest.mark.parametrize("aspect", [0.5, 1.0, 1.8])
@pytest.mark.parametrize("tilt", [0.6, 0.9, np.pi / 2])
@pytest.mark.parametrize("half", [(5.0, 5.0), (5.0, 0.5), (0.5, 5.0)], ids=str)
def test_the_whole_map_fills_the_canvas(aspect, tilt, half):
    """All corners of a map are seen from where it is fitted, and one side has no room to spare."""
    position, look_at = fit_box(np.array(half), aspect, tilt)
    eye = _eye(position, look_at, round(800 * aspect), 800)
    corners = np.array([(x, y, 0.0) for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    pixels, depth = eye.pixels(corners)
    share = pixels / (eye.width_px, eye.height_px)
    assert (depth > 0).all()
    assert share.min() > -0.01
    assert share.max() < 1.01
    assert np.ptp(share, axis=0).max() > 0.95


def test_widths_do_not_depend_on_the_letters_order():
    """A label's width is that of its letters and its edges."""
    assert labelling.width_px("ab") == labelling.width_px("ba") > labelling.width_px("a")
