"""A stored cycle in words: why each vehicle goes where it goes, and why not otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from slipstream.explain.facts import InsertedStop, RefusedPlatoon, facts_of
from slipstream.explain.vehicles import VehicleExplanation, explained_vehicles
from slipstream.explain.words import (
    duration,
    in_kwh,
    insertion_lines,
    more_or_less,
    refusal_line,
)
from slipstream.messages import CycleReport, SolverReport, VehiclePlan


@dataclass(frozen=True)
class RefusedExplanation:
    """A refused platoon with its line in words."""

    line: str
    platoon: RefusedPlatoon


@dataclass(frozen=True)
class InsertedExplanation:
    """A stop that was to be put into a tour, with lines in words: where it went, and why not into
    each of the other tours.
    """

    lines: tuple[str, ...]
    inserted: InsertedStop

    def of_vehicle(self, vehicle: str) -> InsertedExplanation:
        """What concerns one vehicle: its tour, and the one that was taken."""
        wanted = {vehicle, self.inserted.vehicle}
        tours = tuple(tour for tour in self.inserted.tours if tour.vehicle in wanted)
        return inserted_explanation(replace(self.inserted, tours=tours))


def inserted_explanation(one: InsertedStop) -> InsertedExplanation:
    """A stop that was to be put into a tour, in words."""
    return InsertedExplanation(tuple(insertion_lines(one)), one)


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
        inserted: stops that were to be put into tours between cycles, in turn.
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
    inserted: tuple[InsertedExplanation, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Vehicles that it tells of."""
        offered = (tour.vehicle for one in self.inserted for tour in one.inserted.tours)
        return tuple(dict.fromkeys([*(one.vehicle for one in self.vehicles), *offered]))

    def of_vehicle(self, vehicle: str) -> Explanation | None:
        """What concerns one vehicle; None: the cycle has no such vehicle."""
        own = tuple(one for one in self.vehicles if one.vehicle == vehicle)
        if vehicle not in self.names:
            return None
        inserted = tuple(one.of_vehicle(vehicle) for one in self.inserted)
        refused = tuple(one for one in self.refused if vehicle in one.platoon.vehicles)
        known = self.cycle, self.started_ns, self.status, self.summary, self.solvers
        return Explanation(*known, own, refused, self.unserved, self.notes, inserted)


def explanation(
    report: CycleReport, plans: Sequence[VehiclePlan], record: bytes | None
) -> Explanation:
    """A stored cycle in words.

    Args:
        record: see `facts_of`; None: it is not stored, or not any more.

    Raises:
        ValueError: what was stored of it cannot be read by this version.
    """
    facts = None if record is None else facts_of(record)
    notes = []
    if facts is None and report.status != "failed" and report.solver is not None:
        what = "figures of vehicles and refused platoons"
        if report.solver == "insertion":
            what = "other tours that its orders could have been put into"
        notes.append(f"{what} are not stored of this cycle, or not any more")
    return Explanation(
        report.cycle,
        report.started_ns,
        report.status,
        tuple(_summary(report)),
        tuple(_solver_line(solver, report.solver) for solver in report.solvers),
        tuple(explained_vehicles(plans, facts)),
        ()
        if facts is None
        else tuple(RefusedExplanation(refusal_line(one), one) for one in facts.refused),
        tuple(f"{stop.stop}: {stop.reason}" for stop in report.unserved),
        tuple(notes),
        () if facts is None else tuple(map(inserted_explanation, facts.inserted)),
    )


def as_text(of: Explanation) -> str:
    """An explanation in lines for people."""
    return "\n".join(_text(of))


def _text(of: Explanation) -> Iterator[str]:
    yield from of.summary
    blocks: list[tuple[str, Sequence[str]]] = [("solvers", of.solvers)]
    blocks += [(f"order {one.inserted.stop}", one.lines) for one in of.inserted]
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
    if report.solver == "insertion" and report.objective_kwh is not None:
        yield (
            "between cycles; all other stops stay in their tours and in their order; the changed "
            f"tours cost {in_kwh(report.objective_kwh)}, time at its price"
        )
    elif report.solver is not None and report.objective_kwh is not None:
        yield f"the plan is that of {report.solver}: objective {in_kwh(report.objective_kwh)}"
    energy = report.energy
    if energy is not None:
        yield (
            f"the fleet needs {in_kwh(energy.cooperative_kwh)}, "
            f"{more_or_less(-energy.saved_kwh)} than the baseline ({energy.baseline}): "
            f"distance {in_kwh(energy.saved_distance_kwh)}, "
            f"drag {in_kwh(energy.saved_drag_kwh)}, acceleration "
            f"{in_kwh(energy.saved_acceleration_kwh)} saved"
        )
        if energy.baseline_driving_s is not None and energy.cooperative_driving_s is not None:
            yield (
                f"it drives for {duration(energy.cooperative_driving_s)}, in the baseline for "
                f"{duration(energy.baseline_driving_s)}; {energy.platooned_distance_m:.0f} m of "
                "the way in platoons"
            )
    for carrier in report.carriers:
        name = "vehicles without a carrier" if carrier.carrier is None else carrier.carrier
        yield f"{name}: {in_kwh(carrier.saved_cost_kwh)} less than alone, time at its price"


def _solver_line(solver: SolverReport, chosen: str | None) -> str:
    parts: list[str] = [solver.status]
    if solver.objective_kwh is not None:
        parts.append(f"objective {in_kwh(solver.objective_kwh)}")
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
