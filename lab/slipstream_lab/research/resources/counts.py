"""Sizes of the arc form as a MILP and as a QUBO, up to N = 50, K = 20.

Up to some ten thousand couplings one can build a model and look. Beyond that the same counts are
taken from what models are built of: the couplings of Σ (row)² are the off-diagonal non-zeros of
AᵀA, A being the matrix of the penalty rows, and they are counted block by block; rewards couple the
arcs of any two vehicles whose ways share a segment. A test holds the counts against built models.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import comb
from typing import Final

import numpy as np
from scipy.sparse import csc_array, csr_array

from dispatcher_daemon.forms import (
    ArcVariable,
    Encoding,
    OrderBit,
    PenaltyRow,
    QuboModel,
    SlackBit,
    Variable,
    constraint_rows,
)
from slipstream_lab.research.resources.scaling import SIDE, ScalingCase, scaling_case

_BLOCK: Final = 4096


@dataclass(frozen=True)
class QuboSize:
    """What a QUBO needs.

    Attributes:
        arc_variables: x_{ijk}.
        order_bits: for u.
        slack_bits: of the MTZ rows.
        penalty_couplings: pairs of variables that the penalty couples.
        reward_couplings: pairs of arcs with a reward.
        couplings: pairs that are coupled by either.
    """

    arc_variables: int
    order_bits: int
    slack_bits: int
    penalty_couplings: int
    reward_couplings: int
    couplings: int

    @property
    def variables(self) -> int:
        """All of them; a qubit each."""
        return self.arc_variables + self.order_bits + self.slack_bits


@dataclass(frozen=True)
class MilpSize:
    """What the linearised MILP needs.

    Attributes:
        arc_variables: x_{ijk}, binary.
        auxiliaries: y for each rewarded pair of arcs, continuous.
        order_variables: u, continuous.
        constraints: rows.
        product_constraints: those among them that tie y to x.
        nonzeros: entries of the constraint matrix.
    """

    arc_variables: int
    auxiliaries: int
    order_variables: int
    constraints: int
    product_constraints: int
    nonzeros: int


@dataclass(frozen=True)
class PaperSize:
    """The paper's resource table evaluated, with its |E| read as the candidate arcs.

    Attributes:
        arc_variables: K·|E|, both models.
        milp_auxiliaries: |E|·K(K−1)/2.
        milp_order_variables: K·N.
        qubo_order_bits: K·N·⌈log2 N⌉.
    """

    arc_variables: int
    milp_auxiliaries: int
    milp_order_variables: int
    qubo_order_bits: int


@dataclass(frozen=True)
class ResourceRow:
    """One line of the table."""

    customers: int
    vehicles: int
    segments: int
    milp: MilpSize
    full: QuboSize
    reduced: QuboSize
    paper: PaperSize


def qubo_size(case: ScalingCase, encoding: Encoding) -> QuboSize:
    """Count variables and couplings of the QUBO without building it."""
    variables, rows = constraint_rows(case.problem, encoding)
    matrix = _matrix(variables, rows)
    vehicles, legs, choices = len(case.problem.vehicles), case.legs, case.problem.choices
    penalty = both = 0
    for first, last, couplings in _coupling_blocks(matrix, choices, legs):
        penalty += couplings.nnz
        for start in range(last, choices, legs) if first < choices else ():
            both += couplings[:, start : start + legs].multiply(case.shared).nnz
    rewards = comb(vehicles, 2) * case.shared.nnz
    kinds = [type(variable) for variable in variables]
    return QuboSize(
        arc_variables=kinds.count(ArcVariable),
        order_bits=kinds.count(OrderBit),
        slack_bits=kinds.count(SlackBit),
        penalty_couplings=penalty,
        reward_couplings=rewards,
        couplings=penalty + rewards - both,
    )


def model_size(model: QuboModel) -> QuboSize:
    """Count variables and couplings of a QUBO that is built."""
    kinds = [type(variable) for variable in model.variables]
    penalty, rewards = (
        {frozenset(pair) for pair, bias in part.quadratic.items() if bias}
        for part in (model.penalty, model.objective)
    )
    return QuboSize(
        arc_variables=kinds.count(ArcVariable),
        order_bits=kinds.count(OrderBit),
        slack_bits=kinds.count(SlackBit),
        penalty_couplings=len(penalty),
        reward_couplings=len(rewards),
        couplings=len(penalty | rewards),
    )


def milp_size(case: ScalingCase) -> MilpSize:
    """Count columns, rows and non-zeros of `build_milp` without building it."""
    problem = case.problem
    customers, vehicles = len(problem.customers), len(problem.vehicles)
    auxiliaries = comb(vehicles, 2) * case.shared.nnz
    starts = [arc.start for arc in problem.arcs[: case.legs]]
    between = sum(problem.depot not in (arc.start, arc.end) for arc in problem.arcs)
    names = {name: i for i, name in enumerate((problem.depot, *problem.customers))}
    leaving = csr_array(
        (np.ones(case.legs, dtype=np.int32), (range(case.legs), [names[s] for s in starts])),
        shape=(case.legs, len(names)),
    )
    # One row for each x and each group of partners of one other vehicle that leave one place.
    products = vehicles * (vehicles - 1) * (case.shared.astype(np.int32) @ leaving).nnz
    entering = sum(arc.end != problem.depot for arc in problem.arcs)
    flow = entering + sum(arc.start != problem.depot for arc in problem.arcs)
    depot = 2 * problem.choices - flow
    pairs = between // vehicles
    return MilpSize(
        arc_variables=problem.choices,
        auxiliaries=auxiliaries,
        order_variables=customers,
        constraints=customers + vehicles * (customers + 2) + pairs + products,
        product_constraints=products,
        nonzeros=entering + flow + depot + between + 2 * pairs + products + 2 * auxiliaries,
    )


def paper_size(customers: int, vehicles: int) -> PaperSize:
    """The paper's formulas (section IV-B) on a complete customer graph."""
    arcs = customers * (customers + 1)
    return PaperSize(
        arc_variables=vehicles * arcs,
        milp_auxiliaries=arcs * comb(vehicles, 2),
        milp_order_variables=vehicles * customers,
        qubo_order_bits=vehicles * customers * (customers - 1).bit_length(),
    )


