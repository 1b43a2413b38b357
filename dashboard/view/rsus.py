"""Builds the views of the roadside units; pure."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Final

from dashboard.view import labels
from dashboard.view.labels import Level
from dashboard.view.model import LIST_FOR_S, RsuView
from slipstream import freshness
from slipstream.freshness import age_s as _age_s
from slipstream.messages import RsuHealth

_STATUS: Final[dict[str, tuple[str, Level]]] = {
    "ok": ("ok", "ok"),
    "no_signal": ("no picture", "bad"),
    "ended": ("clip ended", "warn"),
}


def rsu_views(
    healths: Mapping[str, RsuHealth],
    now_ns: int,
    stale_after_s: float,
    *,
    keep: Container[str] = (),
) -> tuple[RsuView, ...]:
    """The units that were heard less than `LIST_FOR_S` ago, by name."""
    views = []
    for name, health in sorted(healths.items()):
        age_s = _age_s(health.time_ns, now_ns)
        if age_s > LIST_FOR_S and name not in keep:
            continue
        status, level = _STATUS[health.status]
        if health.fault is not None:
            status, level = labels.camera_fault(health.fault), "bad"
        fault = freshness.fault(health.time_ns, now_ns, stale_after_s=stale_after_s)
        fresh = fault is None
        if not fresh:
            status, level = ("silent" if fault == "stale" else "clock ahead"), "bad"
        seen = health.frames + health.frames_skipped
        views.append(
            RsuView(
                rsu=name,
                status=status,
                level=level,
                fps=health.fps if fresh else None,
                latency_ms=health.latency_ms_p50 if fresh else None,
                skipped_share=health.frames_skipped / seen if seen else 0.0,
                age_s=age_s,
                health=health,
            )
        )
    return tuple(views)
