from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.solvers.distribution import BitDistribution


def test_bits_and_groups_come_with_their_probabilities() -> None:
    """Frequencies of free bits and of grouped ones are the given probabilities."""
    distribution = BitDistribution((0.1, 0.2, 0.8, 0.9, 0.1), ((0, 4, 2),))
    bits = distribution.sample(40_000, 3)
    assert bits.shape == (40_000, 5)
    assert np.abs(bits.mean(axis=0) - distribution.probabilities).max() < 0.01
    assert np.all(bits[:, [0, 2, 4]].sum(axis=1) == 1)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), sizes=st.lists(st.integers(1, 5), min_size=1, max_size=4))
def test_one_member_of_each_group_whatever_the_rounding(seed: int, sizes: list[int]) -> None:
    """Groups of any probabilities have one 1 in every sample; zero probability never shows."""
    rng = np.random.default_rng(seed)
    probabilities: list[float] = []
    groups: list[tuple[int, ...]] = []
    for size in sizes:
        share = rng.random(size) * (rng.random(size) < 0.7) + 1e-12 * np.eye(size)[0]
        groups.append(tuple(range(len(probabilities), len(probabilities) + size)))
        probabilities += (share / share.sum()).tolist()
    bits = BitDistribution(tuple(probabilities), tuple(groups)).sample(200, seed)
    for group in groups:
        assert np.all(bits[:, list(group)].sum(axis=1) == 1)
    assert not bits[:, np.array(probabilities) == 0].any()


def test_certain_bits_are_certain_and_seeds_count() -> None:
    """Probabilities 0 and 1 leave no choice; one seed, one sample."""
    assert BitDistribution((0.0, 1.0)).sample(50, 1).mean(axis=0).tolist() == [0.0, 1.0]
    fair = BitDistribution((0.5,) * 30)
    assert np.array_equal(fair.sample(9, 4), fair.sample(9, 4))
    assert not np.array_equal(fair.sample(9, 4), fair.sample(9, 5))
