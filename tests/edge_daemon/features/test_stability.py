"""The flag and its unknowns."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
        (features(variance=0.1, error=0.3), Flag(1, None)),
        (features(variance=0.4, error=0.2), Flag(None, "uncertain")),
        (features(variance=0.6, error=0.2), Flag(None, "uncertain")),
        (features(variance=2.0, error=0.6), Flag(0, None)),
        (features(variance=0.1, error=None), Flag(None, "uncertain")),
        (features(variance=2.0, error=None), Flag(0, None)),
        (features(variance=0.6, error=None), Flag(0, None)),
        (features(spread=1.9, spread_error=0.3), Flag(None, "uncertain")),
        (features(spread_error=None), Flag(None, "uncertain")),
        (features(mean_error=None), Flag(None, "uncertain")),
        (features(spread=1.9, spread_error=0.3, variance=2.0), Flag(0, None)),
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
        (0.215, 0.0, True),
        (0.225, 0.0, False),
        (0.0, 2.05, True),
        (0.0, 2.10, False),
        (0.15, 1.50, True),
        (0.15, 1.54, False),
    ],
)
def test_the_error_of_the_cv_is_that_of_a_quotient(
    spread_error: float, mean_error: float, sure: bool
) -> None:
    """√(s_σ² + CV² s_v̄²) / v̄: at 1.7 / 16 up to 0.12 there is room for 0.2205 m/s."""
    seen = features(16.0, 1.7, spread_error=spread_error, mean_error=mean_error)
    flag = classify(seen, 5, 300, 1.0, StabilitySettings(hysteresis=0.0))
    assert flag == (Flag(1, None) if sure else Flag(None, "uncertain"))


def test_a_segment_becomes_stable_later_than_it_stays_stable() -> None:
    """Between 0.95 and 1 of a threshold the flag keeps what it was, so that it does not flap."""
    settings = StabilitySettings(confidence_sigmas=0.0)
    between = features(variance=0.49)
    assert classify(between, 5, 300, 1.0, settings).y_e == 0
    assert classify(between, 5, 300, 1.0, settings, was_stable=True).y_e == 1
    under, over = features(variance=0.47), features(variance=0.501)
    assert classify(under, 5, 300, 1.0, settings).y_e == 1
    assert classify(over, 5, 300, 1.0, settings, was_stable=True).y_e == 0


def test_a_stable_segment_stays_so_up_to_the_thresholds_themselves() -> None:
    """At the rule's limit, with its doubt up to the hysteresis above it; not beyond the rule."""
    bare = StabilitySettings(confidence_sigmas=0.0)
    assert classify(features(variance=0.5), 5, 300, 1.0, bare, was_stable=True).y_e == 1
    wide = StabilitySettings(hysteresis=0.5)
    doubtful = features(variance=0.5, error=0.25)
    assert classify(doubtful, 5, 300, 1.0, wide, was_stable=True) == Flag(1, None)
    above = features(variance=0.51, error=0.012)
    settings = StabilitySettings()
    assert classify(above, 5, 300, 1.0, settings, was_stable=True) == Flag(None, "uncertain")


def test_a_window_covered_as_far_as_needed_is_judged() -> None:
    """The least coverage is enough."""
    assert classify(features(), 5, 300, 0.8, StabilitySettings()).y_e == 1


@given(
    st.floats(0.1, 30),
    st.floats(0, 10),
    st.floats(0, 3),
    st.floats(0, 1),
    st.floats(0, 1),
    st.booleans(),
)
def test_stable_always_means_that_the_papers_rule_holds(
    mean: float, spread: float, variance: float, error: float, spread_error: float, was: bool
) -> None:
    """Hysteresis and doubt only ever make the rule stricter."""
    seen = features(mean, spread, variance, error, spread_error)
    if classify(seen, 5, 300, 1.0, StabilitySettings(), was_stable=was).y_e == 1:
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
        (features(variance=0.4, error=0.2), 5),
    ):
        flags = judged(keeps, (CALM, 5), (THIN, 1), against, (THIN, 1))
        assert flags[:2] == [1, 1]
        assert 1 not in flags[2:]
    assert judged(keeps, (CALM, 5), (features(mean=0.71 * 30.0), 1)) == [1, 1]


def test_bare_is_the_rule_without_hysteresis_doubt_or_memory() -> None:
    """And with the thresholds as they were."""
    own = StabilitySettings(max_speed_cv=0.2, keep_s=60.0)
    bare = StabilitySettings(max_speed_cv=0.2, hysteresis=0.0, confidence_sigmas=0.0, keep_s=0.0)
    assert own.bare() == bare


def test_a_judge_remembers_that_a_segment_was_stable() -> None:
    """Between 0.95 and 1 of a threshold it stays so, and does not become so."""
    settings = StabilitySettings(confidence_sigmas=0.0)
    between = features(variance=0.49)
    assert judged(settings, (between, 5), (CALM, 5), (between, 5)) == [0, 1, 1]
    judge = StabilityJudge(settings)
    assert judge.judge("s", MINUTE, CALM, 5, 0, 1.0) == Flag(None, "no_frames")


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
