"""Results of cells that nobody planned: made up by a rule, for what is done with them."""

from __future__ import annotations

from slipstream_lab.research.coordination.cells import (
    OWN,
    Bounded,
    CellResult,
    CoordinationCell,
    Plans,
    StrategyRow,
)
from slipstream_lab.research.coordination.plan import PlanOutcome

CELL = CoordinationCell("one", 20, 10, 10)


def row(strategy: str, net_kwh: float, worst_kwh: float = 0.0) -> StrategyRow:
    """A strategy's result: drafting alone, no waits paid."""
    carriers = (worst_kwh, net_kwh - worst_kwh)
    return StrategyRow(strategy, PlanOutcome(net_kwh, 0.0, 0.0, 1.0, 2.0, 3.0, 50.0, carriers), 0.1)


def result(
    own_kwh: float,
    rival_kwh: float,
    bound_kwh: float,
    worst_kwh: float = 0.0,
    cell: CoordinationCell = CELL,
) -> CellResult:
    """A cell's, of a ceiling of 10 kWh: hub waiting is the rival, the others save nothing."""
    names = ("as ready", "threshold", "pairwise leaders")
    rows = (*(row(name, 0.0) for name in names), row("hub waiting", rival_kwh))
    plans = Plans(10.0, 60.0, (*rows, row(OWN, own_kwh, worst_kwh)))
    return CellResult(cell, plans, Bounded(bound_kwh, 2.0, 1.0))
