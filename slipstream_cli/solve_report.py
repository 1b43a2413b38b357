"""What `slipstream solve` prints: one report as text for people, as JSON for programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slipstream_cli.solve_missed import Missed
from slipstream_cli.solve_quantum import lines_of

if TYPE_CHECKING:
    from dispatcher_daemon.platooning.rewards import JudgedPair
    from dispatcher_daemon.roads.routes import Route, RoutedArc
    from research.instances.instance import Optimum
    from research.solving.trial import Trial


@dataclass
class Report:
    """An instance, its model, and what solvers made of it.

    Attributes:
        encoding: of the arc form; None for the route form.
        choices: number of arcs or options.
        couplings: pairs of variables with a bias.
        unserved: reason by stop that nobody can serve.
        written: model file.
        rewards: judged pairs and the arcs that they point to; None if not asked for.
        known: the published optimum of the same problem.
        rivals_kwh: objectives of simpler plans, by what made them.
        baseline: what made the plan without platooning; None if there is none.
        quantum: by solver, of those that ran a circuit; see `quantum_record`.
        missed: by solver, rewards counted for platoons that do not come about; None: there are
            none.
    """

    instance: str
    form: str
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
    rivals_kwh: Mapping[str, float]
    baseline: str | None = None
    trials: list[Trial] = field(default_factory=list)
    quantum: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    missed: dict[str, Missed | None] = field(default_factory=dict)


def as_json(report: Report) -> dict[str, Any]:
    """The whole report as plain data."""
    known = report.known
    return {
        "instance": report.instance,
        "form": report.form,
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
        "rivals_kwh": dict(report.rivals_kwh),
        "baseline": report.baseline,
        "solvers": [
            _trial_as_json(trial, report.missed.get(trial.outcome.solver))
            | report.quantum.get(trial.outcome.solver, {})
            for trial in report.trials
        ],
        "rewards": None
        if report.rewards is None
        else [_reward_as_json(pair, arcs) for pair, arcs in report.rewards],
    }


def _trial_as_json(trial: Trial, missed: Missed | None) -> dict[str, Any]:
    outcome, samples = trial.outcome, trial.outcome.samples
    return {
        "solver": outcome.solver,
        "status": outcome.status,
        "reason": outcome.reason,
        "wall_s": outcome.wall_s,
        "objective_kwh": trial.objective_kwh,
        "model_kwh": trial.model_kwh,
        "feasible": trial.is_valid,
        "faults": list(trial.faults),
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
        "energy": None if trial.energy is None else trial.energy._asdict(),
        "energy_kwh": None if trial.energy is None else trial.energy.total_kwh,
        "saving": None if trial.saving is None else trial.saving._asdict(),
        "platooned_m": trial.platooned_m,
        "missed_rewards_kwh": 0.0 if missed is None else missed.kwh,
        "routes": {route.vehicle: _route_as_json(route) for route in trial.routes},
    }


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
        f"{report.instance}: {report.form} form{encoding}: {report.choices} choices, "
        f"{report.variables} variables, {report.couplings} couplings, "
        f"gamma {report.gamma_kwh:.4g} kWh ({gamma})"
    )
    if report.known is not None:
        proven = "proven" if report.known.proven else "not proven"
        yield f"known optimum: {report.known.objective_kwh:.6f} kWh ({proven})"
    for name, value in report.rivals_kwh.items():
        yield f"{name}: {value:.6f} kWh"
    for stop, reason in report.unserved.items():
        yield f"not served: {stop}: {reason}"
    if report.written is not None:
        yield f"written: {report.written}"
    for trial in report.trials:
        yield ""
        solver = trial.outcome.solver
        yield from _trial_lines(trial, report.baseline, report.quantum.get(solver))
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
            yield f"  {pair.explain(arcs)}"


def _trial_lines(
    trial: Trial, baseline: str | None, quantum: Mapping[str, Any] | None
) -> Iterator[str]:
    outcome, samples = trial.outcome, trial.outcome.samples
    objective = "no answer"
    if outcome.selected is not None:
        value = trial.objective_kwh
        objective = "" if value is None else f"objective {value:.6f} kWh, "
        objective += "feasible" if trial.is_valid else "not feasible"
        objective += " after repair" if outcome.repaired else ""
    yield f"{outcome.solver}: {outcome.status}, {objective}, {1000 * outcome.wall_s:.1f} ms"
    if outcome.reason is not None:
        yield f"  {outcome.reason}"
    for fault in trial.faults:
        yield f"  {fault}"
    if quantum is not None:
        yield from lines_of(quantum, outcome.wall_s)
    elif samples is not None:
        yield (
            f"  samples: {samples.shots}, feasible {100 * samples.share(samples.raw):.2f} % raw, "
            f"{100 * samples.share(samples.descended):.2f} % descended, "
            f"{100 * samples.share(samples.repaired):.2f} % repaired"
        )
    if trial.energy is not None:
        e = trial.energy
        yield (
            f"  energy {e.total_kwh:.5f} kWh: rolling {e.rolling_kwh:.5f}, drag {e.drag_kwh:.5f}, "
            f"acceleration {e.acceleration_kwh:.5f}"
        )
    if trial.saving is not None and trial.energy is not None:
        s = trial.saving
        base = trial.energy.total_kwh + s.total_kwh
        share = 100 * s.total_kwh / base if base > 0 else 0.0
        yield (
            f"  saving {s.total_kwh:.5f} kWh ({share:.2f} %) against {baseline}: "
            f"distance {s.distance_kwh:.5f}, drag {s.drag_kwh:.5f}, "
            f"acceleration {s.acceleration_kwh:.5f}; {trial.platooned_m:.0f} m in platoons"
        )
    for route in trial.routes:
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
