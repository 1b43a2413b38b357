"""The flag and its unknowns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import gamma

from edge_daemon.features.moments import VariancePosterior
from edge_daemon.features.stability import Flag, StabilityJudge, classify
from edge_daemon.settings import StabilitySettings
from slipstream.config import check
from slipstream.errors import InputError
from slipstream.messages import Estimate, KinematicFeatures

BARE = StabilitySettings().bare()


def features(
    mean: float = 16.0,
    spread: float = 0.5,
    variance: float = 0.1,
    error: float | None = 0.01,
    spread_error: float | None = 0.0,
    mean_error: float | None = 0.0,
) -> KinematicFeatures:
    """Features that matter for the flag."""
    return KinematicFeatures(
        mean_speed_mps=Estimate(value=mean, standard_error=mean_error),
        mean_acceleration_mps2=Estimate(value=0.0),
        density_veh_per_m=Estimate(value=0.05),
        speed_std_mps=Estimate(value=spread, standard_error=spread_error),
        acceleration_variance_m2ps4=Estimate(value=variance, standard_error=error),
    )


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        (features(), 1),
        (features(spread=0.12 * 16.0), 1),
        (features(spread=0.1201 * 16.0), 0),
        (features(variance=0.5), 1),
        (features(variance=0.501), 0),
        (features(mean=0.0, spread=0.0), 0),
        (features(mean=0.5, spread=0.05), 1),
        (features(error=None, spread_error=None), 1),
    ],
)
def test_the_papers_rule_bare(seen: KinematicFeatures, expected: int) -> None:
    """CV ≤ 0.12 and σ²_a ≤ 0.5 m²/s⁴, both inclusive; standing traffic is not stable."""
    assert classify(seen, 5, 300, 1.0, BARE) == Flag(expected, None)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        (features(variance=0.1, error=0.1), Flag(1, None)),
        (features(variance=0.3, error=0.2), Flag(None, "uncertain")),
        (features(variance=0.6, error=0.2), Flag(None, "uncertain")),
        (features(variance=2.0, error=0.6), Flag(0, None)),
        (features(variance=0.1, error=None), Flag(None, "uncertain")),
        (features(variance=2.0, error=None), Flag(None, "uncertain")),
        (features(spread=1.9, spread_error=0.3), Flag(None, "uncertain")),
        (features(spread_error=None), Flag(None, "uncertain")),
        (features(mean_error=None), Flag(None, "uncertain")),
        (features(spread=1.9, spread_error=0.3, variance=2.0), Flag(0, None)),
        (features(variance=0.5, error=0.0), Flag(1, None)),
        (features(variance=0.51, error=0.0), Flag(0, None)),
    ],
)
def test_a_flag_is_given_only_where_the_errors_allow_it(
    seen: KinematicFeatures, expected: Flag
) -> None:
    """One quantity surely over its threshold decides; otherwise both must be surely under."""
    assert classify(seen, 5, 300, 1.0, StabilitySettings()) == expected


@pytest.mark.parametrize(
    ("spread_error", "mean_error", "sure"),
    [
        (0.130, 0.0, True),
        (0.140, 0.0, False),
        (0.0, 1.23, True),
        (0.0, 1.29, False),
        (0.09, 0.90, True),
        (0.10, 0.95, False),
    ],
)
def test_the_error_of_the_cv_is_that_of_a_quotient(
    spread_error: float, mean_error: float, sure: bool
) -> None:
    """√(s_σ² + CV² s_v̄²) / v̄: at 1.7 / 16 up to 0.12 there is room for 0.2205 m/s, of which 95 %
    are 1.645 deviations.
    """
    seen = features(16.0, 1.7, spread_error=spread_error, mean_error=mean_error)
    flag = classify(seen, 5, 300, 1.0, StabilitySettings())
    assert flag == (Flag(1, None) if sure else Flag(None, "uncertain"))


def test_the_probability_is_that_of_the_mixture_and_is_told() -> None:
    """Calm with 0.9, else rough: its mean and standard error alone would say another one."""
    mixture = VariancePosterior(np.array([0.9, 0.1]), np.array([0.05, 1.2]), np.array([0.02, 0.3]))
    seen = features(variance=mixture.estimate.value, error=mixture.estimate.standard_error)
    flag = classify(seen, 5, 300, 1.0, StabilitySettings(), variance=mixture)
    assert flag == Flag(None, "uncertain")
    assert flag.p_stable == pytest.approx(0.9, abs=1e-3)
    moved = mixture.corrected(Estimate(value=0.5 * seen.acceleration_variance_m2ps4.value))
    assert moved.estimate.value == pytest.approx(0.5 * mixture.estimate.value)
    told = Estimate(value=mixture.estimate.value, standard_error=1.0)
    assert mixture.corrected(told).estimate.standard_error == pytest.approx(1.0)


def test_every_flag_that_is_judged_tells_its_probability() -> None:
    """Stable, turbulent, kept for its dwell, and standing traffic; of the posterior that is given,
    where the features alone would tell nothing.
    """
    calm, rough = (
        VariancePosterior(np.ones(1), np.full(1, value), np.full(1, 1e-6)) for value in (0.1, 2.0)
    )
    doubted = VariancePosterior(np.array([0.6, 0.4]), np.array([0.1, 2.0]), np.full(2, 1e-6))
    judge, seen = StabilityJudge(StabilitySettings()), features(error=None)
    told = [
        judge.judge("s", n * SECOND, seen, 5, 300, 1.0, variance=posterior)
        for n, posterior in enumerate((calm, doubted, rough))
    ]
    assert [(flag.y_e, flag.p_stable) for flag in told] == [
        (1, pytest.approx(1.0)),
        (1, pytest.approx(0.6)),
        (0, pytest.approx(0.0)),
    ]
    stands = features(mean=0.0, spread=0.0)
    assert classify(stands, 5, 300, 1.0, StabilitySettings(), variance=calm).p_stable == 0.0


def test_a_judged_window_without_enough_frames_says_which_way() -> None:
    """None at all, too few of the window, or too far apart all the time."""
    judge = StabilityJudge(StabilitySettings())
    told = [judge.judge("s", 1, None, 0, frames, 0.3).reason for frames in (0, 90)]
    assert told == ["no_frames", "window_not_covered"]
    assert judge.judge("s", 1, None, 0, 9, 0.3, sparse=True).reason == "low_frame_rate"


@given(st.floats(0.01, 3), st.floats(0.001, 2), st.floats(0.1, 1))
def test_a_variance_is_below_a_limit_as_often_as_drawn_gammas_are(
    mean: float, std: float, limit: float
) -> None:
    """And the surer, the higher the limit."""
    posterior = VariancePosterior.of(Estimate(value=mean, standard_error=std))
    shape = (mean / std) ** 2
    assert posterior.below(limit) == pytest.approx(gamma.cdf(limit, shape, scale=std**2 / mean))
    assert posterior.below(limit) <= posterior.below(2 * limit)
    over = VariancePosterior(np.full(20, 0.05 + 1e-16), np.full(20, 1e-9), np.full(20, 1e-9))
    assert over.below(limit) == 1.0


def test_a_window_covered_as_far_as_needed_is_judged() -> None:
    """The least coverage is enough."""
    assert classify(features(), 5, 300, 0.8, StabilitySettings()).y_e == 1


@given(st.floats(0.1, 30), st.floats(0, 10), st.floats(0, 3), st.floats(0, 1), st.floats(0, 1))
def test_stable_always_means_that_the_papers_rule_holds(
    mean: float, spread: float, variance: float, error: float, spread_error: float
) -> None:
    """Doubt only ever makes the rule stricter, but where it is larger than what it doubts."""
    seen = features(mean, spread, variance, min(error, variance), spread_error)
    if classify(seen, 5, 300, 1.0, StabilitySettings()).y_e == 1:
        assert classify(seen, 5, 300, 1.0, BARE).y_e == 1


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


CALM, THIN = features(mean=30.0), features(mean=29.0)
MINUTE = 60 * 10**9


def judged(
    settings: StabilitySettings, *windows: tuple[KinematicFeatures | None, int]
) -> list[int]:
    """Flags of windows of a minute each, by how many vehicles came by; -1: unknown."""
    judge = StabilityJudge(settings)
    flags = [
        judge.judge("s", n * MINUTE, seen, vehicles, 1800, 1.0).y_e
        for n, (seen, vehicles) in enumerate(windows)
    ]
    return [-1 if flag is None else flag for flag in flags]


def test_a_stable_segment_stays_so_while_traffic_is_thin_and_no_longer_than_it_may() -> None:
    """Counted from the last window that had vehicles enough; by default no window longer."""
    windows = [(CALM, 5), (THIN, 2), (None, 0), (THIN, 1), (CALM, 3), (None, 0)]
    assert judged(StabilitySettings(keep_s=120.0), *windows) == [1, 1, 1, -1, 1, 1]
    assert judged(StabilitySettings(), *windows) == [1, -1, -1, -1, 1, -1]
    assert judged(StabilitySettings(keep_s=120.0).bare(), *windows) == [1, -1, -1, -1, 1, -1]


def test_a_kept_flag_ends_with_what_speaks_against_it() -> None:
    """Slow vehicles, turbulence or doubt do; a calm vehicle alone does not bring it back."""
    keeps = StabilitySettings(keep_s=600.0)
    for against in (
        (features(mean=0.69 * 30.0), 1),
        (features(variance=2.0), 5),
        (features(variance=0.4, error=0.3), 5),
    ):
        flags = judged(keeps, (CALM, 5), (THIN, 1), against, (THIN, 1))
        assert flags[:2] == [1, 1]
        assert 1 not in flags[2:]
    assert judged(keeps, (CALM, 5), (features(mean=0.71 * 30.0), 1)) == [1, 1]


def test_bare_is_the_rule_without_doubt_or_memory() -> None:
    """And with the thresholds as they were."""
    own = StabilitySettings(max_speed_cv=0.2, keep_s=60.0)
    assert own.bare() == StabilitySettings(max_speed_cv=0.2, confidence=0.0, keep_s=0.0)
    with pytest.raises(InputError, match=r"above 0\.5, or 0"):
        check({"confidence": 0.5}, StabilitySettings, "edge.toml")


SECOND = 10**9
DOUBTED = features(mean=30.0, variance=0.4, error=0.1)


def test_a_stable_segment_does_not_flap_and_ends_with_its_doubt() -> None:
    """For three seconds after the window that was judged, while it is likelier calm than not."""
    judge = StabilityJudge(StabilitySettings())

    def flag(second: float, seen: KinematicFeatures) -> int | None:
        return judge.judge("s", round(second * SECOND), seen, 5, 300, 1.0).y_e

    assert flag(1, DOUBTED) is None
    assert flag(2, CALM) == 1
    assert [flag(second, DOUBTED) for second in (3, 4, 5)] == [1, 1, 1]
    assert flag(5.001, DOUBTED) is None
    assert flag(5.5, DOUBTED) is None
    assert flag(6, CALM) == 1
    likelier_not = features(mean=30.0, variance=0.6, error=0.1)
    assert flag(7, likelier_not) is None
    assert flag(8, CALM) == 1
    assert flag(9, features(variance=2.0, error=0.1)) == 0
    assert flag(10, DOUBTED) is None


def test_what_is_kept_is_kept_to_the_nanosecond_and_at_seven_tenths_of_the_speed() -> None:
    """From the next nanosecond after the window that was judged until `keep_s` have gone by."""
    for after_ns, mean, kept in (
        (0, 30.0, False),
        (1, 30.0, True),
        (2 * MINUTE, 30.0, True),
        (2 * MINUTE + 1, 30.0, False),
        (MINUTE, 0.7 * 30.0, True),
    ):
        judge = StabilityJudge(StabilitySettings(keep_s=120.0))
        assert judge.judge("s", MINUTE, CALM, 5, 300, 1.0).y_e == 1
        flag = judge.judge("s", MINUTE + after_ns, features(mean=mean), 1, 300, 1.0)
        assert flag == (Flag(1, None) if kept else Flag(None, "too_few_vehicles"))


def test_a_fault_or_a_step_back_of_the_clock_ends_what_is_kept() -> None:
    """After either the segment has to be judged anew."""
    judge = StabilityJudge(StabilitySettings(keep_s=600.0))
    assert judge.invalidate("s", "frozen") == Flag(None, "frozen")

    def flag(time_ns: int, vehicles: int) -> int | None:
        return judge.judge("s", time_ns, THIN, vehicles, 300, 1.0).y_e

    assert flag(10 * MINUTE, 5) == 1
    assert judge.invalidate("s", "frozen") == Flag(None, "frozen")
    assert flag(11 * MINUTE, 1) is None
    assert flag(12 * MINUTE, 5) == 1
    assert flag(5 * MINUTE, 1) is None
    assert flag(13 * MINUTE, 5) == 1
    judge.reset()
    assert flag(14 * MINUTE, 1) is None


@pytest.mark.parametrize(
    ("mean", "variance", "reason"),
    [(30.0, 4.9, None), (30.0, 5.2, "implausible"), (10.0, 8.9, None), (10.0, 9.1, "implausible")],
)
def test_accelerations_that_no_traffic_has_are_unknown(
    mean: float, variance: float, reason: str | None
) -> None:
    """At 108 km/h an engine leaves 1.5 m/s², so that ((1.5 + 3) / 2)² = 5.1 is the most."""
    flag = classify(features(mean=mean, variance=variance), 5, 300, 1.0, StabilitySettings())
    assert flag.reason == reason
    assert flag.y_e == (0 if reason is None else None)
