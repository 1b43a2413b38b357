"""States of the demo's segments, and any that a message may hold."""

from __future__ import annotations

from typing import get_args

from hypothesis import strategies as st

from slipstream.messages import (
    CAMERA_FAULTS,
    ClassCount,
    Estimate,
    KinematicFeatures,
    RsuHealth,
    SegmentCounts,
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
    return SegmentState(
        rsu=rsu,
        segment=segment,
        sequence=7,
        time_ns=NOW_NS - round(age_s * SECOND_NS),
        window_s=10.0,
        features=measured,
        y_e=y_e,
        reason=reason,
        vehicles=9,
        frames=300,
        coverage=1.0,
    )


def counts(
    segment: str = "avenue_east",
    *,
    rsu: str = "rsu-1",
    quarters_ago: int = 0,
    watched_s: float = 600.0,
) -> SegmentCounts:
    """What an RSU counted in the last complete quarter hour, or in one before it."""
    quarter_ns = 900 * SECOND_NS
    until_ns = NOW_NS // quarter_ns * quarter_ns - quarters_ago * quarter_ns
    of_classes = (("car", 100.0), ("truck", 16.0), ("bus", 4.0), ("motorcycle", 0.0))
    return SegmentCounts(
        rsu=rsu,
        segment=segment,
        began_ns=until_ns - quarter_ns,
        until_ns=until_ns,
        complete=True,
        watched_s=watched_s,
        reason="dark",
        vehicles=Estimate(value=120.0, standard_error=3.0),
        classes=tuple(
            ClassCount(vehicle_class=name, vehicles=Estimate(value=value, standard_error=2.0))
            for name, value in of_classes
        ),
        mean_speed_mps=Estimate(value=12.0, standard_error=0.12),
        v85_mps=Estimate(value=14.0, standard_error=0.21),
        speeds=118,
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
_LIMITS = {
    "mean_speed_mps": (-3.0, 25.0),
    "mean_acceleration_mps2": (-20.0, 20.0),
    "density_veh_per_m": (0.0, 2.0),
    "speed_std_mps": (0.0, 50.0),
    "acceleration_variance_m2ps4": (0.0, 400.0),
    "mean_gap_m": (-5.0, 5000.0),
}
_NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
_COUNTS = st.integers(0, 2**63 - 1)


def _features(wild: bool) -> st.SearchStrategy[KinematicFeatures]:
    def estimates(low: float, high: float) -> st.SearchStrategy[Estimate]:
        errors = st.floats(0, allow_infinity=False) if wild else st.floats(0, 1e4)
        values = _NUMBERS if wild else st.floats(low, high)
        return st.builds(Estimate, value=values, standard_error=st.none() | errors)

    parts = {name: estimates(*limits) for name, limits in _LIMITS.items()}
    return st.builds(KinematicFeatures, **{**parts, "mean_gap_m": st.none() | parts["mean_gap_m"]})


@st.composite
def any_state(draw: st.DrawFn, segments: tuple[str, ...]) -> SegmentState:
    """Whatever a SegmentState may hold, or one that the dispatcher admits on these segments."""
    wild = draw(st.booleans())
    y_e = draw(st.sampled_from((0, 1, None)))
    measured = draw(_features(wild) if y_e == 0 else st.none() | _features(wild))
    some = measured is not None or y_e is None
    age_ns = st.integers(-(10**9), 5 * 10**9)
    return SegmentState(
        rsu=draw(_NAMES),
        segment=draw(st.sampled_from(segments) | _NAMES if wild else st.sampled_from(segments)),
        sequence=draw(_COUNTS),
        time_ns=draw(_COUNTS) if wild else NOW_NS - draw(age_ns),
        window_s=draw(st.floats(1e-9, 1e300) if wild else st.floats(0.1, 60.0)),
        features=measured,
        y_e=y_e,
        reason=draw(st.sampled_from(_REASONS)) if y_e is None else None,
        vehicles=draw(_COUNTS if wild else st.integers(0, 50)) if some else 0,
        frames=draw(_COUNTS if wild else st.integers(1, 300)),
        coverage=draw(st.floats(0, 1)),
    )
