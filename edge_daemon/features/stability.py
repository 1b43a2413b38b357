"""Features → the stability flag y_e, or unknown with a reason (paper, section V-A).

Hysteresis makes the paper's rule stricter, never looser: stable always means that it holds, or,
with `keep_s`, that it held when traffic was last dense enough to tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, isinf
from typing import Final, Literal

from edge_daemon.settings import StabilitySettings
from slipstream.messages import Estimate, KinematicFeatures, UnknownReason

MIN_COVERAGE: Final = 0.8
"""Share of the window that frames must cover."""
_MIN_SPEED_SHARE: Final = 0.7
"""A kept flag ends below this share of the mean speed at which it was judged: a vehicle that stands
on an empty road is not light traffic."""
_MAX_BRAKING_MPS2: Final = 3.0
_MAX_ACCELERATION_MPS2: Final = 3.0
_POWER_W_PER_KG: Final = 45.0


@dataclass(frozen=True)
class Flag:
    """1 stable, 0 turbulent, None unknown for the reason."""

    y_e: Literal[0, 1] | None
    reason: UnknownReason | None


@dataclass(frozen=True)
class _Stable:
    """When a segment was last judged stable, and how fast its traffic was then."""

    judged_ns: int
    speed_mps: float


class StabilityJudge:
    """The flags of an RSU's segments from window to window."""

    def __init__(self, settings: StabilitySettings) -> None:
        self._settings = settings
        self._stable: dict[str, _Stable] = {}

    def judge(
        self,
        segment: str,
        time_ns: int,
        features: KinematicFeatures | None,
        vehicles: int,
        frames: int,
        coverage: float,
        *,
        sparse: bool = False,
    ) -> Flag:
        """The flag of a segment's latest window; windows come in the order of their ends,
        `time_ns`, and after a step back of the clock nothing is kept. The other arguments are those
        of `classify`.
        """
        before = self._stable.get(segment)
        flag = classify(
            features,
            vehicles,
            frames,
            coverage,
            self._settings,
            was_stable=before is not None,
            sparse=sparse,
        )
        if flag.y_e == 1 and features is not None:
            self._stable[segment] = _Stable(time_ns, features.mean_speed_mps.value)
        elif flag.reason == "too_few_vehicles" and self._keeps(before, time_ns, features):
            return Flag(1, None)
        else:
            self._stable.pop(segment, None)
        return flag

    def invalidate(self, segment: str, reason: UnknownReason) -> Flag:
        """The flag of a segment whose camera has a fault."""
        self._stable.pop(segment, None)
        return Flag(None, reason)

    def reset(self) -> None:
        """Drop all kept flags: data so far is not to be trusted."""
        self._stable.clear()

    def _keeps(
        self, before: _Stable | None, time_ns: int, features: KinematicFeatures | None
    ) -> bool:
        if before is None or not 0 < time_ns - before.judged_ns <= self._settings.keep_s * 1e9:
            return False
        slowest_mps = _MIN_SPEED_SHARE * before.speed_mps
        return features is None or features.mean_speed_mps.value >= slowest_mps


def classify(
    features: KinematicFeatures | None,
    vehicles: int,
    frames: int,
    coverage: float,
    settings: StabilitySettings,
    *,
    was_stable: bool = False,
    sparse: bool = False,
) -> Flag:
    """Decide the flag of one segment for one window.

    Args:
        features: of the window; None if no vehicle could be measured.
        vehicles: with a usable track.
        frames: processed in the window.
        coverage: share of the window with frames, in [0, 1].
        was_stable: the segment's flag was 1 so far: it stays so up to the threshold itself.
        sparse: frames come too seldom for vehicles to be followed from one to the next.
    """
    if frames == 0:
        return Flag(None, "no_frames")
    if coverage < MIN_COVERAGE:
        return Flag(None, "low_frame_rate" if sparse else "window_not_covered")
    if features is None or vehicles < settings.min_vehicles:
        return Flag(None, "too_few_vehicles")
    most = max_acceleration_variance(features.mean_speed_mps.value)
    if features.acceleration_variance_m2ps4.value > most:
        return Flag(None, "implausible")
    ratios = _ratios(features, settings)
    values = [ratio.value for ratio in ratios]
    errors = [_margin(ratio, settings.confidence_sigmas) for ratio in ratios]
    lowest = max(value - (0.0 if isinf(e) else e) for value, e in zip(values, errors, strict=True))
    highest = max(value + e for value, e in zip(values, errors, strict=True))
    slack = settings.hysteresis
    if lowest > 1:
        return Flag(0, None)
    if was_stable and max(values) <= 1 and highest <= 1 + slack:
        return Flag(1, None)
    if highest <= 1:
        return Flag(1 if highest <= 1 - slack else 0, None)
    return Flag(None, "uncertain")


def max_acceleration_variance(mean_speed_mps: float) -> float:
    """The largest variance of acceleration that traffic of a mean speed can have, m²/s⁴.

    Accelerations between −b and a have a variance of ((a + b) / 2)² at most (Popoviciu). b and a
    are 3 m/s², beyond what drivers use but in emergencies; from 15 m/s on an engine's 45 W/kg allow
    less than that: a = 45 / v. 9 m²/s⁴ in a town, 5 at 30 m/s.
    """
    a = min(_MAX_ACCELERATION_MPS2, _POWER_W_PER_KG / max(mean_speed_mps, 1.0))
    return ((a + _MAX_BRAKING_MPS2) / 2) ** 2


def _ratios(features: KinematicFeatures, settings: StabilitySettings) -> tuple[Estimate, Estimate]:
    """The rule's two quantities as multiples of their thresholds."""
    mean, spread = features.mean_speed_mps, features.speed_std_mps
    if mean.value <= 0:
        # Standing traffic has no CV; it counts as turbulent.
        cv = Estimate(value=1e9, standard_error=0.0)
    else:
        value = spread.value / mean.value
        errors = spread.standard_error, mean.standard_error
        error = (
            None
            if None in errors
            else hypot(errors[0] or 0.0, value * (errors[1] or 0.0)) / mean.value
        )
        cv = _over(Estimate(value=value, standard_error=error), settings.max_speed_cv)
    variance = features.acceleration_variance_m2ps4
    return cv, _over(variance, settings.max_acceleration_variance_m2ps4)


def _over(estimate: Estimate, limit: float) -> Estimate:
    error = estimate.standard_error
    return Estimate(
        value=estimate.value / limit, standard_error=None if error is None else error / limit
    )


def _margin(ratio: Estimate, sigmas: float) -> float:
    """Margin of a ratio; infinite for one without an error, where errors count."""
    if sigmas == 0:
        return 0.0
    return inf if ratio.standard_error is None else sigmas * ratio.standard_error
