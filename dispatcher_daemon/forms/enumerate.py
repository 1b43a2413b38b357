"""Exactness of a QUBO by enumeration of all its states."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms.decode import valid_selections
from dispatcher_daemon.forms.qubo import QuboModel

MAX_VARIABLES = 30
BLOCK_BITS = 18


def all_energies(
    bqm: Any, order: Sequence[Hashable], block_bits: int = BLOCK_BITS
) -> Iterator[npt.NDArray[np.float64]]:
    """Energies of all 2^n states, in blocks of 2^min(n, block_bits), by doubling.

    State s sets variable ``order[i]`` to bit i of s; blocks come in the order of s. With variable i
    added to states of the i before it, E(2^i + s) = E(s) + h_i + Σ_{j<i} J_ij s_j, so a state
    costs two additions.

    Raises:
        ValueError: more than `MAX_VARIABLES` variables.
    """
    index = {name: i for i, name in enumerate(order)}
    h = np.array([float(bqm.get_linear(name)) for name in order])
    coupling = np.zeros((len(order), len(order)))
    for (u, v), value in bqm.quadratic.items():
        coupling[index[u], index[v]] = coupling[index[v], index[u]] = value
    return energies_of(h, coupling, float(bqm.offset), block_bits)


def energies_of(
    h: npt.NDArray[np.float64],
    coupling: npt.NDArray[np.float64],
    offset: float,
    block_bits: int = BLOCK_BITS,
) -> Iterator[npt.NDArray[np.float64]]:
    """The same of a QUBO as arrays: biases (n,), symmetric couplings (n, n) without a diagonal."""
    n = len(h)
    if n > MAX_VARIABLES:
        raise ValueError(f"{n} variables are too many to enumerate, the most is {MAX_VARIABLES}")
    return _blocks(h, coupling, offset, min(n, block_bits))


def _blocks(
    h: npt.NDArray[np.float64], coupling: npt.NDArray[np.float64], offset: float, low: int
) -> Iterator[npt.NDArray[np.float64]]:
    n = len(h)
    fields = [_sums(coupling[i, :i]) for i in range(low)]
    energies = np.empty(1 << low)
    for high in range(1 << (n - low)):
        on = low + np.flatnonzero([(high >> bit) & 1 for bit in range(n - low)])
        energies[0] = offset + h[on].sum() + coupling[np.ix_(on, on)].sum() / 2
        linear = h[:low] + coupling[:low, on].sum(axis=1)
        for i in range(low):
            size = 1 << i
            np.add(energies[:size], fields[i], out=energies[size : 2 * size])
            energies[size : 2 * size] += linear[i]
        yield energies.copy()


def _sums(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Sum of the values that each bit pattern selects, shape (2^len(values),)."""
    sums = np.zeros(1)
    for value in values:
        sums = np.concatenate([sums, sums + value])
    return sums


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
