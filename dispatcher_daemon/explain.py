"""A stored cycle in words: why each vehicle goes where it goes, and why not otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from dispatcher_daemon.planning import RefusedPlatoon
from dispatcher_daemon.plans import VehicleAccount
from dispatcher_daemon.replay import CycleRecord, cycle_record
from slipstream.messages import CycleReport, PlannedSegment, SolverReport, VehiclePlan
from storage import StoredCycle


@dataclass(frozen=True)
class VehicleExplanation:
    """One vehicle of a cycle.

    Attributes:
        vehicle: its id.
        lines: in words.
        account: its figures; None: they are not stored, or not any more.
    """

    vehicle: str
    lines: tuple[str, ...]
    account: VehicleAccount | None


@dataclass(frozen=True)
class RefusedExplanation:
    """A refused platoon with its line in words."""

    line: str
    platoon: RefusedPlatoon


@dataclass(frozen=True)
class Explanation:
    """A cycle in words, with the figures behind them.

    Attributes:
        cycle: its number.
        started_ns: UTC.
        status: of its report.
        summary: of the whole cycle.
        solvers: a line each.
        vehicles: in the order of the fleet.
        refused: most worth first.
        unserved: a line for each stop that no vehicle serves.
        notes: what could not be explained.
    """

    cycle: int
    started_ns: int
    status: str
    summary: tuple[str, ...]
    solvers: tuple[str, ...]
    vehicles: tuple[VehicleExplanation, ...]
    refused: tuple[RefusedExplanation, ...]
    unserved: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def of_vehicle(self, vehicle: str) -> Explanation | None:
        """What concerns one vehicle; None: the cycle has no such vehicle."""
        own = tuple(one for one in self.vehicles if one.vehicle == vehicle)
        if not own:
            return None
        refused = tuple(one for one in self.refused if vehicle in one.platoon.vehicles)
        known = self.cycle, self.started_ns, self.status, self.summary, self.solvers
        return Explanation(*known, own, refused, self.unserved, self.notes)


def explanation(stored: StoredCycle) -> Explanation:
    """A stored cycle in words.

    Raises:
        ValueError: what was stored of it cannot be read by this version.
    """
    report = stored.report
    record = None if stored.inputs is None else cycle_record(stored.inputs)
    notes = []
    if record is None and report.status != "failed" and report.solver is not None:
        notes.append(
            "figures of vehicles and refused platoons are not stored of this cycle, or not any more"
        )
    return Explanation(
        report.cycle,
        report.started_ns,
        report.status,
        tuple(_summary(report)),
        tuple(_solver_line(solver, report.solver) for solver in report.solvers),
        tuple(_vehicles(stored.plans, record)),
        ()
        if record is None
        else tuple(RefusedExplanation(refusal_line(one), one) for one in record.refused),
        tuple(f"{stop.stop}: {stop.reason}" for stop in report.unserved),
        tuple(notes),
    )


def as_text(of: Explanation) -> str:
    """An explanation in lines for people."""
    return "\n".join(_text(of))


def _text(of: Explanation) -> Iterator[str]:
    yield from of.summary
    blocks: list[tuple[str, Sequence[str]]] = [("solvers", of.solvers)]
    blocks += [(one.vehicle, one.lines) for one in of.vehicles]
    blocks += [("refused platoons", [one.line for one in of.refused])]
    blocks += [("not served", of.unserved), ("not known", of.notes)]
    for title, lines in blocks:
        if lines:
            yield ""
            yield f"{title}:"
            yield from (f"  {line}" for line in lines)


def _summary(report: CycleReport) -> Iterator[str]:
    yield f"cycle {report.cycle}: {report.status}" + (f", {report.reason}" if report.reason else "")
    if report.solver is not None and report.objective_kwh is not None:
        yield f"the plan is that of {report.solver}: objective {_kwh(report.objective_kwh)}"
    energy = report.energy
    if energy is not None:
        saved = energy.baseline_kwh - energy.cooperative_kwh
        yield (
            f"the fleet needs {_kwh(energy.cooperative_kwh)}, {_more_or_less(-saved)} than the "
            f"baseline ({energy.baseline}): distance {_kwh(energy.saved_distance_kwh)}, drag "
            f"{_kwh(energy.saved_drag_kwh)}, acceleration "
            f"{_kwh(energy.saved_acceleration_kwh)} saved"
        )
        if energy.baseline_driving_s is not None and energy.cooperative_driving_s is not None:
            yield (
                f"it drives for {_time(energy.cooperative_driving_s)}, in the baseline for "
                f"{_time(energy.baseline_driving_s)}; {energy.platooned_distance_m:.0f} m of the "
                "way in platoons"
            )
    for carrier in report.carriers:
        name = "vehicles without a carrier" if carrier.carrier is None else carrier.carrier
        yield f"{name}: {_kwh(carrier.saved_cost_kwh)} less than alone, time at its price"


def _solver_line(solver: SolverReport, chosen: str | None) -> str:
    parts: list[str] = [solver.status]
    if solver.objective_kwh is not None:
        parts.append(f"objective {_kwh(solver.objective_kwh)}")
    if solver.repaired:
        parts.append("valid after repair only")
    if solver.p_feasible_raw is not None:
        parts.append(f"{100 * solver.p_feasible_raw:.2f} % of its samples valid as drawn")
    if solver.backend is not None:
        parts.append(f"on {solver.backend}")
    if solver.fallback is not None:
        parts.append(f"not on the device asked for: {solver.fallback}")
    parts.append(f"{solver.wall_s:.2f} s")
    if solver.reason is not None:
        parts.append(solver.reason)
    return f"{solver.solver}{' (taken)' if solver.solver == chosen else ''}: {', '.join(parts)}"


def _vehicles(
    plans: Sequence[VehiclePlan], record: CycleRecord | None
) -> Iterator[VehicleExplanation]:
    plan_of = {plan.vehicle: plan for plan in plans}
    accounts = {} if record is None else {one.vehicle: one for one in record.accounts}
    made = () if record is None else record.made
    served_before = {stop: v for v, one in accounts.items() for stop in one.baseline_stops}
    served = {stop: v for v, one in accounts.items() for stop in one.stops}
    for vehicle in dict.fromkeys([*accounts, *plan_of]):
        account, plan = accounts.get(vehicle), plan_of.get(vehicle)
        lines: list[str] = []
        if account is not None:
            lines += _stop_lines(account, served, served_before)
            lines += _figure_lines(account)
        elif plan is not None:
            stops = [stop.stop for stop in plan.stops[1:-1]]
            lines.append(f"serves {', '.join(stops) or 'no stop'}, {_kwh(plan.energy_kwh)}")
        if plan is not None:
            lines += _platoon_lines(plan, plans)
        elif account is not None and account.driven_kwh > 0:
            lines.append(
                "its new plan was not sent, as it reported something else meanwhile"
                if vehicle in made
                else "its plan says what the one says that it has, so none was sent"
            )
        yield VehicleExplanation(vehicle, tuple(lines), account)


def _stop_lines(
    account: VehicleAccount, served: dict[str, str], served_before: dict[str, str]
) -> Iterator[str]:
    if not account.stops and account.driven_kwh == 0:
        if account.baseline_stops:
            others = ", ".join(f"{s} ({served.get(s, 'nobody')})" for s in account.baseline_stops)
            yield f"stays where it is; in the baseline it serves what others do now: {others}"
        else:
            yield "stays where it is, in the baseline too: others serve all stops at less cost"
        return
    line = f"serves {', '.join(account.stops) or 'no stop, it drives home'}"
    if account.stops == account.baseline_stops:
        yield f"{line}, as in the baseline"
        return
    if set(account.stops) == set(account.baseline_stops):
        yield f"{line}; in the baseline in the order {', '.join(account.baseline_stops)}"
        return
    yield line
    taken = [s for s in account.stops if s not in account.baseline_stops]
    given = [s for s in account.baseline_stops if s not in account.stops]
    if taken:
        names = ", ".join(f"{s} (from {served_before.get(s, 'nobody')})" for s in taken)
        yield f"more than in the baseline: {names}"
    if given:
        names = ", ".join(f"{s} (to {served.get(s, 'nobody')})" for s in given)
        yield f"less than in the baseline: {names}"


def _figure_lines(account: VehicleAccount) -> Iterator[str]:
    if account.driven_kwh == 0:
        return
    drafting = account.alone_kwh - account.driven_kwh
    line = f"needs {_kwh(account.driven_kwh)}"
    if drafting > 1e-9:
        line += (
            f", alone on the same way {_kwh(account.alone_kwh)}: platoons save {_kwh(drafting)} "
            f"over {account.platooned_m:.0f} m"
        )
    else:
        line += ", as much as alone: it is in no platoon that saves anything"
    yield line
    if account.baseline_kwh > 0:
        change = account.driven_kwh - account.baseline_kwh
        yield (
            f"that is {_more_or_less(change)} than in the baseline; it drives for "
            f"{_time(account.driving_s)}, there for {_time(account.baseline_driving_s)}"
        )
    else:
        yield f"it drives for {_time(account.driving_s)}; in the baseline it stays where it is"
    if account.waiting_s >= 0.05:
        yield f"it waits {account.waiting_s:.1f} s longer than in the baseline, to meet others"


def _platoon_lines(plan: VehiclePlan, plans: Sequence[VehiclePlan]) -> Iterator[str]:
    members: dict[tuple[str | None, str], list[tuple[int, str]]] = {}
    for one in plans:
        for segment in one.segments:
            if segment.place is not None:
                key = segment.platoon, segment.segment
                members.setdefault(key, []).append((segment.place, one.vehicle))

    def key_of(segment: PlannedSegment) -> tuple[str | None, int | None, tuple[str, ...]]:
        found = sorted(members.get((segment.platoon, segment.segment), ()))
        return segment.platoon, segment.place, tuple(v for _, v in found if v != plan.vehicle)

    for (platoon, place, others), group in groupby(plan.segments, key_of):
        if platoon is None:
            continue
        way = list(group)
        length_m = sum(segment.length_m or 0.0 for segment in way)
        who = " and ".join(others) or "a vehicle that has its plan already"
        where = "leads" if place == 0 else f"is at place {(place or 0) + 1} with"
        yield (
            f"{where} {who} in platoon {platoon} on {_way([s.segment for s in way])}"
            + (f", {length_m:.0f} m" if length_m else "")
        )


def refusal_line(one: RefusedPlatoon) -> str:
    """Why there is no platoon, in words."""
    first, second = one.vehicles
    on = f"{first} and {second} on {_way(one.segments)}"
    if one.reason == "turbulent":
        return f"{on}: traffic there was turbulent; {_kwh(one.saving_kwh)} if it had been stable"
    if one.reason == "unknown":
        why = (one.detail or "no reason given").replace("_", " ")
        return f"{on}: the traffic there was not known ({why}); {_kwh(one.saving_kwh)} if stable"
    if one.reason == "apart" and one.detail is not None:
        return f"{on}: there together, but {one.detail}; {_kwh(one.saving_kwh)}"
    if one.reason == "apart":
        return (
            f"{on}: not together in time, {one.apart_s:.1f} s apart, and their windows and plans "
            f"allow neither to wait; {_kwh(one.saving_kwh)}"
        )
    change = f"to meet would cost {_kwh(one.cost_kwh or 0.0)} and save {_kwh(one.saving_kwh)}"
    if one.saving_kwh < 0:
        change += ", as platoons with others would be lost"
    apart = one.detail or f"{one.apart_s:.1f} s apart"
    if one.reason == "not_worth":
        return f"{on}: not worth it, {apart}: {change}"
    return (
        f"{on}: missed, {apart}: {change}, but no solver came to it, or it would leave a carrier "
        "with less than alone"
    )


def _way(segments: Sequence[str]) -> str:
    if len(segments) <= 3:
        return ", ".join(segments)
    return f"{segments[0]} … {segments[-1]} ({len(segments)} segments)"


def _kwh(value: float) -> str:
    return f"{round(value, 4) + 0.0:.4f} kWh"


def _more_or_less(change_kwh: float) -> str:
    if abs(change_kwh) < 5e-5:
        return "no more and no less"
    return f"{_kwh(abs(change_kwh))} {'more' if change_kwh > 0 else 'less'}"


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