def resource_row(customers: int, vehicles: int, side: int = SIDE, seed: int = 1) -> ResourceRow:
    """All counts of one size; errors as in `scaling_case`."""
    case = scaling_case(customers, vehicles, side, seed)
    return ResourceRow(
        customers=customers,
        vehicles=vehicles,
        segments=case.segments,
        milp=milp_size(case),
        full=qubo_size(case, "full"),
        reduced=qubo_size(case, "reduced"),
        paper=paper_size(customers, vehicles),
    )


def _matrix(variables: tuple[Variable, ...], rows: tuple[PenaltyRow, ...]) -> csc_array:
    """The penalty rows' integer coefficients, shape (rows, variables)."""
    index = {variable: i for i, variable in enumerate(variables)}
    starts = np.cumsum([0, *(len(row.coefficients) for row in rows)])
    columns = [index[variable] for row in rows for variable in row.coefficients]
    values = [value for row in rows for value in row.coefficients.values()]
    shape = (len(rows), len(variables))
    return csr_array((np.array(values, dtype=np.int64), columns, starts), shape=shape).tocsc()


def _coupling_blocks(
    matrix: csc_array, choices: int, legs: int
) -> Iterator[tuple[int, int, csr_array]]:
    """(first, last, couplings of variables first..last − 1 with later ones), in blocks of columns.

    A block of x is one vehicle's.
    """
    size = matrix.shape[1]
    bounds = [*range(0, choices, legs), *range(choices, size, _BLOCK), size]
    for first, last in pairwise(bounds):
        products = (matrix[:, first:last].T @ matrix).tocoo()
        later = (products.data != 0) & (products.col > products.row + first)
        yield (
            first,
            last,
            csr_array(
                (products.data[later], (products.row[later], products.col[later])),
                shape=products.shape,
            ),
        )
