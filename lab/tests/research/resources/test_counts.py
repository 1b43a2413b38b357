from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.arc import build_arc_model
from dispatcher_daemon.forms.milp import build_milp
from dispatcher_daemon.forms.qubo import Encoding
from slipstream_lab.research.resources import counts as resources
from slipstream_lab.research.resources.counts import (
    milp_size,
    model_size,
    paper_size,
    qubo_size,
    resource_row,
)
from slipstream_lab.research.resources.scaling import scaling_case

SIZES = st.sampled_from([(1, 1), (2, 1), (2, 2), (3, 2), (4, 2), (4, 3), (5, 3), (6, 2)])


@settings(max_examples=20)
@given(size=SIZES, seed=st.integers(0, 10**6), encoding=st.sampled_from(["full", "reduced"]))
def test_counted_couplings_are_those_of_the_built_qubo(
    size: tuple[int, int], seed: int, encoding: Encoding
) -> None:
    """Variables by kind, penalty, reward and all couplings, on grids where ways overlap much."""
    case = scaling_case(*size, side=3 + seed % 3, seed=seed)
    assert qubo_size(case, encoding) == model_size(
        build_arc_model(case.rewarded(), encoding=encoding)
    )


def test_blocks_of_columns_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The count does not depend on how the matrix is cut."""
    case = scaling_case(5, 2, side=4, seed=2)
    whole = qubo_size(case, "full")
    monkeypatch.setattr(resources, "_BLOCK", 7)
    assert qubo_size(case, "full") == whole


@settings(max_examples=20)
@given(size=SIZES, seed=st.integers(0, 10**6))
def test_counted_rows_are_those_of_the_built_milp(size: tuple[int, int], seed: int) -> None:
    """Columns, rows and non-zeros."""
    case = scaling_case(*size, side=4, seed=seed)
    counted, built = milp_size(case), build_milp(case.rewarded())
    columns = counted.arc_variables + counted.auxiliaries + counted.order_variables
    assert columns == built.num_col_
    assert counted.constraints == built.num_row_
    assert counted.nonzeros == len(built.a_matrix_.index_)


def test_the_full_encoding_has_the_papers_order_bits() -> None:
    """K·N·⌈log2 N⌉ order bits and K·N(N+1) arcs; the reduced one shares its bits."""
    row = resource_row(9, 3, seed=4)
    assert row.full.order_bits == row.paper.qubo_order_bits == 3 * 9 * 4
    assert row.full.arc_variables == row.paper.arc_variables == 3 * 9 * 10
    assert row.full.slack_bits == 3 * 9 * 8 * 5  # slack 0..16
    assert row.reduced.order_bits == 9 * 4
    assert row.reduced.variables < row.full.variables
    assert row.milp.auxiliaries == row.full.reward_couplings


def test_paper_formulas() -> None:
    """The paper's example: 4 customers, 2 vehicles, 16 order bits before it restricts edges."""
    assert paper_size(4, 2).qubo_order_bits == 16
    assert paper_size(50, 20).milp_auxiliaries == 2550 * 190


@pytest.mark.parametrize(("customers", "vehicles"), [(2, 3), (3, 0), (9, 1)])
def test_sizes_that_cannot_be(customers: int, vehicles: int) -> None:
    """More vehicles than customers, none, or more places than junctions."""
    with pytest.raises(ValueError, match=r"vehicles need|too few"):
        scaling_case(customers, vehicles, side=3)
