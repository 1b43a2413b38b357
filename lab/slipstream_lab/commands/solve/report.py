"""What `slipstream solve` prints: one report as text for people, as JSON for programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slipstream_lab.commands.solve.missed import Missed
from slipstream_lab.commands.solve.quantum import lines_of

if TYPE_CHECKING:
    from dispatcher_daemon.forms import Problem
    from dispatcher_daemon.planning.plans import Candidate
    from dispatcher_daemon.planning.platooning import JudgedPair
    from dispatcher_daemon.planning.roads import Route, RoutedArc
    from slipstream.energy.consumption import Saving
    from slipstream_lab.research.instances.forms import Attempt
    from slipstream_lab.research.instances.instance import Optimum


@dataclass
class Report:
    """An instance, its model, and the solvers' results.

    Attributes:
        encoding: of the arc form; None for the route form.
        rewards: judged pairs and the arcs that they point to; None if not asked for.
        baseline_name: of the plan without platooning; None if there is none.
        quantum: by solver, of those that ran a circuit; see `run_record`.
        missed: by solver, rewards counted for platoons that do not form; None: there are
            none.
    """

    instance: str
    form: str
    minimises: str
    encoding: str | None
    choices: int
    variables: int
    couplings: int
    gamma_kwh: float
    gamma_computed: bool
    unserved: Mapping[str, str]
    written: Path | None
    rewards: Sequence[tuple[JudgedPair, Sequence[RoutedArc]]] | None
    known: Optimum | None
    references_kwh: Mapping[str, float]
    problem: Problem
    baseline_name: str | None = None
    baseline: Candidate | None = None
    attempts: list[Attempt] = field(default_factory=list)

    def saving(self, plan: Candidate) -> Saving | None:
        """Saving of a plan against the baseline, the plan without platooning."""
        from slipstream.energy.consumption import split_saving

        if self.baseline is None:
            return None
        return split_saving(self.baseline.undrafted, plan.undrafted, plan.driven)

    def minimised_kwh(self, tried: Attempt) -> float | None:
        """The objective: what the solver minimised, of an answer that became plans.

        What the plan costs, re-evaluated at its exact times, differs from it: in the route form by
        a constant, and by what pairs miss of platoons of three and more; in the arc form by
        departures that were chosen afterwards, and platoons that do not come about.
        """
        selected = tried.outcome.selected
        if selected is None or tried.candidate is None:
            return None
        return self.problem.objective_kwh(selected)

    quantum: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    missed: dict[str, Missed | None] = field(default_factory=dict)


def as_json(report: Report) -> dict[str, Any]:
    """The whole report as plain data."""
    known = report.known
    return {
        "instance": report.instance,
        "form": report.form,
        "minimises": report.minimises,
        "encoding": report.encoding,
        "choices": report.choices,
        "variables": report.variables,
        "couplings": report.couplings,
        "gamma_kwh": report.gamma_kwh,
        "gamma": "bound" if report.gamma_computed else "given",
        "unserved": dict(report.unserved),
        "written": None if report.written is None else str(report.written),
        "known_optimum_kwh": None if known is None else known.objective_kwh,
        "known_optimum_proven": known is not None and known.proven,
        "rivals_kwh": dict(report.references_kwh),
        "baseline": report.baseline_name,
        "solvers": [
            _attempt_as_json(report, tried) | report.quantum.get(tried.outcome.solver, {})
            for tried in report.attempts
        ],
        "rewards": None
        if report.rewards is None
        else [_reward_as_json(pair, arcs) for pair, arcs in report.rewards],
    }


def _attempt_as_json(report: Report, tried: Attempt) -> dict[str, Any]:
    outcome, samples, plan = tried.outcome, tried.outcome.samples, tried.candidate
    missed = report.missed.get(outcome.solver)
    saving = None if plan is None else report.saving(plan)
    return {
        "solver": outcome.solver,
        "status": outcome.status,
        "reason": outcome.reason,
        "wall_s": outcome.wall_s,
        "objective_kwh": report.minimised_kwh(tried),
        "plan_kwh": None if plan is None else plan.objective_kwh,
        "feasible": plan is not None,
        "faults": list(_faults(tried)),
        "repaired": outcome.repaired,
        "samples": None
        if samples is None
        else {
            "count": samples.shots,
            "qubits": samples.qubits,
            "feasible_raw": samples.share(samples.raw),
            "feasible_descended": samples.share(samples.descended),
            "feasible_repaired": samples.share(samples.repaired),
        },
        "energy": None if plan is None else plan.driven._asdict(),
        "energy_kwh": None if plan is None else plan.driven.total_kwh,
        "saving": None if saving is None else saving._asdict(),
        "platooned_m": 0.0 if plan is None else plan.platooned_m,
        "missed_rewards_kwh": 0.0 if missed is None else missed.kwh,
        "routes": {r.vehicle: _route_as_json(r) for r in plan.routes} if plan is not None else {},
    }


def _faults(tried: Attempt) -> tuple[str, ...]:
    """Rules that an answer breaks."""
    return () if tried.outcome.selected is None else tried.faults


def _route_as_json(route: Route) -> dict[str, Any]:
    return {
        "stops": [visit.place for visit in route.visits[1:-1]],
        "depart_s": route.visits[0].departure_s,
        "return_s": route.visits[-1].arrival_s,
        "arrivals_s": [visit.arrival_s for visit in route.visits[1:-1]],
        "segments": [segment for leg in route.legs for segment in leg.path],
    }


def _reward_as_json(pair: JudgedPair, arcs: Sequence[RoutedArc]) -> dict[str, Any]:
    def side(index: int, entry_s: float) -> dict[str, Any]:
        arc = arcs[index]
        return {
            "vehicle": arc.vehicle,
            "from": arc.leg.start,
            "to": arc.leg.end,
            "entry_s": entry_s,
            "exact": arc.exact,
        }

    return {
        "segment": pair.segment,
        "first": side(pair.first, pair.first_entry_s),
        "second": side(pair.second, pair.second_entry_s),
        "saving_kwh": pair.saving_kwh,
        "reason": pair.reason,
    }


def as_text(report: Report) -> str:
    """The report in lines."""
    return "\n".join(_lines(report))


def _lines(report: Report) -> Iterator[str]:
    encoding = "" if report.encoding is None else f", {report.encoding} encoding"
    gamma = "computed" if report.gamma_computed else "given"
    yield (
        f"{report.instance}: {report.form} form{encoding}, objective {report.minimises}: "
        f"{report.choices} choices, "
        f"{report.variables} variables, {report.couplings} couplings, "
        f"gamma {report.gamma_kwh:.4g} kWh ({gamma})"
    )
    if report.known is not None:
        proven = "proven" if report.known.proven else "not proven"
        yield f"known optimum: {report.known.objective_kwh:.6f} kWh ({proven})"
    for name, value in report.references_kwh.items():
        yield f"{name}: plan {value:.6f} kWh"
    for stop, reason in report.unserved.items():
        yield f"not served: {stop}: {reason}"
    if report.written is not None:
        yield f"written: {report.written}"
    for tried in report.attempts:
        yield ""
        solver = tried.outcome.solver
        yield from _attempt_lines(report, tried)
        missed = report.missed.get(solver)
        if missed is not None:
            yield f"  {missed.line()}"
    if report.rewards is not None:
        earned = sum(pair.saving_kwh > 0 for pair, _ in report.rewards)
        yield ""
        yield (
            f"rewards: {earned} of {len(report.rewards)} pairs on watched segments earn something"
        )
        for pair, arcs in report.rewards:
            yield f"  {explained(pair, arcs)}"


def explained(pair: JudgedPair, arcs: Sequence[RoutedArc]) -> str:
    """A reward, or why there is none, in a line."""
    who = " and ".join(
        f"{arc.vehicle} ({arc.leg.start}→{arc.leg.end}, enters at {entry_s:.1f} s"
        f"{'' if arc.exact else ' at the earliest'})"
        for arc, entry_s in (
            (arcs[pair.first], pair.first_entry_s),
            (arcs[pair.second], pair.second_entry_s),
        )
    )
    what = f"saves {pair.saving_kwh:.5f} kWh" if pair.reason is None else f"0: {pair.reason}"
    return f"{pair.segment}: {who}: {what}"


def _attempt_lines(report: Report, tried: Attempt) -> Iterator[str]:
    outcome, samples, plan = tried.outcome, tried.outcome.samples, tried.candidate
    quantum = report.quantum.get(outcome.solver)
    objective = "no answer"
    if outcome.selected is not None:
        objective = "not feasible"
        if plan is not None:
            objective = f"objective {report.minimised_kwh(tried):.6f} kWh, feasible"
        objective += " after repair" if outcome.repaired else ""
    yield f"{outcome.solver}: {outcome.status}, {objective}, {1000 * outcome.wall_s:.1f} ms"
    if outcome.reason is not None:
        yield f"  {outcome.reason}"
    for fault in _faults(tried):
        yield f"  {fault}"
    if quantum is not None:
        yield from lines_of(quantum, outcome.wall_s)
    elif samples is not None:
        yield (
            f"  samples: {samples.shots}, feasible {100 * samples.share(samples.raw):.2f} % raw, "
            f"{100 * samples.share(samples.descended):.2f} % descended, "
            f"{100 * samples.share(samples.repaired):.2f} % repaired"
        )
    if plan is None:
        return
    e = plan.driven
    yield f"  plan {plan.objective_kwh:.6f} kWh: what is minimised, at the plan's exact times"
    yield (
        f"  energy {e.total_kwh:.5f} kWh: rolling {e.rolling_kwh:.5f}, drag {e.drag_kwh:.5f}, "
        f"acceleration {e.acceleration_kwh:.5f}"
    )
    s = report.saving(plan)
    if s is not None:
        base = e.total_kwh + s.total_kwh
        share = 100 * s.total_kwh / base if base > 0 else 0.0
        yield (
            f"  saving {s.total_kwh:.5f} kWh ({share:.2f} %) against {report.baseline_name}: "
            f"distance {s.distance_kwh:.5f}, drag {s.drag_kwh:.5f}, "
            f"acceleration {s.acceleration_kwh:.5f}; {plan.platooned_m:.0f} m in platoons"
        )
    for route in plan.routes:
        stops = " → ".join(f"{visit.place} ({visit.arrival_s:.0f} s)" for visit in route.visits[1:])
        start = route.visits[0]
        yield f"  {route.vehicle}: {start.place} ({start.departure_s:.0f} s) → {stops}"


def list_as_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """The published instances as a table."""
    lines = [
        f"{'name':<20} {'vehicles':>8} {'stops':>5} {'arcs':>4} {'variables':>9} {'best, kWh':>12}"
    ]
    for row in rows:
        optimum = "" if row["optimum_kwh"] is None else f"{row['optimum_kwh']:.6f}"
        lines.append(
            f"{row['name']:<20} {row['vehicles']:>8} {row['stops']:>5} {row['choices']:>4} "
            f"{row['variables']:>9} {optimum:>12}"
        )
    return "\n".join(lines)
