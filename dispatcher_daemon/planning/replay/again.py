"""A stored cycle made again, and what came out otherwise."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

from dispatcher_daemon.fleet.tracking import HIDDEN, IDLE
from dispatcher_daemon.planning.cycle.cycle import run_cycle
from dispatcher_daemon.planning.replay.inputs import (
    CycleRecord,
    cycle_record,
    restored_cycle,
    versions,
)
from dispatcher_daemon.planning.replay.parts import PlanOf
from dispatcher_daemon.planning.replay.trace import Player
from dispatcher_daemon.planning.route_form import NO_VEHICLE
from dispatcher_daemon.planning.routes import insert_stops
from dispatcher_daemon.solvers.workers import Solve
from slipstream.messages import CycleReport, Unserved, VehiclePlan
from storage import StoredCycle

_COMPARED = ("status", "solver", "objective_kwh", "energy", "carriers", "unserved", "variables")
"""Fields of reports that a cycle made again must have; the others are times and their effects."""


@dataclass(frozen=True)
class Replayed:
    """A cycle that was made again.

    Attributes:
        vehicles: number of plans that were compared.
        differences: in words; none: the plans are the same.
        notes: in words, what the comparison rests on.
    """

    cycle: int
    vehicles: int
    differences: tuple[str, ...]
    notes: tuple[str, ...]


def replayed(stored: StoredCycle, plan_of: PlanOf, solve: Solve, executor: Executor) -> Replayed:
    """Make a stored cycle, or a stored insertion between cycles, again and compare.

    Args:
        solve: with the solvers of the stored settings, without hard deadlines.

    Raises:
        ValueError: its inputs are not stored or cannot be read by this version, or a plan is gone.
    """
    if stored.inputs is None:
        raise ValueError("its inputs are not stored")
    record = cycle_record(stored.inputs)
    player = Player(record.trace, solve, executor)
    cycle = restored_cycle(stored, plan_of)
    # What was kept back from the cycle is in its report only.
    stops = cycle.problem.fleet.stop_by_id
    planned = tuple(
        one.model_copy(update={"reason": _planned_reason(one.reason)})
        for one in stored.report.unserved
        if one.stop in stops and one.reason != HIDDEN
    )
    before = stored.report.model_copy(update={"unserved": planned})
    plans: tuple[VehiclePlan, ...] = ()
    if record.wanted is None:
        result = run_cycle(cycle, player.solve, player.executor, player.clock)
        after, plans = result.report, result.plans
    else:
        inserted = insert_stops(cycle, cycle.start or {}, record.wanted)
        missing = tuple(Unserved(stop=s, reason=r) for s, r in inserted.missing.items())
        changes: dict[str, object] = {"unserved": missing, "objective_kwh": None, "solver": None}
        if inserted.found is not None:
            plans, found = inserted.found.plans, inserted.found
            changes |= {"objective_kwh": found.objective_kwh, "solver": found.solver}
        after = before.model_copy(update=changes)
    differences = [
        *_report_differences(before, after),
        *_plan_differences(stored.plans, plans, record.made),
    ]
    return Replayed(
        stored.report.cycle, len(stored.plans), tuple(differences), tuple(_notes(record, player))
    )


def _planned_reason(reason: str) -> str:
    """Of a stop without a vehicle, as planning says it, which knows the cycle's fleet alone."""
    return NO_VEHICLE if reason.startswith(NO_VEHICLE) else reason.partition(IDLE)[0]


def _notes(record: CycleRecord, player: Player) -> Iterator[str]:
    trace, now = record.trace, versions()
    for name in sorted({*record.versions, *now}):
        before, after = record.versions.get(name, "none"), now.get(name, "none")
        if before != after:
            yield f"made by {name} {before}, now {after}: the plan may differ"
    if trace.cut:
        yield (
            f"{trace.cut} of {len(trace.searches)} searches were ended by time; they were repeated "
            "with their recorded numbers of iterations"
        )
    if trace.kept:
        yield (
            f"{trace.kept} of {len(trace.answers)} answers of solvers may have been ended by time, "
            "or came from a device: they were taken as recorded"
        )
    for solver, number in sorted(player.differing.items()):
        yield f"{solver} gave {number} other answers than it was recorded with"


def _report_differences(before: CycleReport, after: CycleReport) -> Iterator[str]:
    for name in _COMPARED:
        old, new = getattr(before, name), getattr(after, name)
        if old != new:
            yield f"{name}: {old} before, {new} now"


def _plan_differences(
    before: tuple[VehiclePlan, ...], after: tuple[VehiclePlan, ...], made: tuple[str, ...]
) -> Iterator[str]:
    old, new = ({plan.vehicle: plan for plan in plans} for plans in (before, after))
    for vehicle in sorted({*old, *made, *new}):
        if vehicle not in new:
            yield f"{vehicle}: has no plan now"
        elif vehicle not in made:
            yield f"{vehicle}: had no plan"
        elif vehicle in old and old[vehicle] != new[vehicle]:
            yield f"{vehicle}: {_difference(old[vehicle], new[vehicle])}"


def _difference(before: VehiclePlan, after: VehiclePlan) -> str:
    stops = [[stop.stop for stop in plan.stops] for plan in (before, after)]
    if stops[0] != stops[1]:
        return f"stops {' → '.join(stops[0])} before, {' → '.join(stops[1])} now"
    ways = [[planned.segment for planned in plan.segments] for plan in (before, after)]
    if ways[0] != ways[1]:
        return "the same stops by another way"
    moved_s = 1e-9 * (after.depart_ns - before.depart_ns)
    if moved_s:
        return f"the same way, leaving {abs(moved_s):.3f} s {'later' if moved_s > 0 else 'earlier'}"
    platoons = [[(s.platoon, s.place) for s in plan.segments] for plan in (before, after)]
    if platoons[0] != platoons[1]:
        return "the same way in other platoons"
    names = [n for n in VehiclePlan.model_fields if getattr(before, n) != getattr(after, n)]
    return f"the same way and platoons, other {', '.join(names)}"
