"""Reports of cycles that made no plan, and of RSUs that are badly received."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final

from dispatcher_daemon.planning.plans import Candidate
from dispatcher_daemon.traffic import Reception, TrafficSnapshot
from slipstream.messages import CycleReport, RsuReception, Unserved

_MAX_REPORTED: Final = 20


def idle_report(
    cycle: int,
    started_ns: int,
    wall_s: float,
    snapshot: TrafficSnapshot,
    waiting: Mapping[str, str],
) -> CycleReport:
    """The report of a cycle that had nothing to dispatch."""
    reason = "no open order, or no free vehicle"
    if waiting:
        reason = f"nothing is planned, and {waits(waiting)}"
    return failed_report(cycle, started_ns, wall_s, reason[:500]).model_copy(
        update={"status": "ok", "gates": snapshot.gates()}
    )


def waits(orders: Mapping[str, str]) -> str:
    """Orders without a vehicle, as many as there are of each reason."""
    kinds = [f"{n} as {why}" for why, n in Counter(orders.values()).most_common()]
    count = "1 order waits" if len(orders) == 1 else f"{len(orders)} orders wait"
    return f"{count}: {'; '.join(kinds)}"


def insertion_report(
    cycle: int,
    started_ns: int,
    wall_s: float,
    snapshot: TrafficSnapshot,
    found: Candidate,
    missing: Mapping[str, str],
) -> CycleReport:
    """The report of orders that were put into plans between cycles; it has no energy figures, as
    the fleet's other plans are not part of it.
    """
    return failed_report(cycle, started_ns, wall_s, "new orders put into tours").model_copy(
        update={
            "status": "ok",
            "gates": snapshot.gates(),
            "solver": found.solver,
            "objective_kwh": found.objective_kwh,
            "plans": len(found.plans),
            "unserved": tuple(Unserved(stop=s, reason=r) for s, r in missing.items()),
        }
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


def worst_receptions(receptions: Iterable[tuple[str, Reception]]) -> tuple[RsuReception, ...]:
    """The 20 RSUs with the most states missed, then with the clock furthest off."""
    worst = heapq.nlargest(
        _MAX_REPORTED, receptions, key=lambda found: (found[1].missed, abs(found[1].delay_s or 0.0))
    )
    return tuple(RsuReception(rsu=rsu, **found._asdict()) for rsu, found in worst)
