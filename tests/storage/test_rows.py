"""The mapping of messages to rows follows the messages' fields."""

from __future__ import annotations

import pytest

from slipstream.messages import (
    CycleReport,
    EnergySummary,
    SolverReport,
    VehiclePlan,
)
from storage.models import CycleRow, PlanRow, SolverRunRow


@pytest.mark.parametrize(
    ("message", "row", "elsewhere"),
    [
        (CycleReport, CycleRow, {"energy", "gates", "plans", "solvers"}),
        (EnergySummary, CycleRow, set()),
        (SolverReport, SolverRunRow, set()),
        (VehiclePlan, PlanRow, set()),
    ],
)
def test_each_field_has_the_column_of_its_name(message, row, elsewhere):
    """A new field of a message needs a column and a migration, and no change of the mapping."""
    assert set(message.model_fields) - set(row.__table__.columns.keys()) == elsewhere
