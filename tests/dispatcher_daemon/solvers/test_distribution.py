from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.solvers.distribution import (
    BitDistribution,
    uniform_bits,
    uniform_choices,
)


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
    fair = uniform_bits(30)
    assert np.array_equal(fair.sample(9, 4), fair.sample(9, 4))
    assert not np.array_equal(fair.sample(9, 4), fair.sample(9, 5))


def test_uniform_choices_leave_the_rest_to_coins() -> None:
    """Members of a group share its one 1; what is in no group is 1 half the time."""
    choices = uniform_choices(5, [(1, 3), (0,)])
    assert choices.probabilities == (1.0, 0.5, 0.5, 0.5, 0.5)
    assert choices.groups == ((1, 3), (0,))


@pytest.mark.parametrize(
    ("probabilities", "groups"),
    [
        ((1.2,), ()),
        ((float("nan"),), ()),
        ((0.5, 0.4), ((0, 1),)),
        ((0.5, 0.5), ((0, 1), (1,))),
        ((1.0,), ((1,),)),
    ],
)
def test_what_is_no_distribution_is_refused(
    probabilities: tuple[float, ...], groups: tuple[tuple[int, ...], ...]
) -> None:
    """Probabilities outside [0, 1], groups that overlap, are elsewhere or do not sum to 1."""
    with pytest.raises(ValueError, match=r"probabilit|groups"):
        BitDistribution(probabilities, groups)
