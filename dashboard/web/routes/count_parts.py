"""The part of a road's card that tells of counted vehicles; pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from dashboard.view import labels
from dashboard.web.routes.vehicle_parts import Part
from dashboard.web.tables.rows import Known, ms
from slipstream import freshness
from slipstream.messages import MIN_WATCHED_S, Estimate, SegmentCounts

RUNNING_FRESH_S: Final = 180.0
"""As `freshness.COUNTS_FRESH_S`, of a quarter hour that runs; it is told each minute."""
_KMH: Final = 3.6


def counts(road: str, known: Known, stored: Sequence[SegmentCounts]) -> Part | None:
    """What was counted on a road in the last quarter hour, or until now in the one that runs where
    no other is fresh; None: nothing was told of it.

    Args:
        stored: complete ones, which tell of a past moment.
    """
    snapshot = known.snapshot
    complete = [*stored, *(one for (name, _), one in snapshot.counts.items() if name == road)]
    running = [one for (name, _), one in snapshot.running_counts.items() if name == road]
    best = _best(complete, known.now_ns, freshness.COUNTS_FRESH_S)
    if best is None or best.flow_vph(best.vehicles) is None:
        best = _best(running, known.now_ns, RUNNING_FRESH_S) or best
    return None if best is None else _told(best)


def _best(told: Iterable[SegmentCounts], now_ns: int, fresh_s: float) -> SegmentCounts | None:
    """The latest that is fresh; of several units that which watched for longest."""
    fresh = [
        one
        for one in told
        if freshness.age_s(one.until_ns, now_ns) <= fresh_s
        and not freshness.is_ahead(one.until_ns, now_ns)
    ]
    return max(fresh, key=lambda one: (one.began_ns, one.watched_s, one.rsu), default=None)


def _told(told: SegmentCounts) -> Part:
    flow = told.flow_vph(told.vehicles)
    why = None if told.reason is None else labels.reason(told.reason)
    if flow is None and why is None:
        why = f"watched for less than {MIN_WATCHED_S:.0f} s until now"
    return {
        "begin": ms(told.began_ns),
        "end": ms(told.until_ns),
        "complete": told.complete,
        "watched_share": round(min(1.0, told.watched_s / told.elapsed_s), 3),
        "why": why,
        "flows": []
        if flow is None
        else [
            _flow("all", told, told.vehicles),
            *(_flow(one.vehicle_class, told, one.vehicles) for one in told.classes),
        ],
        "kmh": _speed(told.mean_speed_mps),
        "v85_kmh": _speed(told.v85_mps),
    }


def _flow(name: str, told: SegmentCounts, vehicles: Estimate) -> Part:
    flow = told.flow_vph(vehicles)
    assert flow is not None
    error = flow.standard_error
    return {
        "kind": name,
        "vehicles": round(vehicles.value),
        "vph": round(flow.value, 1),
        "standard_error": None if error is None else round(error, 1),
    }


def _speed(speed: Estimate | None) -> Part | None:
    if speed is None:
        return None
    error = speed.standard_error
    return {
        "value": round(_KMH * speed.value, 1),
        "standard_error": None if error is None else round(_KMH * error, 2),
    }
