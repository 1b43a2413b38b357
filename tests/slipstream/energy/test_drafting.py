"""Drag reductions by place and gap, against the measurements in docs/vehicles.md."""

from __future__ import annotations

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.energy.drafting import DragLaw, DragReductions, reductions_at
from slipstream.energy.traction import ETA_FOLLOWER, ETA_LEADER
from slipstream.spacing import CLOSE_GAP_M

LAWS: tuple[DragLaw, ...] = get_args(DragLaw)
MEASURED = tuple(law for law in LAWS if law != "paper")
gaps_m = st.floats(0.0, 500.0)


@given(st.floats(0.0, CLOSE_GAP_M))
def test_the_papers_law_knows_no_close_gap(gap_m: float) -> None:
    """0.05 in front and 0.20 behind, in platoons of any size, up to the largest close gap."""
    found = reductions_at("paper", gap_m)
    for members in (2, 3, 7):
        etas = [found.at(n, members) for n in range(members)]
        assert etas == [ETA_LEADER, *[ETA_FOLLOWER] * (members - 1)]


@given(st.floats(CLOSE_GAP_M, 500.0, exclude_min=True))
def test_the_papers_law_ends_with_close_gaps(gap_m: float) -> None:
    """The paper has no value for larger ones."""
    assert reductions_at("paper", gap_m) == (0.0, 0.0, 0.0, 0.0)


@given(st.sampled_from(LAWS), gaps_m, gaps_m)
def test_no_reduction_rises_with_the_gap(law: DragLaw, one_m: float, other_m: float) -> None:
    """Nor falls below 0, nor reaches 1."""
    near, far = (reductions_at(law, gap) for gap in sorted((one_m, other_m)))
    assert all(0.0 <= b <= a < 0.5 for a, b in zip(near, far, strict=True))


@given(st.sampled_from(MEASURED), gaps_m)
def test_a_measured_reduction_has_no_jumps(law: DragLaw, gap_m: float) -> None:
    """A centimetre more costs at most the steepest slope, the van leader's 0.30 in 3.25 m."""
    near, far = reductions_at(law, gap_m), reductions_at(law, gap_m + 0.01)
    assert all(a - b <= 0.01 * 0.30 / 3.25 + 1e-12 for a, b in zip(near, far, strict=True))


@pytest.mark.parametrize(
    ("gap_m", "front", "front_ci", "rear", "rear_ci"),
    [
        (9.144, 0.0624, 0.0130, 0.1036, 0.0104),
        (12.192, 0.0502, 0.0140, 0.1177, 0.0134),
        (15.24, 0.0355, 0.0129, 0.1159, 0.0106),
        (22.86, 0.0225, 0.0143, 0.1066, 0.0121),
        (45.72, 0.0048, 0.0162, 0.0710, 0.0099),
        (78.6384, 0.0124, 0.0138, 0.0574, 0.0115),
    ],
)
def test_two_trucks_save_the_fuel_that_was_measured(
    gap_m: float, front: float, front_ci: float, rear: float, rear_ci: float
) -> None:
    """η times drag's share of the traction is within the confidence interval of the fuel saved,
    and exactly it where no neighbours are pooled.
    """
    found = reductions_at("truck", gap_m)
    assert 0.641 * found.leader == pytest.approx(front, abs=front_ci)
    assert 0.641 * found.follower == pytest.approx(rear, abs=rear_ci)
    if gap_m < 40.0:
        assert 0.641 * found.leader == pytest.approx(front, rel=1e-9)
    if gap_m > 20.0:
        assert 0.641 * found.follower == pytest.approx(rear, rel=1e-9)


def test_pooled_neighbours_have_their_mean() -> None:
    """By hand: the rear truck's three smallest gaps, the front one's two largest."""
    near, far = reductions_at("truck", 9.144), reductions_at("truck", 78.6384)
    assert 0.641 * near.follower == pytest.approx((0.1036 + 0.1177 + 0.1159) / 3)
    assert 0.641 * far.leader == pytest.approx((0.0048 + 0.0124) / 2)


def test_the_two_behind_a_leader_share_what_two_followers_save() -> None:
    """By hand at 45.72 m, where nothing is pooled: 0.149 to 0.202 of twice 0.0710 / 0.641."""
    found = reductions_at("truck", 45.72)
    assert found.middle == pytest.approx(2 * 0.0710 / 0.641 * 0.149 / 0.351)
    assert found.last == pytest.approx(2 * 0.0710 / 0.641 * 0.202 / 0.351)


@pytest.mark.parametrize("gap_m", [17.4, 25.0, 35.0, 43.0])
def test_three_trucks_save_about_what_they_did_on_a_track(gap_m: float) -> None:
    """All together 5.2 to 7.8 % of fuel at gaps of 17 to 43 m; the law has 0.5 points more."""
    found = reductions_at("truck", gap_m)
    mean = sum(found.at(n, 3) for n in range(3)) / 3
    assert 0.052 <= 0.641 * mean <= 0.078 + 0.0055


def test_the_middle_truck_saves_most_when_close_and_the_last_one_farther_apart() -> None:
    """As McAuliffe et al. 2018 found with three: the two change places near 12 m."""
    near, far = reductions_at("truck", 9.0), reductions_at("truck", 15.24)
    assert near.leader < near.follower < near.middle
    assert near.last < near.middle
    assert far.leader < far.middle < far.follower < far.last


def test_vans_by_hand() -> None:
    """Measured at half a length and at three; linear between; of four close ones the mean is
    near the 0.38 that Zabat et al. 1994 measured.
    """
    half = reductions_at("van", 3.25)
    assert half == DragReductions(0.30, 0.43, 0.43, 0.43)
    four = [half.at(n, 4) for n in range(4)]
    assert sum(four) / 4 == pytest.approx(0.38, abs=0.02)
    assert reductions_at("van", 19.5).follower == pytest.approx(0.20)
    assert reductions_at("van", (3.25 + 19.5) / 2).follower == pytest.approx((0.43 + 0.20) / 2)
    assert reductions_at("van", 4.875).leader == pytest.approx(0.15)
    assert reductions_at("van", 6.5).leader == 0.0


@pytest.mark.parametrize(
    ("law", "nearest_m", "farthest_m"), [("van", 3.25, 19.5), ("truck", 9.144, 78.6384)]
)
def test_outside_the_measured_gaps(law: DragLaw, nearest_m: float, farthest_m: float) -> None:
    """Nothing more below the smallest; half of it half-way to twice the largest, then nothing."""
    assert reductions_at(law, 0.0) == reductions_at(law, nearest_m)
    last, beyond = reductions_at(law, farthest_m), reductions_at(law, 1.5 * farthest_m)
    assert beyond == pytest.approx(tuple(eta / 2 for eta in last))
    assert reductions_at(law, 2 * farthest_m) == (0.0, 0.0, 0.0, 0.0)
    assert reductions_at(law, 10 * farthest_m) == (0.0, 0.0, 0.0, 0.0)
