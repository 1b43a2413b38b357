"""A cycle's fleet as one problem for solvers, in the arc form or the route form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol

from dispatcher_daemon.forms import Problem
from dispatcher_daemon.planning.plans.candidates import Attempt, Candidate, CandidateRefusal, Cycle
from dispatcher_daemon.planning.platooning import JudgedPair
from dispatcher_daemon.planning.roads import RoutedArc
from dispatcher_daemon.solvers import Outcome
from dispatcher_daemon.solvers.workers import Solve

FormName = Literal["arc", "route"]


class Form(Protocol):
    """The problem that solvers get, and the plans of their selections."""

    @property
    def name(self) -> FormName:
        """Which form it is."""
        ...

    @property
    def cycle(self) -> Cycle:
        """The cycle that plans are made for."""
        ...

    @property
    def problem(self) -> Problem:
        """What solvers get."""
        ...

    @property
    def unserved(self) -> Mapping[str, str]:
        """Reason by stop that is not served."""
        ...

    @property
    def arcs(self) -> Sequence[RoutedArc]:
        """The legs that vehicles may drive, with their times."""
        ...

    @property
    def judged(self) -> Sequence[JudgedPair]:
        """Every pair of them on a watched segment, with its reward or the reason why it is 0."""
        ...

    def candidate(self, solver: str, selected: frozenset[int]) -> Candidate | CandidateRefusal:
        """The verified plans of a selection, or the rules that it breaks."""
        ...

    def references_kwh(self) -> dict[str, float]:
        """Objectives of reference heuristics, by name, kWh."""
        ...

    def baseline(self, solve: Solve, deadline_s: float) -> tuple[str, Candidate | CandidateRefusal]:
        """Solver of the plan without platooning, and that plan."""
        ...


def attempt(form: Form, outcome: Outcome) -> Attempt:
    """The verified plans of an outcome, or why there are none."""
    if outcome.selected is None:
        return Attempt(outcome, CandidateRefusal((outcome.reason or outcome.status,)))
    return Attempt(outcome, form.candidate(outcome.solver, outcome.selected))
