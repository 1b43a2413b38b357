"""Exactness of a QUBO by enumeration of all its states, and its valid selections."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import (
    BLOCK_BITS,
    ArcProblem,
    BinaryProblem,
    Problem,
    QuboModel,
    RouteProblem,
    energies_of,
    violations,
)


def all_energies(
    bqm: Any, order: Sequence[Hashable], block_bits: int = BLOCK_BITS
) -> Iterator[npt.NDArray[np.float64]]:
    """`energies_of` a `dimod.BinaryQuadraticModel`; state s sets ``order[i]`` to bit i of s."""
    index = {name: i for i, name in enumerate(order)}
    h = np.array([float(bqm.get_linear(name)) for name in order])
    coupling = np.zeros((len(order), len(order)))
    for (u, v), value in bqm.quadratic.items():
        coupling[index[u], index[v]] = coupling[index[v], index[u]] = value
    return energies_of(h, coupling, float(bqm.offset), block_bits)


@dataclass(frozen=True)
class Exactness:
    """Result of the enumeration of a model.

    Attributes:
        feasible_states: states with zero penalty.
        valid_selections: selections that the independent decoder accepts.
        mismatches: selections that the decoder and the penalty judge differently.
        minimum_kwh: lowest H_total of all states.
        minimum_selected: arcs or options of that state.
        maximum_kwh: highest H_total of all states.
        highest_feasible_kwh: highest H_total with zero penalty; −inf if there is none.
        lowest_infeasible_kwh: lowest H_total with a penalty; inf if there is none.
    """

    states: int
    feasible_states: int
    valid_selections: int
    mismatches: int
    minimum_kwh: float
    minimum_selected: frozenset[int]
    maximum_kwh: float
    highest_feasible_kwh: float
    lowest_infeasible_kwh: float

    @property
    def spread(self) -> float:
        """Range of H_total over feasible states, as a share of its range over all states."""
        whole = self.maximum_kwh - self.minimum_kwh
        feasible = self.highest_feasible_kwh - self.minimum_kwh
        return max(0.0, feasible / whole) if whole > 0 else 0.0

    @property
    def separated(self) -> bool:
        """True if every infeasible state lies above every feasible one."""
        return self.lowest_infeasible_kwh > self.highest_feasible_kwh


def enumerate_model(model: QuboModel) -> Exactness:
    """Enumerate all states of a model.

    A selection of arcs or options counts as accepted by the penalty if some setting of auxiliary
    bits brings the penalty to zero; the decoder looks at the selection alone.
    """
    choices = model.problem.choices
    # Selections whose penalty some auxiliary bits bring to zero.
    accepted = np.zeros(1 << choices, dtype=bool)
    minimum, minimum_state = np.inf, 0
    maximum, highest, lowest = -np.inf, -np.inf, np.inf
    feasible = states = 0
    blocks = zip(
        all_energies(model.penalty, model.variables),
        all_energies(model.objective, model.variables),
        strict=True,
    )
    for penalty, total in blocks:
        total += model.gamma * penalty
        at = int(total.argmin())
        if total[at] < minimum:
            minimum, minimum_state = float(total[at]), states + at
        maximum = max(maximum, float(total.max()))
        zero = penalty < 0.5
        feasible += int(zero.sum())
        highest = max(highest, float(total.max(where=zero, initial=-np.inf)))
        lowest = min(lowest, float(total.min(where=~zero, initial=np.inf)))
        rows = zero.reshape(-1, min(len(zero), len(accepted)))
        by_selection = np.logical_or.reduce(rows, axis=0)
        first = states % len(accepted)
        accepted[first : first + len(by_selection)] |= by_selection
        states += len(total)
    valid = valid_selections(model.problem)
    return Exactness(
        states=states,
        feasible_states=feasible,
        valid_selections=int(valid.sum()),
        mismatches=int((valid != accepted).sum()),
        minimum_kwh=minimum,
        minimum_selected=frozenset(i for i in range(choices) if minimum_state >> i & 1),
        maximum_kwh=maximum,
        highest_feasible_kwh=highest,
        lowest_infeasible_kwh=lowest,
    )


def valid_selections(problem: Problem) -> npt.NDArray[np.bool_]:
    """Whether each of the 2^choices selections is valid, shape (2^choices,).

    Selection s holds choice i if bit i of s is set. Options are judged by counting bits. Of arcs,
    selections by which a vehicle leaves a place twice or stays at its depot are found so; the
    routes of all others are followed one selection at a time.
    """
    exactly_one: list[np.uint32]
    at_most_one: list[np.uint32]
    if isinstance(problem, ArcProblem):
        exactly_one, at_most_one = _arc_masks(problem)
    elif isinstance(problem, BinaryProblem):
        exactly_one, at_most_one = [], []
    else:
        exactly_one, at_most_one = _option_masks(problem), []
    valid = np.ones(1 << problem.choices, dtype=bool)
    size = 1 << min(16, problem.choices)  # blocks that fit a cache
    for first in range(0, len(valid), size):
        block = valid[first : first + size]
        states = np.arange(first, first + size, dtype=np.uint32)
        for mask in exactly_one:
            block &= np.bitwise_count(states & mask) == 1
        for mask in at_most_one:
            block &= np.bitwise_count(states & mask) <= 1
    if isinstance(problem, ArcProblem):
        indices = range(problem.choices)
        for s in np.flatnonzero(valid).tolist():
            valid[s] = not violations(problem, [i for i in indices if s >> i & 1])
    return valid


def _arc_masks(problem: ArcProblem) -> tuple[list[np.uint32], list[np.uint32]]:
    """Arcs of which a valid selection has exactly one, and those of which it has at most one."""
    exactly_one: list[np.uint32] = []
    at_most_one: list[np.uint32] = []
    for vehicle in problem.vehicles:
        for place in (problem.depot, *problem.customers):
            mask = _mask((a.vehicle, a.start) == (vehicle, place) for a in problem.arcs)
            (exactly_one if place == problem.depot else at_most_one).append(mask)
    return exactly_one, at_most_one


def _option_masks(problem: RouteProblem) -> list[np.uint32]:
    return [
        *(_mask(o.vehicle == vehicle for o in problem.options) for vehicle in problem.vehicles),
        *(_mask(stop in o.stops for o in problem.options) for stop in problem.stops),
    ]


def _mask(members: Iterable[bool]) -> np.uint32:
    return np.uint32(sum(1 << i for i, member in enumerate(members) if member))
