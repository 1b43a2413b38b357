"""L-BFGS of many independent problems at once: one call evaluates all of them.

Libraries minimise one function at a time; here a batch of a chain's circuits costs little more than
one, as most of the time goes into calls on small arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]

Evaluate = Callable[[Real], tuple[Real, Real]]
"""Points (batch, n) to values (batch,) and gradients (batch, n)."""

_MEMORY = 10
_ARMIJO = 1e-4
_SHRINK = 0.4
_FLAT = 1e-7
"""A gain below this share of 1 + |value| in `_PATIENCE` steps in a row ends a problem."""
_PATIENCE = 3


@dataclass(frozen=True)
class Minimised:
    """What was found.

    Attributes:
        points: the best of each problem, shape (batch, n).
        values: there, shape (batch,).
        evaluations: all problems together.
    """

    points: Real
    values: Real
    evaluations: int


def minimise(
    evaluate: Evaluate, starts: Real, steps: int, deadline: float = float("inf")
) -> Minimised:
    """Limited-memory BFGS with backtracking (Nocedal and Wright, algorithms 7.4 and 3.1).

    Each problem has its own step length and memory: while one shortens its step, others go on. One
    that gains no more drops out.

    Args:
        starts: one of each problem, shape (batch, n).
        steps: maximum number of evaluations of each.
        deadline: `time.perf_counter` at which the best so far are taken.
    """
    points = starts.copy()
    values, gradients = evaluate(points)
    count = len(points)
    best, lowest = points.copy(), values.copy()
    active = np.arange(len(points))
    moves = np.zeros((_MEMORY, *points.shape))
    turns = np.zeros_like(moves)
    lengths = 1.0 / np.maximum(np.linalg.norm(gradients, axis=1), 1.0)
    directions = -gradients
    idle = np.zeros(len(points), dtype=int)
    for _ in range(steps - 1):
        if not len(active) or time.perf_counter() >= deadline:
            break
        trials = points + lengths[:, None] * directions
        found, slopes = evaluate(trials)
        count += len(trials)
        falls = (gradients * directions).sum(axis=1)
        taken = found <= values + _ARMIJO * lengths * falls
        gains = np.where(taken, values - found, 0.0)
        if taken.any():
            moves[:, taken] = np.roll(moves[:, taken], -1, axis=0)
            turns[:, taken] = np.roll(turns[:, taken], -1, axis=0)
            moves[-1, taken] = (trials - points)[taken]
            turns[-1, taken] = (slopes - gradients)[taken]
            points[taken], values[taken] = trials[taken], found[taken]
            gradients[taken] = slopes[taken]
            directions[taken] = _descent(moves[:, taken], turns[:, taken], gradients[taken])
        lengths = np.where(taken, 1.0, _SHRINK * lengths)
        lower = values < lowest[active]
        best[active[lower]], lowest[active[lower]] = points[lower], values[lower]
        small = gains <= _FLAT * (1.0 + np.abs(values))
        idle = np.where(taken & ~small, 0, idle + 1)
        # A step that was shortened in vain for long counts like one that gained nothing.
        going = idle < np.where(taken, _PATIENCE, 4 * _PATIENCE)
        if not going.all():
            points, values, gradients = points[going], values[going], gradients[going]
            directions, lengths, idle = directions[going], lengths[going], idle[going]
            moves, turns, active = moves[:, going], turns[:, going], active[going]
    return Minimised(best, lowest, count)


def _descent(moves: Real, turns: Real, gradients: Real) -> Real:
    """−H g by the two-loop recursion; pairs without positive curvature are left out."""
    curvatures = (moves * turns).sum(axis=2)
    used = curvatures > 1e-12
    inverse = np.where(used, 1.0 / np.where(used, curvatures, 1.0), 0.0)
    direction = gradients.copy()
    factors = np.zeros_like(curvatures)
    for k in reversed(range(len(moves))):
        factors[k] = inverse[k] * (moves[k] * direction).sum(axis=1)
        direction -= factors[k][:, None] * turns[k]
    # The last pair that is used sets the scale.
    scale = np.ones(len(gradients))
    for k in range(len(moves)):
        squares = (turns[k] ** 2).sum(axis=1)
        scale = np.where(used[k], curvatures[k] / np.where(squares > 0, squares, 1.0), scale)
    direction *= scale[:, None]
    for k in range(len(moves)):
        back = inverse[k] * (turns[k] * direction).sum(axis=1)
        direction += (factors[k] - back)[:, None] * moves[k]
    return -direction
