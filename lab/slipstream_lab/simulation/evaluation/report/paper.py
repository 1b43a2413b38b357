"""What the paper reports of its day, for the columns beside ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PaperDay:
    """A column of the paper's table "24-Hour Microscopic Fleet Simulation Summary"."""

    distance_km: float
    travel_h: float
    platooned_km: float
    energy_kwh: float
    saving: float | None


PAPER_BASELINE: Final = PaperDay(1420.5, 48.2, 0.0, 358.4, None)
PAPER_COOPERATIVE: Final = PaperDay(1385.2, 42.1, 682.4, 292.1, 0.185)


@dataclass(frozen=True)
class PaperNoise:
    """A row of the paper's table "Noise Propagation & System Robustness"."""

    stable_share: float
    platooned_km: float
    energy_kwh: float
    saving: float


PAPER_NOISE: Final = {
    0.0: PaperNoise(1.0, 682.4, 292.1, 0.185),
    0.1: PaperNoise(0.942, 646.1, 294.8, 0.177),
    0.2: PaperNoise(0.885, 606.8, 297.6, 0.170),
    0.3: PaperNoise(0.821, 562.9, 301.2, 0.160),
}
"""By level of noise on the features."""
