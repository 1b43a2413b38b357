from __future__ import annotations

import numpy as np
import pytest

from dispatcher_daemon.forms.decode import decode, violations
from dispatcher_daemon.forms.problem import ArcProblem, CandidateArc
from dispatcher_daemon.solvers.arc_repair import follow_arcs
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import arc_form_of
from slipstream_lab.research.proofs.enumeration import valid_selections


@pytest.fixture(scope="module")
def problem() -> ArcProblem:
    """A published instance of 14 arcs."""
    problem = arc_form_of(open_instance("arc20-avenue")).problem
    assert isinstance(problem, ArcProblem)
    return problem


def all_selections(problem: ArcProblem) -> np.ndarray[tuple[int, int], np.dtype[np.int8]]:
    """Every selection, the first arc in the lowest bit."""
    states = np.arange(1 << problem.choices)
    return (states[:, None] >> np.arange(problem.choices) & 1).astype(np.int8)


@pytest.mark.slow
def test_every_selection_becomes_valid_and_valid_ones_stay(problem: ArcProblem) -> None:
    """Of all 2^14 selections none stays broken, and none that was valid is touched."""
    selections = all_selections(problem)
    valid = valid_selections(problem)
    mended = follow_arcs(problem, selections)
    assert (mended[valid] == selections[valid]).all()
    powers = 1 << np.arange(problem.choices)
    assert valid[mended.astype(np.int64) @ powers].all()


def test_selected_arcs_come_before_cheaper_ones() -> None:
    """One stray arc less than a valid route set leads to that set, not to the cheapest."""
    arcs = [
        CandidateArc("a", start, end, cost)
        for start, end, cost in (
            ("depot", "x", 1.0),
            ("depot", "y", 9.0),
            ("x", "y", 1.0),
            ("y", "x", 9.0),
            ("x", "depot", 9.0),
            ("y", "depot", 1.0),
        )
    ]
    problem = ArcProblem("depot", ("x", "y"), ("a",), tuple(arcs))
    dear = np.array([[0, 1, 0, 1, 0, 0]], dtype=np.int8)  # the way home is missing
    (mended,) = follow_arcs(problem, dear)
    assert decode(problem, np.flatnonzero(mended).tolist()).routes == {"a": ("y", "x")}
    (cheapest,) = follow_arcs(problem, np.zeros((1, 6), dtype=np.int8))
    assert decode(problem, np.flatnonzero(cheapest).tolist()).routes == {"a": ("x", "y")}


def test_what_leads_nowhere_is_left_as_it_is(problem: ArcProblem) -> None:
    """Without an arc home, or without the steps, a selection is handed back unchanged."""
    homeless = ArcProblem(
        problem.depot,
        problem.customers,
        problem.vehicles,
        tuple(a for a in problem.arcs if a.end != problem.depot),
    )
    ones = np.ones((2, homeless.choices), dtype=np.int8)
    assert (follow_arcs(homeless, ones) == ones).all()
    stray = np.zeros((1, problem.choices), dtype=np.int8)
    assert (follow_arcs(problem, stray, max_steps=2) == stray).all()
    assert violations(problem, [])
