"""Features → the stability flag y_e, or unknown with a reason.

The paper's rule (section V-A): stable if CV = σ_v/v̄ ≤ 0.12 and σ²_a ≤ 0.5 m²/s⁴. A flag is only
given where the data carry it: everything else is unknown, which gates like turbulent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from slipstream.config import Settings
from slipstream.messages import KinematicFeatures, UnknownReason


class StabilitySettings(Settings):
    """Thresholds of the flag and what it needs to be given at all."""

    max_speed_cv: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.12, description="σ_v / v̄, dimensionless."
    )
    max_acceleration_variance_m2ps4: Annotated[float, Field(gt=0, le=100)] = 0.5
    min_vehicles: Annotated[int, Field(ge=1)] = 3
    min_coverage: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.8, description="Share of the window that frames must cover."
    )


@dataclass(frozen=True)
class Flag:
    """1 stable, 0 turbulent, None unknown for the reason."""

    y_e: Literal[0, 1] | None
    reason: UnknownReason | None


def classify(
    features: KinematicFeatures | None,
    vehicles: int,
    frames: int,
    coverage: float,
    settings: StabilitySettings,
) -> Flag:
    """Decide the flag of one segment for one window.

    Args:
        features: of the window; None if no vehicle could be measured.
        vehicles: with a usable track.
        frames: processed in the window.
        coverage: share of the window with frames, in [0, 1].
        settings: the thresholds.
    """
    if frames == 0:
        return Flag(None, "no_frames")
    if coverage < settings.min_coverage:
        return Flag(None, "window_not_covered")
    if features is None or vehicles < settings.min_vehicles:
        return Flag(None, "too_few_vehicles")
    variance = features.acceleration_variance_m2ps4
    limit = settings.max_acceleration_variance_m2ps4
    mean, spread = features.mean_speed_mps.value, features.speed_std_mps.value
    # Standing traffic has no CV; it is anything but a place for close gaps.
    turbulent = mean <= 0 or spread / mean > settings.max_speed_cv or variance.value > limit
    if turbulent:
        return Flag(0, None)
    if variance.standard_error is None or variance.standard_error > limit:
        return Flag(None, "uncertain")
    return Flag(1, None)
