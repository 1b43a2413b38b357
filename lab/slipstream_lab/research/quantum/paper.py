"""The figures of the paper's tables of hardware benchmarks and of its p-sweep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PaperRow:
    """One row; None where the paper gives no figure.

    Attributes:
        wall_s: with up to 100 iterations of training, s.
        p_feasible, p_optimal: shares of raw shots.
        energy_kwh: of the best solution of its one instance.
        two_qubit_depth, two_qubit_gates: from its text.
        cost: of its QUBO, in a unit that it does not name.
    """

    wall_s: float
    p_feasible: float | None = None
    p_optimal: float | None = None
    energy_kwh: float | None = None
    two_qubit_depth: int | None = None
    two_qubit_gates: int | None = None
    cost: float | None = None

    @property
    def gap(self) -> float | None:
        """Relative excess of the cost over the optimum's."""
        if self.cost is None:
            return None
        return max(0.0, (self.cost - OPTIMAL_COST) / abs(OPTIMAL_COST))


OPTIMAL_COST: Final = -2.3338
"""As the paper's p-sweep has it; its table of hardware benchmarks says -2.333."""

EXACT: Final = PaperRow(0.400, 1.0, 1.0, 16.8, cost=OPTIMAL_COST)
ISKAY: Final = PaperRow(119.79, energy_kwh=16.8, cost=OPTIMAL_COST)
QAOA_SIMULATED: Final[Mapping[int, PaperRow]] = {
    1: PaperRow(0.12, 0.182, 0.041, 19.0, cost=-2.167),
    2: PaperRow(0.45, 0.454, 0.185, 16.8, cost=OPTIMAL_COST),
}
QAOA_DEVICE: Final[Mapping[int, PaperRow]] = {
    1: PaperRow(8.12, 0.0, 0.0, 21.2, 84, 312, -1.825),
    2: PaperRow(42.85, 0.0, 0.0, 19.0, 168, 624, -2.167),
}
LC_QAOA_DEVICE: Final[Mapping[int, PaperRow]] = {
    1: PaperRow(23.91, 0.125, 0.028, 19.0, 28, 96, -2.1670),
    2: PaperRow(31.34, 0.386, 0.142, 16.8, 56, 192, OPTIMAL_COST),
    3: PaperRow(54.91, 0.378, cost=-2.3336),
    4: PaperRow(77.50, 0.365, cost=-2.3337),
    5: PaperRow(75.71, 0.362, cost=-2.3337),
}
