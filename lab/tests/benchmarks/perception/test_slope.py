"""Slopes of series whose neighbours are alike."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.signal import lfilter

from slipstream_lab.benchmarks.perception.slope import slope

SECONDS = np.arange(1800.0)


def wandering(seed: int, correlation_s: float) -> npt.NDArray[np.float64]:
    """A stationary series of standard deviation 1 MB whose values are alike for so long."""
    keep = np.exp(-1 / correlation_s)
    steps = np.random.default_rng(seed).normal(0, np.sqrt(1 - keep**2), 3 * len(SECONDS))
    return np.asarray(lfilter([1], [1, -keep], steps)[-len(SECONDS) :])


@pytest.mark.long
@pytest.mark.parametrize("true_per_h", [0.0, 8.0])
def test_the_interval_holds_the_slope_about_as_often_as_it_says(true_per_h: float) -> None:
    """Of 200 series that are alike for 30 s, 84 % and more; taken for independent, 21 %."""
    held = 0
    for seed in range(200):
        found = slope(SECONDS, 300 + true_per_h * SECONDS / 3600 + wandering(seed, 30.0))
        held += found.low_per_h <= true_per_h <= found.high_per_h
    assert 168 <= held <= 198


def test_a_leak_that_stands_out_is_growth_and_a_fall_is_not() -> None:
    """20 MB/h under a wandering of 1 MB."""
    assert slope(SECONDS, 20 * SECONDS / 3600 + wandering(1, 15.0)).is_growth
    assert not slope(SECONDS, -20 * SECONDS / 3600 + wandering(1, 15.0)).is_growth
    assert not slope(SECONDS, np.full(len(SECONDS), 300.0)).is_growth


def test_the_slope_is_that_of_the_line() -> None:
    """Per hour, with an interval of no width where nothing wanders."""
    found = slope(SECONDS, 5 + 2 * SECONDS / 3600)
    assert found.per_h == pytest.approx(2.0)
    assert found.high_per_h - found.low_per_h == pytest.approx(0.0, abs=1e-6)


def test_too_few_values_are_refused() -> None:
    """No interval is made up."""
    with pytest.raises(ValueError, match="20 values"):
        slope([0, 1, 2], [1, 2, 3])
