"""Angles of one instance on others: what they are worth there, beside angles of their own.

A tool for whoever chooses fixed angles (`QaoaSettings`); no solver and no table calls it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dispatcher_daemon.quantum.exact_state import ExactState, Schedule
from dispatcher_daemon.quantum.training import Objective, Training, train


@dataclass(frozen=True)
class Transfer:
    """One schedule on another instance.

    Attributes:
        untouched: objective of the initial state, with all angles 0.
        transferred: with the angles of the other instance.
        own: with angles trained here, from the transferred ones.
    """

    untouched: float
    transferred: float
    own: float

    @property
    def loss(self) -> float:
        """Share of what training here gains that the transferred angles do not reach.

        0: as good; 1: no better than no circuit; above 1: worse.
        """
        gain = self.untouched - self.own
        return (self.transferred - self.own) / gain if gain > 0 else 0.0


def transfer(
    donor: ExactState,
    others: Sequence[Callable[[], ExactState]],
    start: Schedule,
    objective: Objective | None = None,
    *,
    evaluations: int = 100,
) -> tuple[Training, list[Transfer]]:
    """Train on one instance, carry the angles to others, and compare with training there.

    Angles carry over between Hamiltonians that are normalised alike (`Ising.normalised`); the
    diagonals of donor and others must come from such.

    Args:
        others: make the states of the other instances, one at a time, as each may fill memory.
        start: of the donor's training.
        objective: None: the mean.
        evaluations: most for each training.
    """
    objective = objective or Objective()
    trained = train(donor, start, objective, evaluations=evaluations)
    found = []
    for make in others:
        state = make()
        state.evolve([(0.0, 0.0)] * len(trained.schedule))
        untouched = objective(state)
        own = train(state, trained.schedule, objective, evaluations=evaluations)
        found.append(Transfer(untouched, own.history[0], own.value))
    return trained, found
