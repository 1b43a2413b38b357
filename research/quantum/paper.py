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
    """

    wall_s: float
    p_feasible: float | None = None
    p_optimal: float | None = None
    energy_kwh: float | None = None
    two_qubit_depth: int | None = None
    two_qubit_gates: int | None = None


EXACT: Final = PaperRow(0.400, 1.0, 1.0, 16.8)
ISKAY: Final = PaperRow(119.79, energy_kwh=16.8)
QAOA_SIMULATED: Final[Mapping[int, PaperRow]] = {
    1: PaperRow(0.12, 0.182, 0.041, 19.0),
    2: PaperRow(0.45, 0.454, 0.185, 16.8),
}
QAOA_DEVICE: Final[Mapping[int, PaperRow]] = {
    1: PaperRow(8.12, 0.0, 0.0, 21.2, 84, 312),
    2: PaperRow(42.85, 0.0, 0.0, 19.0, 168, 624),
}
LC_QAOA_DEVICE: Final[Mapping[int, PaperRow]] = {
    1: PaperRow(23.91, 0.125, 0.028, 19.0, 28, 96),
    2: PaperRow(31.34, 0.386, 0.142, 16.8, 56, 192),
    3: PaperRow(54.91, 0.378),
    4: PaperRow(77.50, 0.365),
    5: PaperRow(75.71, 0.362),
}
