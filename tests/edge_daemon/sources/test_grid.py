"""When pictures were taken that a converter of frame rates shows late."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.camera import Array
from edge_daemon.frame import Frame
from edge_daemon.sources import mark_repeats
from edge_daemon.sources.grid import PictureGrid

from .test_repeats import road


def taken(rate: float, seconds: float = 12.0) -> Array:
    """Times of a camera's pictures."""
    return np.asarray(np.arange(0.0123, seconds, 1 / rate))


def shown(times_s: Array, rate: float) -> Array:
    """When a converter shows each first, in whole milliseconds as a container says it."""
    return np.asarray(np.round(np.ceil(times_s * rate - 1e-9) / rate, 3))


def corrected(times_s: Array) -> Array:
    """The times that the grid gives."""
    grid = PictureGrid()
    return np.array([grid.taken_s(float(time_s)) for time_s in times_s])


@pytest.mark.parametrize(
    ("rate", "converted"), [(15.9, 29.97), (24, 30), (21.4, 30), (12.5, 30), (28, 30), (25, 60)]
)
def test_pictures_that_are_shown_late_get_their_times_back(rate: float, converted: float) -> None:
    """Errors fall from a third of a tick to a fifteenth at most, once the grid is known."""
    true = taken(rate)
    late = shown(true, converted)
    known = len(true) // 2
    assert (late - true)[known:].std() > 0.25 / converted
    assert (corrected(late) - true)[known:].std() < 0.066 / converted


def test_times_that_are_true_stay_as_they_are() -> None:
    """Even ones, those of a camera that leaves out pictures at random, and uneven ones."""
    chance = np.random.default_rng(1)
    even = taken(30, 20.0)
    for times_s in (
        even,
        even[chance.random(len(even)) > 0.2],
        even[chance.random(len(even)) > 0.5],
        np.cumsum(chance.uniform(0.03, 0.05, 400)),
    ):
        assert np.array_equal(corrected(times_s), times_s)


def test_a_lost_picture_and_a_repeat_that_passed_for_new_leave_the_grid() -> None:
    """Each is as late as before by itself, the next ones are right."""
    true = taken(21.4)
    late = shown(true, 30)
    kept = np.delete(np.arange(len(true)), [150, 200])
    times_s = np.insert(late[kept], 180, late[kept][179] + 1 / 30)
    truth = np.insert(true[kept], 180, true[kept][179])
    error = corrected(times_s) - truth
    assert np.delete(error, 180)[140:].std() < 2e-3


def test_after_a_pause_and_after_a_cut_the_grid_is_found_anew() -> None:
    """What the pictures before it say of the ones behind it is nothing."""
    true = np.concatenate([taken(21.4), 14.02 + taken(21.4)])
    error = corrected(shown(true, 30)) - true
    assert error[-60:].std() < 2e-3


def test_times_of_marked_frames_never_decrease_and_repeats_keep_the_order() -> None:
    """A repeat is no later than the new picture behind it."""
    true = taken(21.4, 4.0)
    ticks = np.arange(0.0123, 3.9, 1 / 30)
    images = [road(int(number)) for number in np.searchsorted(true, ticks, "right") - 1]
    frames = [Frame(image, float(t), 0, 0.0) for image, t in zip(images, ticks, strict=True)]
    marked = [frame for frame in mark_repeats(frames) if frame is not None]
    times_s = np.array([frame.media_time_s for frame in marked])
    new = np.array([not frame.repeated for frame in marked])
    assert (np.diff(times_s) >= 0).all()
    assert 0.65 < new.mean() < 0.8
    assert np.diff(times_s[new])[-20:].std() < 0.1 * np.diff(ticks[new])[-20:].std()
