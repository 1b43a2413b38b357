"""Route options on a chain: one qubit of each group in |1⟩, groups contiguous."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.ansatz import OneHotAnsatz
from dispatcher_daemon.solvers.quantum.chain.order import heavy_path
from dispatcher_daemon.solvers.quantum.ising import Ising

Schedule = Sequence[tuple[float, float]]


def inside_groups(ising: Ising, groups: Sequence[Sequence[int]]) -> Ising:
    """The same energies where each group has one 1, with no coupling or field that is idle there.

    With one 1 in a group of d, z_i z_j = z_i + z_j − 1 inside it and Σ z_i = d − 2. So couplings
    inside groups become fields, and the means of fields over groups and of couplings' rows and
    columns over pairs of groups become fields and constants. What stays has mean 0.

    Args:
        groups: disjoint sets of qubits that hold all qubits.
    """
    h, coupling, offset = ising.h.copy(), ising.coupling.copy(), ising.offset
    for group in groups:
        own = np.ix_(group, group)
        h[group] += coupling[own].sum(axis=1)
        offset -= coupling[own].sum() / 2
        coupling[own] = 0.0
    for number, one in enumerate(groups):
        for two in groups[number + 1 :]:
            block = coupling[np.ix_(one, two)]
            rows, columns, mean = block.mean(axis=1), block.mean(axis=0), float(block.mean())
            spare_one, spare_two = len(one) - 2, len(two) - 2
            h[one] += rows * spare_two
            h[two] += columns * spare_one
            offset -= mean * spare_one * spare_two
            centred = block - rows[:, None] - columns + mean
            coupling[np.ix_(one, two)] = centred
            coupling[np.ix_(two, one)] = centred.T
    for group in groups:
        mean = float(h[group].mean())
        h[group] -= mean
        offset += mean * (len(group) - 2)
    return Ising(h, coupling, float(offset))


def group_order(
    coupling: npt.NDArray[np.float64], groups: Sequence[Sequence[int]]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Qubits in the order of a chain, groups together, and the groups' sizes in that order.

    Groups lie along a heavy path whose weights are the heaviest couplings between two groups: only
    the last qubit of one and the first of the next are coupled. Which ones these are is then chosen
    by dynamic programming along the path, so that the sum of |J| over them is the greatest; the
    others keep their order.
    """
    weight = np.abs(coupling)
    between = np.zeros((len(groups), len(groups)))
    for i, one in enumerate(groups):
        for j, two in enumerate(groups):
            if i != j:
                between[i, j] = weight[np.ix_(one, two)].max()
    path = [list(groups[g]) for g in heavy_path(between)]
    ends = _ends(weight, path)
    order: list[int] = []
    for group, (first, last) in zip(path, ends, strict=True):
        inner = [q for q in group if q not in (first, last)]
        order += [first, *inner, last] if len(group) > 1 else [first]
    return tuple(order), tuple(len(group) for group in path)


def _ends(weight: npt.NDArray[np.float64], path: Sequence[list[int]]) -> list[tuple[int, int]]:
    """First and last qubit of each group on the path; the same one only in groups of one."""
    best: list[dict[int, tuple[float, int, int]]] = []
    for number, group in enumerate(path):
        found: dict[int, tuple[float, int, int]] = {}
        for last in group:
            for first in group:
                if first == last and len(group) > 1:
                    continue
                value, before = 0.0, -1
                if number:
                    value, before = max(
                        (sum_so_far + weight[q, first], -q)
                        for q, (sum_so_far, _, _) in best[-1].items()
                    )
                if last not in found or value > found[last][0] + 1e-12:
                    found[last] = (value, first, -before)
        best.append(found)
    last = max(best[-1], key=lambda q: (best[-1][q][0], -q))
    ends = []
    for found in reversed(best):
        _, first, before = found[last]
        ends.append((first, last))
        last = before
    return ends[::-1]


def uniform_start(groups: Sequence[int]) -> tuple[tuple[int, ...], npt.NDArray[np.float64]]:
    """Hot qubits in the middles, and angles of `OneHotAnsatz.spread` for equal probabilities."""
    spread = np.zeros(sum(groups) - 1)
    hot = []
    start = 0
    for size in groups:
        middle = start + (size - 1) // 2
        above, below = start + size - 1 - middle, middle - start
        for distance in range(max(above, below)):
            # A gate moves the share of all qubits beyond it out of what its inner qubit holds.
            if distance < above:
                holds = size if distance == 0 else above - distance + 1
                spread[middle + distance] = 2 * np.arcsin(np.sqrt((above - distance) / holds))
            if distance < below:
                holds = size - above if distance == 0 else below - distance + 1
                spread[middle - distance - 1] = 2 * np.arcsin(np.sqrt((below - distance) / holds))
        hot.append(middle)
        start += size
    return tuple(hot), spread


def one_hot_scheduled(
    ising: Ising, groups: Sequence[int], schedule: Schedule, cuts: Sequence[int] = ()
) -> OneHotAnsatz:
    """The phases of fields and of the couplings between neighbouring groups, and XY mixers.

    Args:
        ising: in chain order, normalised, see `inside_groups`.
        groups: sizes, in chain order.
        schedule: (β, γ) of each layer; a mixer is e^{+iβ(XX+YY)/2}.
        cuts: bonds (q, q + 1) between groups, by q, that get no gate.
    """
    beta, gamma = np.array(schedule, dtype=float).reshape(-1, 2).T
    hot, spread = uniform_start(groups)
    starts = np.cumsum(groups)[:-1]
    inside = np.ones(sum(groups) - 1)
    inside[starts - 1] = 0.0
    kept = ~np.isin(starts - 1, cuts)
    fields = 2 * gamma[:, None] * ising.h
    # The start leaves a phase of (−i)^k at distance k from the hot qubit, which these take away.
    middles = np.repeat(hot, groups)
    fields[0] += np.pi / 2 * np.abs(np.arange(sum(groups)) - middles)
    return OneHotAnsatz(
        groups=tuple(groups),
        hot=hot,
        spread=spread,
        fields=fields,
        bonds=2 * gamma[:, None] * ising.coupling[starts - 1, starts] * kept,
        mixers=-2 * beta[:, None] * inside,
    )
