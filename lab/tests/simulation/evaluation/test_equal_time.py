"""Energy over travel time of the baseline."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipstream_lab.simulation.evaluation.measures.equal_time import TimeCurve


def test_the_curve_goes_through_what_was_simulated_and_falls_between() -> None:
    """Whatever the order of the paces."""
    curve = TimeCurve([10.0, 8.0, 12.0], [5.0, 7.0, 4.0])
    assert [curve.at(t) for t in (8.0, 10.0, 12.0)] == pytest.approx([7.0, 5.0, 4.0])
    between = [curve.at(float(t)) or 0.0 for t in np.linspace(8, 12, 40)]
    assert all(a > b > 0 for a, b in pairwise(between))


def test_beyond_its_ends_there_is_no_curve() -> None:
    """What nobody simulated is not guessed, however near."""
    curve = TimeCurve([8.0, 10.0, 12.0], [7.0, 5.0, 4.0])
    assert (curve.fastest, curve.slowest) == (8.0, 12.0)
    assert [curve.at(t) for t in (7.99, 12.01)] == [None, None]


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(100, 1000), st.floats(1, 100)), min_size=2, max_size=5,
        unique_by=lambda pair: round(pair[0], 1),
    )
)  # fmt: skip
def test_noise_in_the_measured_energies_never_makes_the_curve_rise(
    points: list[tuple[float, float]],
) -> None:
    """However the points lie, more time never needs more energy."""
    times, energies = zip(*points, strict=True)
    curve = TimeCurve(times, energies)
    inside = np.linspace(curve.fastest, curve.slowest, 25)[1:-1]
    found = [energy for t in inside if (energy := curve.at(float(t))) is not None]
    assert len(found) == 23
    assert all(a >= b - 1e-9 * abs(a) for a, b in pairwise(found))


def test_one_travel_time_is_no_curve() -> None:
    """Two baselines that took equally long say nothing about time."""
    with pytest.raises(ValueError, match="two different"):
        TimeCurve([5.0, 5.0], [1.0, 2.0])
