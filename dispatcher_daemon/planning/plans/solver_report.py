"""One solver's part of a cycle's report."""

from __future__ import annotations

from collections.abc import Sequence

from dispatcher_daemon.solvers import Outcome
from slipstream.messages import SolverReport


def solver_report(
    outcomes: Sequence[Outcome],
    objective_kwh: float | None,
    *,
    fault: str | None = None,
    optimum_kwh: float | None = None,
    blocks: bool = False,
) -> SolverReport:
    """One report over all outcomes of a solver in a cycle.

    Shares of samples are means over the outcomes, shots and wall times are sums, depth and qubits
    maxima. The backend is the best that any outcome had: a device's answer for one block is not
    hidden by a simulator's for others.

    Args:
        fault: why an answer to the whole problem led to no plan.
        optimum_kwh: proven for the whole problem by any of the solvers.
        blocks: the outcomes are answers to parts of the problem, which prove nothing of the whole.
    """
    last = outcomes[-1]
    answered = [o for o in outcomes if o.selected is not None]
    unanswered = [o.reason for o in outcomes if o.selected is None]
    samples = [o.samples for o in outcomes if o.samples is not None]
    ran = [o.execution for o in outcomes if o.execution is not None]
    best = max(ran, key=lambda e: (e.fallback is None, e.kind == "hardware"), default=None)
    elsewhere = [e.fallback for e in ran if e.fallback is not None]
    status, reason = last.status, fault
    fallback = elsewhere[-1] if elsewhere else None
    if blocks:
        status = "feasible" if answered else last.status
        of = f"of {len(outcomes)} blocks"
        reason = (
            f"{len(unanswered)} {of} without an answer: {unanswered[-1]}" if unanswered else None
        )
        fallback = f"{len(elsewhere)} {of}: {fallback}" if elsewhere else None
    elif answered and objective_kwh is None:
        status = "failed"
    return SolverReport(
        solver=last.solver,
        status=status,
        objective_kwh=objective_kwh if answered else None,
        repaired=any(o.repaired for o in answered),
        p_feasible_raw=_mean([s.share(s.raw) for s in samples]),
        p_optimal_raw=None
        if optimum_kwh is None
        else _mean([s.share(s.raw, optimum_kwh) for s in samples]),
        p_feasible_repaired=_mean([s.share(s.repaired) for s in samples]),
        qubits=max((s.qubits for s in samples if s.qubits is not None), default=None),
        shots=sum(s.shots for s in samples) if samples else None,
        wall_s=sum(o.wall_s for o in outcomes),
        reason=reason,
        backend=None if best is None else best.backend,
        backend_kind=None if best is None else best.kind,
        fallback=fallback,
        two_qubit_depth=max(
            (e.two_qubit_depth for e in ran if e.two_qubit_depth is not None), default=None
        ),
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
