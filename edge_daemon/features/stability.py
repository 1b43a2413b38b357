"""Features → the stability flag y_e, or unknown with a reason (paper, section V-A).

The paper's rule is CV ≤ 0.12 and σ²_a ≤ 0.5 m²/s⁴. Neither is known for certain: the flag goes by
the probability that the rule holds, P = P(CV ≤ …) P(σ²_a ≤ …). Stable means that it is surely held;
with `keep_s`, that it was when traffic was last dense enough to tell.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import erfc, hypot, sqrt
from typing import Final, Literal

from edge_daemon.features.moments import VariancePosterior
from edge_daemon.settings import StabilitySettings
from slipstream.messages import KinematicFeatures, UnknownReason

MIN_COVERAGE: Final = 0.8
"""Share of the window that frames must cover."""
DWELL_S: Final = 3.0
"""A stable segment stays so for as long while the rule is likelier to hold than not: windows that
end so soon after another have most of their data in common."""
_MIN_SPEED_SHARE: Final = 0.7
"""A kept flag ends below this share of the mean speed at which it was judged: a vehicle that stands
on an empty road is not light traffic."""
_MAX_BRAKING_MPS2: Final = 3.0
_MAX_ACCELERATION_MPS2: Final = 3.0
_POWER_W_PER_KG: Final = 45.0


@dataclass(frozen=True)
class Flag:
    """1 stable, 0 turbulent, None unknown for the reason; and the probability that the rule holds,
    None where nothing tells it.
    """

    y_e: Literal[0, 1] | None
    reason: UnknownReason | None
    p_stable: float | None = field(default=None, compare=False)


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
        variance: VariancePosterior | None = None,
        sparse: bool = False,
    ) -> Flag:
        """The flag of a segment's latest window; windows come in the order of their ends,
        `time_ns`, and after a step back of the clock nothing is kept. The other arguments are those
        of `classify`.
        """
        before = self._stable.get(segment)
        flag = classify(
            features, vehicles, frames, coverage, self._settings, variance=variance, sparse=sparse
        )
        if flag.y_e == 1 and features is not None:
            self._stable[segment] = _Stable(time_ns, features.mean_speed_mps.value)
        elif flag.reason == "too_few_vehicles" and self._keeps(before, time_ns, features):
            return Flag(1, None)
        elif flag.reason == "uncertain" and _dwells(before, time_ns, flag):
            return Flag(1, None, flag.p_stable)
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


def _dwells(before: _Stable | None, time_ns: int, flag: Flag) -> bool:
    if before is None or flag.p_stable is None or flag.p_stable < 0.5:
        return False
    return 0 < time_ns - before.judged_ns <= DWELL_S * 1e9


def classify(
    features: KinematicFeatures | None,
    vehicles: int,
    frames: int,
    coverage: float,
    settings: StabilitySettings,
    *,
    variance: VariancePosterior | None = None,
    sparse: bool = False,
) -> Flag:
    """Decide the flag of one segment for one window.

    Args:
        features: of the window; None if no vehicle could be measured.
        vehicles: with a usable track.
        frames: processed in the window.
        coverage: share of the window with frames, in [0, 1].
        variance: what σ²_a may be; None: a gamma distribution of its value and standard error.
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
    if settings.confidence == 0:
        return Flag(1 if _holds(features, settings) else 0, None)
    chance = _chance(features, variance, settings)
    if chance is None:
        return Flag(None, "uncertain")
    if chance >= settings.confidence:
        return Flag(1, None, chance)
    if chance <= 1 - settings.confidence:
        return Flag(0, None, chance)
    return Flag(None, "uncertain", chance)


def max_acceleration_variance(mean_speed_mps: float) -> float:
    """The largest variance of acceleration that traffic of a mean speed can have, m²/s⁴.

    Accelerations between −b and a have a variance of ((a + b) / 2)² at most (Popoviciu). b and a
    are 3 m/s², beyond what drivers use but in emergencies; from 15 m/s on an engine's 45 W/kg allow
    less than that: a = 45 / v. 9 m²/s⁴ in a town, 5 at 30 m/s.
    """
    a = min(_MAX_ACCELERATION_MPS2, _POWER_W_PER_KG / max(mean_speed_mps, 1.0))
    return ((a + _MAX_BRAKING_MPS2) / 2) ** 2


def _holds(features: KinematicFeatures, settings: StabilitySettings) -> bool:
    """The paper's rule by the values alone; standing traffic has no CV and is not stable."""
    mean, std = features.mean_speed_mps.value, features.speed_std_mps.value
    variance = features.acceleration_variance_m2ps4.value
    calm = variance <= settings.max_acceleration_variance_m2ps4
    return calm and mean > 0 and std / mean <= settings.max_speed_cv


def _chance(
    features: KinematicFeatures, variance: VariancePosterior | None, settings: StabilitySettings
) -> float | None:
    """Probability that the rule holds; None: a standard error is missing."""
    mean, spread = features.mean_speed_mps, features.speed_std_mps
    of_variance = features.acceleration_variance_m2ps4
    if mean.value <= 0:
        return 0.0
    if variance is None:
        if of_variance.standard_error is None:
            return None
        variance = VariancePosterior.of(of_variance)
    if spread.standard_error is None or mean.standard_error is None:
        return None
    cv = spread.value / mean.value
    error = hypot(spread.standard_error, cv * mean.standard_error) / mean.value
    left = settings.max_speed_cv - cv
    calm = float(left >= 0) if error <= 0 else erfc(-left / error / sqrt(2)) / 2
    return calm * variance.below(settings.max_acceleration_variance_m2ps4)
