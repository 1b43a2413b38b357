"""Sensitivity of the stability flag to noise on the features (paper, table "Noise Propagation").

The paper multiplies the features s_e by Gaussian noise and counts the segments that are still
flagged stable. The same is done here to states that were measured, with the paper's bare rule.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera.homography import Array
from edge_daemon.features.stability import classify
from edge_daemon.settings import StabilitySettings
from slipstream.messages import KinematicFeatures, SegmentState

PAPER_STABLE_SHARE: Final = {0.0: 1.0, 0.1: 0.942, 0.2: 0.885, 0.3: 0.821}
"""Stable segments by level of noise in the paper's table."""


@dataclass(frozen=True)
class NoiseRow:
    """One level of noise.

    Attributes:
        noise: standard deviation of the factor 1 + noise·N(0, 1).
        wrongly_stable_share: of the states turbulent without noise, flagged stable with it; None
            without such states.
    """

    noise: float
    stable_share: float
    standard_error: float
    wrongly_stable_share: float | None


@dataclass(frozen=True)
class NoiseTable:
    """The table, and what it rests on."""

    stable: int
    turbulent: int
    unknown: int
    segments: int
    rows: tuple[NoiseRow, ...]


def noise_table(
    states: Iterable[SegmentState], levels: Sequence[float], draws: int, seed: int
) -> NoiseTable:
    """Put noise on the features of measured states and count the flags that survive.

    Args:
        states: any; what the bare rule leaves unknown takes no part.

    Raises:
        ValueError: no state is stable without noise.
    """
    bare = StabilitySettings().bare()
    features: dict[int | None, list[Array]] = {0: [], 1: [], None: []}
    segments = set()
    for state in states:
        flag = classify(state.features, state.vehicles, state.frames, state.coverage, bare)
        features[flag.y_e].append(_vector(state.features))
        if flag.y_e == 1:
            segments.add((state.rsu, state.segment))
    if not features[1]:
        raise ValueError("no state is stable by the paper's rule")
    stable, turbulent = np.array(features[1]), np.array(features[0]).reshape(-1, 6)
    rng = np.random.default_rng(seed)
    rows = []
    for level in levels:
        share = float(np.mean(_flags(stable, level, draws, rng, bare)))
        wrong = _flags(turbulent, level, draws, rng, bare)
        rows.append(
            NoiseRow(
                level,
                share,
                float(np.sqrt(share * (1 - share) / len(stable))),
                float(np.mean(wrong)) if wrong.size else None,
            )
        )
    return NoiseTable(len(stable), len(turbulent), len(features[None]), len(segments), tuple(rows))


def stable_by_bare_rule(features: Array, settings: StabilitySettings) -> npt.NDArray[np.bool_]:
    """The paper's rule on features (..., 6) in the order of `KinematicFeatures`' fields."""
    mean, spread, variance = features[..., 0], features[..., 3], features[..., 4]
    return np.asarray(
        (mean > 0)
        & (spread <= settings.max_speed_cv * mean)
        & (variance <= settings.max_acceleration_variance_m2ps4)
    )


def _vector(features: KinematicFeatures | None) -> Array:
    """s_e = [v̄, ā, ρ, σ_v, σ²_a, Δd̄]."""
    if features is None:
        return np.full(6, np.nan)
    gap = features.mean_gap_m.value if features.mean_gap_m else np.nan
    return np.array(
        [
            features.mean_speed_mps.value,
            features.mean_acceleration_mps2.value,
            features.density_veh_per_m.value,
            features.speed_std_mps.value,
            features.acceleration_variance_m2ps4.value,
            gap,
        ]
    )


def _flags(
    features: Array,
    level: float,
    draws: int,
    rng: np.random.Generator,
    settings: StabilitySettings,
) -> npt.NDArray[np.bool_]:
    """Flags of noisy copies, shape (draws, n): each feature has a factor of its own."""
    return np.stack(
        [
            stable_by_bare_rule(
                features * (1 + level * rng.standard_normal(features.shape)), settings
            )
            for _ in range(draws)
        ]
    )
