"""What the dispatcher's cycles save and what is wrong with them, and the state of its quantum
device; pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from statistics import median
from typing import Final

from dashboard.live import Snapshot
from dashboard.view import labels
from dashboard.view.labels import Level
from slipstream import freshness
from slipstream.freshness import age_s
from slipstream.messages import CycleReport, DispatcherHealth, HardwareHealth

SILENT_AFTER_S: Final = 4.0
"""A dispatcher without health for longer is silent, s; it sends one each second."""
OVERDUE_AFTER_INTERVALS: Final = 3.0
"""Intervals without a successful cycle after which cycles count as overdue."""
DEFAULT_INTERVAL_S: Final = 30.0
"""The dispatcher's default interval, s; used where too few cycles are known."""


def cycle_problem(snapshot: Snapshot, health: DispatcherHealth, now_ns: int) -> str | None:
    """Why a dispatcher with recent health counts as faulty, without an age; None if it does not."""
    since_ns = _good_since_ns(snapshot, health, now_ns)
    if since_ns is None:
        return "The last cycle failed"
    if not since_ns:
        return "No good cycle yet"
    if age_s(since_ns, now_ns) > OVERDUE_AFTER_INTERVALS * _interval_s(snapshot.cycles):
        return "Cycles are overdue: none was good of late"
    return None


def energy_status(cycles: Sequence[CycleReport], now_ns: int) -> str | None:
    """What the last cycle that had a vehicle to plan saves, with its age; None: none is known."""
    for report in reversed(cycles):
        energy = report.energy
        if energy is not None and energy.baseline_kwh > 0:
            off = labels.duration(age_s(report.started_ns, now_ns))
            verb = "saves" if energy.saved_kwh >= 0 else "costs"
            share = abs(energy.saved_kwh) / energy.baseline_kwh
            return (
                f"Cycle {report.cycle}, {off} ago: {energy.cooperative_kwh:.2f} kWh {verb} "
                f"{abs(energy.saved_kwh):.2f} kWh ({share:.1%}) against {energy.baseline}"
            )
    return None


def _good_since_ns(snapshot: Snapshot, health: DispatcherHealth, now_ns: int) -> int | None:
    """UTC of the last good cycle, or of the start; 0: none is known; None: the last one failed."""
    last = snapshot.cycles[-1] if snapshot.cycles else None
    # Reports dated ahead are from before the clock was set back.
    good_ns = max(
        (
            report.started_ns
            for report in snapshot.cycles
            if report.status != "failed" and not freshness.is_ahead(report.started_ns, now_ns)
        ),
        default=0,
    )
    failed_ns = snapshot.cycle_failed_ns or 0
    counted = failed_ns > good_ns and not freshness.is_ahead(failed_ns, now_ns)
    if counted or (last is not None and last.status == "failed"):
        return None
    # The time before the dispatcher's start does not count.
    started_ns = 0 if freshness.is_ahead(health.started_ns, now_ns) else health.started_ns
    return max(good_ns, started_ns)


def _interval_s(cycles: Sequence[CycleReport]) -> float:
    """Median interval between the starts of the last cycles, s."""
    steps = [
        age_s(a.started_ns, b.started_ns)
        for a, b in pairwise(cycles[-6:])
        if b.cycle == a.cycle + 1 and b.started_ns > a.started_ns
    ]
    return median(steps) if steps else DEFAULT_INTERVAL_S


def hardware_status(health: HardwareHealth) -> tuple[str, Level]:
    """Jobs, budget and circuit breaker of the quantum device in a line, and its level.

    The breaker is named only if it is not closed; a noise model is named as one.
    """
    service, _, model = health.backend.partition(":")
    device = f"Quantum device {health.backend}"
    if service == "fake" and model:
        device = f"Noise model of {model}, no device"
    parts = [
        f"{device}: {labels.plural(health.pending, 'job')} pending",
        f"{health.used_s:.1f} of {health.budget_s:g} s used in the last day",
    ]
    if health.breaker != "closed":
        parts.append(f"breaker {health.breaker}")
    if health.line is not None:
        parts.append(f"no new jobs: {health.line}")
    return " · ".join(parts), "ok" if health.line is None else "warn"
