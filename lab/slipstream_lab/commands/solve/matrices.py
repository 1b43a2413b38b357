"""`slipstream solve` on an instance with matrices instead of roads: base routes, and their cost."""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import TYPE_CHECKING, Any

from slipstream.errors import InputError

if TYPE_CHECKING:
    from slipstream_lab.research.instances.matrices import MatrixInstance, MatrixPlan

_NEED_ROADS = ("solver", "form", "objective", "write", "gamma", "explain")
_UNITS = {"distance": "m", "duration": "s", "energy": "kWh"}


def solve_matrices(options: argparse.Namespace, instance: MatrixInstance) -> int:
    """Search routes; exit status 1 if they break a rule."""
    from dispatcher_daemon.settings import SearchSettings
    from slipstream_lab.research.instances.matrices import search_matrix_instance

    for name in _NEED_ROADS:
        if getattr(options, name):
            mend = "leave it out: routes are searched by pyvrp"
            raise InputError(f"--{name}", "needs an instance with roads", mend)
    settings = SearchSettings(time_limit_s=options.deadline)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(settings.workers, spawn) as pool:
        plan = search_matrix_instance(instance, settings, pool, options.seed)
    print(
        json.dumps(_as_json(instance, plan)) if options.json else "\n".join(_lines(instance, plan))
    )
    return 1 if plan.faults else 0


def _gap(instance: MatrixInstance, plan: MatrixPlan) -> float | None:
    """By what share the cost is above the best known; None where either is no answer."""
    if plan.unserved or plan.faults:
        return None
    return instance.gap(plan.sums[instance.minimise])


def _as_json(instance: MatrixInstance, plan: MatrixPlan) -> dict[str, Any]:
    best = instance.file.best_known
    return {
        "instance": instance.name,
        "minimised": instance.minimise,
        "cost": plan.sums[instance.minimise],
        "unit": instance.unit,
        "best_known": None if best is None else best.cost,
        "best_known_comparable": best is not None and best.comparable,
        "best_known_note": "" if best is None else best.note,
        "gap": _gap(instance, plan),
        "sums": dict(plan.sums),
        "straight_m": plan.straight_m,
        "unserved": list(plan.unserved),
        "faults": list(plan.faults),
        "wall_s": plan.wall_s,
        "routes": {vehicle: list(stops) for vehicle, stops in plan.routes.items() if stops},
    }


def _lines(instance: MatrixInstance, plan: MatrixPlan) -> Iterator[str]:
    fleet, best, gap = instance.fleet, instance.file.best_known, _gap(instance, plan)
    rounding = instance.file.matrix.euclidean
    yield (
        f"{instance.name}: {len(fleet.stops)} stops, {len(fleet.vehicles)} vehicles, matrices "
        f"without roads, {instance.minimise} minimised"
    )
    driving = sum(1 for stops in plan.routes.values() if stops)
    own = f", {rounding}: the set's own cost" if rounding in ("nearest", "tenths") else ""
    yield (
        f"pyvrp: {plan.sums[instance.minimise]:.10g} {instance.unit} ({instance.minimise}{own}), "
        f"{driving} vehicles, {len(plan.unserved)} unserved, {plan.wall_s:.1f} s"
    )
    if best is not None:
        above = "not comparable"
        if gap is not None:
            above = f"{100 * abs(gap):.2f} % {'above' if gap >= 0 else 'below'} it"
        note = f"; {best.note}" if best.note else ""
        yield f"best known: {best.cost:.10g} ({best.source}), {above}{note}"
    for name, value in plan.sums.items():
        if name != instance.minimise and value > 0:
            yield f"  {name}: {value:.10g} {_UNITS[name]}"
    if own:
        yield f"  distance without rounding: {plan.straight_m:.2f} m"
    for fault in plan.faults:
        yield f"  fault: {fault}"
    if plan.unserved:
        yield f"  unserved: {', '.join(plan.unserved)}"
    for vehicle, stops in plan.routes.items():
        if stops:
            depot = fleet.depot_of(fleet.vehicle_by_id[vehicle]).id
            yield f"  {vehicle}: {' → '.join((depot, *stops, depot))}"
