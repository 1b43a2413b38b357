"""Energy over travel time of the baseline."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulation.evaluation.measures.equal_time import TimeCurve


def test_the_curve_goes_through_what_was_simulated_and_falls_between() -> None:
    """Whatever the order of the paces."""
    curve = TimeCurve([10.0, 8.0, 12.0], [5.0, 7.0, 4.0])
    assert [curve.at(t).energy for t in (8.0, 10.0, 12.0)] == pytest.approx([7.0, 5.0, 4.0])
    between = [curve.at(t).energy for t in np.linspace(8, 12, 40)]
    assert all(a > b for a, b in pairwise(between))
    assert curve.at(9.0).extrapolated == ""


def test_beyond_its_ends_the_curve_flatters_the_baseline_and_says_so() -> None:
    """Slower: as steep as between the last two; faster: no more energy than the fastest."""
    curve = TimeCurve([8.0, 10.0, 12.0], [7.0, 5.0, 4.0])
    slower, faster = curve.at(14.0), curve.at(6.0)
    assert (slower.energy, slower.extrapolated) == (pytest.approx(3.0), "slower")
    assert (faster.energy, faster.extrapolated) == (pytest.approx(7.0), "faster")


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
    found = [curve.at(float(t)).energy for t in np.linspace(50, 1100, 25)]
    assert all(a >= b - 1e-9 * abs(a) for a, b in pairwise(found))


def test_one_travel_time_is_no_curve() -> None:
    """Two baselines that took equally long say nothing about time."""
    with pytest.raises(ValueError, match="two different"):
        TimeCurve([5.0, 5.0], [1.0, 2.0])
