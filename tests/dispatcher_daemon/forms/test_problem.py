from __future__ import annotations

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
