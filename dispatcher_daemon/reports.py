"""Reports of cycles that made no plan."""

from __future__ import annotations

from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.messages import CycleReport


def idle_report(
    cycle: int, started_ns: int, wall_s: float, snapshot: TrafficSnapshot
) -> CycleReport:
    """The report of a cycle that had nothing to dispatch."""
    return failed_report(cycle, started_ns, wall_s, "no open order, or no free vehicle").model_copy(
        update={"status": "ok", "gates": snapshot.gates()}
    )


def failed_report(cycle: int, started_ns: int, wall_s: float, reason: str) -> CycleReport:
    """The report of a failed cycle."""
    return CycleReport(
        cycle=cycle,
        started_ns=started_ns,
        wall_s=wall_s,
        status="failed",
        reason=reason,
        solver=None,
        objective_kwh=None,
        variables=0,
        solvers=(),
        gates=(),
        energy=None,
        plans=0,
    )


def error_text(error: Exception) -> str:
    """An exception in one line of at most 500 characters."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:500]
