"""Noise on measured features, and the flags that survive it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_daemon.features.stability import classify
from edge_daemon.settings import StabilitySettings
from slipstream.messages import Estimate, KinematicFeatures, SegmentState
from slipstream_lab.research.perception.noise import noise_table, stable_by_bare_rule

BARE = StabilitySettings().bare()


def features(mean: float, spread: float, variance: float) -> KinematicFeatures:
    """Features without standard errors."""
    zero = Estimate(value=0.0)
    return KinematicFeatures(
        mean_speed_mps=Estimate(value=mean),
        mean_acceleration_mps2=zero,
        density_veh_per_m=zero,
        speed_std_mps=Estimate(value=spread),
        acceleration_variance_m2ps4=Estimate(value=variance),
    )


def state(mean: float, spread: float, variance: float, vehicles: int = 5) -> SegmentState:
    """A state with these features; its own flag does not matter."""
    return SegmentState(
        rsu="r",
        segment="s",
        sequence=1,
        time_ns=0,
        window_s=10.0,
        features=features(mean, spread, variance),
        y_e=0,
        reason=None,
        vehicles=vehicles,
        frames=100,
        coverage=1.0,
    )


@given(mean=st.floats(-1, 40), cv=st.floats(0, 0.3), variance=st.floats(0, 1.2))
def test_the_fast_rule_is_the_daemons_bare_rule(mean: float, cv: float, variance: float) -> None:
    """Away from the thresholds' last digits both say the same."""
    spread = cv * abs(mean)
    slow = classify(features(mean, spread, variance), 5, 100, 1.0, BARE).y_e
    fast = stable_by_bare_rule(np.array([mean, 0, 0, spread, variance, np.nan]), BARE)
    if abs(cv - BARE.max_speed_cv) > 1e-9 and abs(variance - 0.5) > 1e-9:
        assert slow == int(fast)


def test_the_share_is_the_normal_distributions() -> None:
    """With only σ²_a near its threshold, 0.5/0.4 = 1.25, a 20 % noise keeps Φ(1.25) = 89.4 %."""
    table = noise_table([state(20.0, 0.0, 0.4)], [0.0, 0.2], draws=8_000, seed=3)
    exact, noisy = table.rows
    assert exact.stable_share == 1.0
    assert exact.standard_error == 0.0
    assert noisy.stable_share == pytest.approx(0.8944, abs=0.012)
    assert noisy.wrongly_stable_share is None


def test_turbulent_states_that_noise_calls_stable_are_counted_apart() -> None:
    """σ²_a = 0.6 is under 0.5 for factors below 0.833: Φ(−0.833) = 20.2 % at 20 % noise."""
    states = [state(20.0, 0.0, 0.1), state(20.0, 0.0, 0.6), state(20.0, 0.0, 0.1, vehicles=1)]
    table = noise_table(states, [0.2], draws=8_000, seed=3)
    assert (table.stable, table.turbulent, table.unknown, table.segments) == (1, 1, 1, 1)
    assert table.rows[0].wrongly_stable_share == pytest.approx(0.2024, abs=0.015)


def test_the_standard_error_is_the_binomial_one_of_the_states() -> None:
    """√(p(1−p)/n) for n states, however many draws."""
    row = noise_table([state(20.0, 1.0, 0.4)] * 25, [0.3], draws=50, seed=1).rows[0]
    p = row.stable_share
    assert 0.5 < p < 0.95
    assert row.standard_error == pytest.approx(np.sqrt(p * (1 - p) / 25))


def test_the_same_seed_gives_the_same_table() -> None:
    """And another seed another one."""
    states = [state(20.0, 1.5, 0.3)]
    tables = [noise_table(states, [0.3], draws=100, seed=seed) for seed in (1, 1, 2)]
    assert tables[0] == tables[1]
    assert tables[0] != tables[2]


def test_nothing_stable_is_no_table() -> None:
    """A share of nothing is refused."""
    with pytest.raises(ValueError, match="no state is stable"):
        noise_table([state(20.0, 8.0, 0.1)], [0.1], draws=1, seed=1)
