"""The course of a road from the paths of vehicles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from edge_daemon.features.centreline import Centreline, fit_centreline


def learn(paths: list[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]) -> Centreline:
    """The course of vehicles with these positions along and across the direction."""
    vehicle = np.repeat(np.arange(len(paths)), [len(along) for along, _ in paths])
    along, across = np.concatenate([np.zeros((2, 0)), *paths], axis=1)
    return fit_centreline(vehicle, along, across)


def test_a_straight_road_changes_nothing() -> None:
    """Distance along the direction is distance driven."""
    along = np.linspace(0, 60, 40)
    course = learn([(along, np.full(40, 1.7)), (along, np.full(40, 5.2))])
    assert course.arc_length(along) == pytest.approx(along)


def test_a_direction_that_is_off_is_mended() -> None:
    """Eight degrees off makes distances 1 % short."""
    driven = np.linspace(0, 60, 40)
    turn = np.radians(8.0)
    course = learn([(driven * np.cos(turn), 3.0 + driven * np.sin(turn))])
    arcs = course.arc_length(driven * np.cos(turn))
    assert arcs[-1] - arcs[0] == pytest.approx(60.0, abs=1e-6)


def test_a_bend_is_followed() -> None:
    """An arc of 30 degrees on a radius of 120 m, seen by vehicles in two lanes and at two parts."""
    paths = []
    for radius, begin, end in ((120.0, -15.0, 5.0), (123.5, -5.0, 15.0)):
        angle = np.radians(np.linspace(begin, end, 60))
        paths.append((radius * np.sin(angle), radius * (1 - np.cos(angle))))
    course = learn(paths)
    ends = 120.0 * np.sin(np.radians([-15.0, 15.0]))
    arcs = course.arc_length(ends)
    assert arcs[1] - arcs[0] == pytest.approx(120.0 * np.radians(30.0), rel=2e-3)


def test_standing_vehicles_tell_nothing() -> None:
    """Noise of boxes must not bend the road."""
    rng = np.random.default_rng(1)
    paths = [(x + rng.normal(0, 0.5, 50), rng.normal(0, 0.5, 50)) for x in (20.0, 40.0)]
    assert learn(paths) == Centreline(pytest.approx(30.0, abs=0.5))  # type: ignore[arg-type]
    assert learn([]) == Centreline()


def test_paths_across_the_direction_are_no_course() -> None:
    """A side street must not stretch the segment without bound."""
    x = np.linspace(0, 30, 40)
    course = learn([(x, 4.0 * x)])
    assert (course.slope, course.curvature_per_m) == (0.0, 0.0)
