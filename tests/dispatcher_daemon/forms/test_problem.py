from __future__ import annotations

import pytest

from dispatcher_daemon.forms.problem import ArcProblem, ArcReward, CandidateArc

ARCS = (
    CandidateArc("v", "d", "a", 1.0),
    CandidateArc("v", "a", "d", 2.0),
    CandidateArc("w", "d", "b", 4.0),
    CandidateArc("w", "b", "d", 8.0),
)


def problem(*rewards: ArcReward) -> ArcProblem:
    """Two vehicles with a stop each."""
    return ArcProblem("d", ("a", "b"), ("v", "w"), ARCS, rewards)


def test_objective_is_cost_less_rewards_of_chosen_pairs() -> None:
    """Rewards on several segments add up, and count only where both arcs are chosen."""
    built = problem(
        ArcReward(0, 2, "e", 0.25), ArcReward(0, 2, "f", 0.5), ArcReward(1, 3, "e", 0.125)
    )
    assert built.objective_kwh({0, 1, 2, 3}) == 15.0 - 0.875
    assert built.objective_kwh({0, 2}) == 5.0 - 0.75
    assert built.objective_kwh({0, 1}) == 3.0
    assert built.without_platooning().objective_kwh({0, 1, 2, 3}) == 15.0


def test_selection_finds_the_arcs_of_routes() -> None:
    """Routes become arcs; a leg that is no candidate arc makes None."""
    assert problem().selection({"v": ("a",), "w": ("b",)}) == frozenset({0, 1, 2, 3})
    assert problem().selection({"v": ("a", "b"), "w": ()}) is None


@pytest.mark.parametrize(
    "reward",
    [
        ArcReward(0, 1, "e", 0.1),
        ArcReward(2, 0, "e", 0.1),
        ArcReward(0, 9, "e", 0.1),
        ArcReward(0, 2, "e", 0.0),
        ArcReward(0, 2, "e", float("nan")),
    ],
)
def test_impossible_rewards_are_refused(reward: ArcReward) -> None:
    """A reward joins arcs of two vehicles and is positive and finite."""
    with pytest.raises(ValueError, match="reward"):
        problem(reward)


@pytest.mark.parametrize(
    "arc",
    [
        CandidateArc("v", "d", "a", 1.0),
        CandidateArc("x", "d", "a", 1.0),
        CandidateArc("v", "d", "z", 1.0),
        CandidateArc("v", "a", "a", 1.0),
        CandidateArc("v", "a", "b", float("inf")),
    ],
)
def test_impossible_arcs_are_refused(arc: CandidateArc) -> None:
    """An arc is listed once, joins two known places and has a finite cost."""
    with pytest.raises(ValueError, match="arc"):
        ArcProblem("d", ("a", "b"), ("v", "w"), (*ARCS, arc))
