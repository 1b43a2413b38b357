"""The flag and its unknowns."""

from __future__ import annotations

import pytest

from edge_daemon.stability import Flag, StabilitySettings, classify
from slipstream.config import check
from slipstream.errors import InputError
from slipstream.messages import Estimate, KinematicFeatures


def features(
    mean: float = 16.0, spread: float = 0.5, variance: float = 0.1, error: float = 0.01
) -> KinematicFeatures:
    """Features that matter for the flag."""
    return KinematicFeatures(
        mean_speed_mps=Estimate(value=mean),
        mean_acceleration_mps2=Estimate(value=0.0),
        density_veh_per_m=Estimate(value=0.05),
        speed_std_mps=Estimate(value=spread),
        acceleration_variance_m2ps4=Estimate(value=variance, standard_error=error),
    )


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (features(), Flag(1, None)),
        (features(spread=0.12 * 16.0), Flag(1, None)),
        (features(spread=0.1201 * 16.0), Flag(0, None)),
        (features(variance=0.5), Flag(1, None)),
        (features(variance=0.501), Flag(0, None)),
        (features(mean=0.0, spread=0.0), Flag(0, None)),
        (features(error=0.6), Flag(None, "uncertain")),
        (features(variance=2.0, error=0.6), Flag(0, None)),
    ],
)
def test_the_papers_rule(given: KinematicFeatures, expected: Flag) -> None:
    """CV ≤ 0.12 and σ²_a ≤ 0.5 m²/s⁴, both inclusive; standing traffic is not stable."""
    assert classify(given, 5, 300, 1.0, StabilitySettings()) == expected


def test_a_variance_of_unknown_error_is_not_taken_for_sure() -> None:
    """No standard error, no stable flag."""
    unsure = features().model_copy(
        update={"acceleration_variance_m2ps4": Estimate(value=0.1, standard_error=None)}
    )
    assert classify(unsure, 5, 300, 1.0, StabilitySettings()) == Flag(None, "uncertain")


@pytest.mark.parametrize(
    "setting", [{"max_speed_cv": 12.0}, {"max_acceleration_variance_m2ps4": float("inf")}]
)
def test_thresholds_that_would_pass_everything_are_refused(setting: dict[str, float]) -> None:
    """12 % is 0.12."""
    with pytest.raises(InputError, match=next(iter(setting))):
        check(setting, StabilitySettings, "edge.toml")


@pytest.mark.parametrize(
    ("vehicles", "frames", "coverage", "reason"),
    [
        (5, 0, 0.0, "no_frames"),
        (5, 100, 0.5, "window_not_covered"),
        (2, 300, 1.0, "too_few_vehicles"),
    ],
)
def test_without_data_the_flag_is_unknown(
    vehicles: int, frames: int, coverage: float, reason: str
) -> None:
    """Never stable by default."""
    flag = classify(features(), vehicles, frames, coverage, StabilitySettings())
    assert flag == Flag(None, reason)  # type: ignore[arg-type]
    assert classify(None, 0, 300, 1.0, StabilitySettings()) == Flag(None, "too_few_vehicles")
