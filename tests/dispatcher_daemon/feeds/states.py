"""States of the demo's segments, and any that a message may hold."""

from __future__ import annotations

from typing import get_args

from hypothesis import strategies as st

from slipstream.messages import (
    CAMERA_FAULTS,
    Estimate,
    KinematicFeatures,
    RsuHealth,
    SegmentState,
)
from slipstream.messages.roadside import UnknownReason

NOW_NS = 1_800_000_000_123_456_789
SECOND_NS = 10**9


def features(speed_mps: float = 12.5, gap_m: float | None = 22.5) -> KinematicFeatures:
    """Calm traffic."""
    return KinematicFeatures(
        mean_speed_mps=Estimate(value=speed_mps, standard_error=0.25),
        mean_acceleration_mps2=Estimate(value=0.01, standard_error=0.02),
        density_veh_per_m=Estimate(value=0.02, standard_error=0.001),
        speed_std_mps=Estimate(value=1.0, standard_error=0.1),
        acceleration_variance_m2ps4=Estimate(value=0.1, standard_error=0.01),
        mean_gap_m=None if gap_m is None else Estimate(value=gap_m, standard_error=0.5),
    )


def state(
    segment: str = "avenue_east",
    y_e: int | None = 1,
    reason: str | None = None,
    *,
    rsu: str = "rsu-1",
    age_s: float = 1.0,
    measured: KinematicFeatures | None = None,
) -> SegmentState:
    """One RSU's state of a segment, of nine vehicles."""
    return SegmentState.model_validate(
        {
            "rsu": rsu,
            "segment": segment,
            "sequence": 7,
            "time_ns": NOW_NS - round(age_s * SECOND_NS),
            "window_s": 10.0,
            "features": measured,
            "y_e": y_e,
            "reason": reason,
            "vehicles": 9,
            "frames": 300,
            "coverage": 1.0,
        }
    )


def health(rsu: str = "rsu-1", *, age_s: float = 0.5, **changed: object) -> RsuHealth:
    """The health of an RSU whose camera works, unless told otherwise."""
    return RsuHealth.model_validate(
        {
            "rsu": rsu,
            "time_ns": NOW_NS - round(age_s * SECOND_NS),
            "started_ns": 0,
            "source": "clip",
            "segments": ("avenue_east",),
            "status": "ok",
            "frames": 1,
            "frames_skipped": 0,
            "decode_errors": 0,
            "reconnects": 0,
            "states": 1,
            "fps": 25.0,
            "latency_ms_p50": None,
            "latency_ms_p95": None,
            "vehicles_in_view": 0,
            "rss_mb": 1.0,
            **changed,
        }
    )


_NAMES = st.text(min_size=1, max_size=8)
_REASONS = tuple(
    {*CAMERA_FAULTS, *(reason for part in get_args(UnknownReason) for reason in get_args(part))}
)


def _estimates(low: float = -1e6) -> st.SearchStrategy[Estimate]:
    return st.builds(
        Estimate,
        value=st.floats(low, 1e6) | st.floats(allow_nan=False, allow_infinity=False),
        standard_error=st.none() | st.floats(0, 1e5),
    )


_FEATURES = st.builds(
    KinematicFeatures,
    mean_speed_mps=_estimates(-5) | st.builds(Estimate, value=st.floats(-3, 20)),
    mean_acceleration_mps2=st.builds(Estimate, value=st.floats(-20, 20)),
    density_veh_per_m=st.builds(
        Estimate, value=st.floats(0, 2), standard_error=st.none() | st.floats(0, 10)
    ),
    speed_std_mps=st.builds(Estimate, value=st.floats(0, 50), standard_error=st.floats(0, 10)),
    acceleration_variance_m2ps4=st.builds(Estimate, value=st.floats(0, 400)),
    mean_gap_m=st.none() | st.builds(Estimate, value=st.floats(-5, 5000)),
)


@st.composite
def any_state(draw: st.DrawFn, segments: tuple[str, ...]) -> SegmentState:
    """Whatever a SegmentState may hold; its segment may be one of these."""
    y_e = draw(st.sampled_from((0, 1, None)))
    measured = draw(_FEATURES if y_e == 0 else st.none() | _FEATURES)
    sound = measured is not None or y_e is None
    return SegmentState(
        rsu=draw(_NAMES),
        segment=draw(st.sampled_from(segments) | _NAMES),
        sequence=draw(st.integers(0, 2**63 - 1)),
        time_ns=draw(
            st.integers(NOW_NS - 10 * SECOND_NS, NOW_NS + 2 * SECOND_NS) | st.integers(0, 2**63 - 1)
        ),
        window_s=draw(st.floats(0.1, 60.0) | st.floats(1e-9, 1e300)),
        features=measured,
        y_e=y_e,
        reason=draw(st.sampled_from(_REASONS)) if y_e is None else None,
        vehicles=draw(st.integers(0, 50) | st.integers(0, 2**63 - 1)) if sound else 0,
        frames=draw(st.integers(1, 300) | st.integers(0, 2**63 - 1)),
        coverage=draw(st.floats(0, 1)),
    )
