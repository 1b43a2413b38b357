"""Exactness of QUBOs that are too large to enumerate whole, auxiliary bits eliminated exactly.

Auxiliary bits that the penalty couples only among themselves and with a few x form a part: in the
full encoding a vehicle's order and slack bits. With x given, parts do not know of each other, so
the penalties of all states with that x are P(x) + Σ over parts. Each part is enumerated once over
its bits and its x, which says for each pattern of these x what the part can add: least, next and
most. That replaces looking at all states one by one; nothing is estimated.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import dimod
import networkx as nx
import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import BLOCK_BITS, MAX_VARIABLES, QuboModel
from slipstream_lab.research.proofs.enumeration import (
    Exactness,
    all_energies,
    valid_selections,
)

Floats = npt.NDArray[np.float64]

MAX_CHOICES = 20


@dataclass(frozen=True)
class _Part:
    """A connected component of auxiliary bits, and the x that they are coupled to.

    Attributes:
        x: indices of these x.
        bits: names of the auxiliary bits.
    """

    x: tuple[int, ...]
    bits: tuple[Hashable, ...]


@dataclass(frozen=True)
class _Additions:
    """What a part adds to the penalty, by pattern of its x; shape (2^x,) each.

    Attributes:
        least: over its bits.
        ways: number of settings of its bits that add the least.
        following: the next value above the least; inf if there is none.
        most: over its bits.
    """

    least: Floats
    ways: Floats
    following: Floats
    most: Floats


def largest_part(model: QuboModel) -> int:
    """Maximum number of variables enumerated together: all x, or a part with its x."""
    parts = _parts(model)
    return max([model.problem.choices, *(len(part.x) + len(part.bits) for part in parts)])


def eliminate(model: QuboModel) -> Exactness:
    """The result of `enumerate_model`, for models whose parts are small enough.

    Raises:
        ValueError: more than `MAX_CHOICES` x, or a part of more than `MAX_VARIABLES` variables.
    """
    choices = model.problem.choices
    parts = _parts(model)
    if choices > MAX_CHOICES or largest_part(model) > MAX_VARIABLES:
        raise ValueError(f"{choices} x and parts of {largest_part(model)} variables are too many")
    x = model.variables[:choices]
    least = _energies(_within(model.penalty, x), x)
    objective = _energies(_within(model.objective, x), x)
    most, ways = least.copy(), np.ones(1 << choices)
    above = np.full(1 << choices, np.inf)
    for part in parts:
        additions, pattern = _additions(model, part), _patterns(part.x, choices)
        least += additions.least[pattern]
        most += additions.most[pattern]
        ways *= additions.ways[pattern]
        np.minimum(above, (additions.following - additions.least)[pattern], out=above)
    zero = least < 0.5
    energy = objective + model.gamma * least
    at = int(energy.argmin())
    # Lowest state with a penalty for each x: its least one, or the next if that is 0.
    lowest = objective + model.gamma * np.where(zero, above, least)
    valid = valid_selections(model.problem)
    return Exactness(
        states=1 << len(model.variables),
        feasible_states=int(ways[zero].sum()),
        valid_selections=int(valid.sum()),
        mismatches=int((valid != zero).sum()),
        minimum_kwh=float(energy[at]),
        minimum_selected=frozenset(i for i in range(choices) if at >> i & 1),
        maximum_kwh=float((objective + model.gamma * most).max()),
        highest_feasible_kwh=float(objective.max(where=zero, initial=-np.inf)),
        lowest_infeasible_kwh=float(lowest.min()),
    )


def _parts(model: QuboModel) -> list[_Part]:
    choices = model.problem.choices
    index = {name: i for i, name in enumerate(model.variables)}
    graph = nx.Graph()
    graph.add_nodes_from(range(choices, len(model.variables)))
    touches: dict[int, set[int]] = {}
    for (u, v), bias in model.penalty.quadratic.items():
        low, high = sorted((index[u], index[v]))
        if bias and low >= choices:
            graph.add_edge(low, high)
        elif bias and high >= choices:
            touches.setdefault(high, set()).add(low)
    return [
        _Part(
            tuple(sorted({i for bit in group for i in touches.get(bit, ())})),
            tuple(model.variables[bit] for bit in sorted(group)),
        )
        for group in nx.connected_components(graph)
    ]


def _additions(model: QuboModel, part: _Part) -> _Additions:
    """Enumerate the part's bits over its x; terms of x alone are left out."""
    penalty, size = model.penalty, 1 << len(part.x)
    x = tuple(model.variables[i] for i in part.x)
    bqm = _within(penalty, (*x, *part.bits))
    bqm.offset = 0.0
    for position, u in enumerate(x):
        bqm.set_linear(u, 0.0)
        for v in x[:position]:
            if bqm.get_quadratic(u, v, default=0.0):
                bqm.set_quadratic(u, v, 0.0)
    least, following = np.full(size, np.inf), np.full(size, np.inf)
    ways, most = np.zeros(size), np.full(size, -np.inf)
    for block in all_energies(bqm, (*x, *part.bits), max(BLOCK_BITS, len(part.x))):
        rows = block.reshape(-1, size)
        low = rows.min(axis=0)
        is_low = rows <= low + 0.5
        after = rows.min(axis=0, where=~is_low, initial=np.inf)
        count = is_low.sum(axis=0)
        new = np.minimum(least, low)
        ways = np.where(least == new, ways, 0.0) + np.where(low == new, count, 0.0)
        for value in (least, low, after):
            np.minimum(following, np.where(value > new, value, np.inf), out=following)
        least = new
        np.maximum(most, rows.max(axis=0), out=most)
    return _Additions(least, ways, following, most)


def _patterns(x: Sequence[int], choices: int) -> npt.NDArray[np.int64]:
    """For each of the 2^choices selections the pattern that it makes on some x."""
    selections = np.arange(1 << choices, dtype=np.int64)
    pattern = np.zeros_like(selections)
    for position, i in enumerate(x):
        pattern |= (selections >> i & 1) << position
    return pattern


def _within(bqm: Any, names: Sequence[Hashable]) -> Any:
    """The terms of a model among some of its variables, its offset included."""
    chosen = set(names)
    part = dimod.BinaryQuadraticModel("BINARY")
    for name in names:
        part.add_linear(name, bqm.get_linear(name))
    for (u, v), bias in bqm.quadratic.items():
        if u in chosen and v in chosen:
            part.add_quadratic(u, v, bias)
    part.offset = bqm.offset
    return part


def _energies(bqm: Any, order: Sequence[Hashable]) -> Floats:
    return np.concatenate(list(all_energies(bqm, order)))
