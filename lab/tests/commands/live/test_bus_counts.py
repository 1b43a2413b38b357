"""The figures of a run."""

from __future__ import annotations

from slipstream.messages import RsuHealth, SegmentState, rsu_health_key, state_key
from slipstream_lab.commands.live.bus_counts import BusCounts


def health(frames: int, started_ns: int) -> bytes:
    """Health of one run of an RSU."""
    return RsuHealth(
        rsu="r",
        time_ns=1,
        started_ns=started_ns,
        source="clip",
        segments=("s",),
        status="ok",
        frames=frames,
        frames_skipped=0,
        decode_errors=0,
        reconnects=0,
        states=0,
        fps=30.0,
        latency_ms_p50=None,
        latency_ms_p95=None,
        vehicles_in_view=0,
        rss_mb=1.0,
    ).to_bytes()


def test_frames_of_runs_before_a_restart_still_count() -> None:
    """Each run of an RSU counts from its own start."""
    counts = BusCounts()
    for frames, started_ns in ((10, 1), (20, 1), (5, 2), (7, 2)):
        counts.take(rsu_health_key("r"), health(frames, started_ns))
    assert counts.summary()["frames"] == 27


def test_states_are_counted_by_flag_and_noise_is_survived() -> None:
    """A message that is none changes nothing."""
    counts = BusCounts()
    state = SegmentState(
        rsu="r",
        segment="s",
        sequence=1,
        time_ns=1,
        window_s=10.0,
        features=None,
        y_e=None,
        reason="no_frames",
        vehicles=0,
        frames=0,
        coverage=0.0,
    )
    counts.take(state_key("r", "s"), state.to_bytes())
    counts.take(state_key("r", "s"), b"noise")
    summary = counts.summary()
    assert summary["segment_states"] == 1
    assert summary["y_e"] == {"s": {"unknown": 1}}
    assert summary["energy_kwh"] == {"baseline": None, "cooperative": None}
