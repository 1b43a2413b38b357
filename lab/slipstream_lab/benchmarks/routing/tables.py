"""The tables of the report, in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean, median

from slipstream_lab.benchmarks.routing.figures import (
    CityRun,
    Gap,
    InstanceRow,
    relative,
    saved_share,
    spread,
)


def instance_table(rows: Sequence[InstanceRow]) -> list[str]:
    """Each solver over all named instances."""
    lines = [
        f"{len(rows)} instances of {_range(r.variables for r in rows)} variables; times are "
        "medians of repeats, objectives those of the worst repeat.",
        "",
        "| solver | s, median | max | optimum found | above it, mean | worst | no valid answer |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name in rows[0].answers:
        answers = [row.answers[name] for row in rows]
        times = [median(a.wall_s) for a in answers]
        gaps = [
            relative(a.objective_kwh, row.optimum_kwh)
            for row, a in zip(rows, answers, strict=True)
            if a.objective_kwh is not None
        ]
        shown = f"{percent(fmean(gaps))} | {percent(max(gaps))}" if gaps else "– | –"
        hits = sum(row.solved(name) for row in rows)
        lines.append(
            f"| {name} | {median(times):.4f} | {max(times):.4f} | {hits} of {len(rows)} "
            f"| {shown} | {len(rows) - len(gaps)} |"
        )
    return lines


def city_table(
    city: Sequence[CityRun], best: Sequence[CityRun], best_known_kwh: float
) -> list[str]:
    """Repeats of one city, and the long runs."""
    lines = [
        f"{size(city[0])}. Best known: {best_known_kwh:.4f} kWh.",
        "",
        "| given, s | seed | took, s | processor, s | peak, MB | objective, kWh | above best "
        "| cost | saving | without platooning | greedy | blocks | sweeps | unserved "
        "| stages, s |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|",
    ]
    lines += [
        f"| {r.budget_s:g} | {r.solver_seed} | {r.wall_s:.1f} | {r.cpu_s:.1f} | {r.peak_mb:.0f} "
        f"| {r.objective_kwh:.4f} | {percent(relative(r.objective_kwh, best_known_kwh))} "
        f"| {r.cost_kwh:.4f} | {r.saving_kwh:.4f} | {r.base_kwh:.4f} | {r.greedy_kwh:.4f} "
        f"| {r.blocks} | {r.sweeps} | {r.unserved} | {_stages(r)} |"
        for r in (*city, *best)
    ]
    return lines


def _stages(run: CityRun) -> str:
    text = ", ".join(f"{name} {seconds:.1f}" for name, seconds in run.stages_s.items())
    return f"{text}; ended by time" if run.timed_out else text


def scaling_table(runs: Sequence[CityRun]) -> list[str]:
    """Time, memory and quality by fleet size."""
    return [
        "Searches end by what they have done, not by the clock.",
        "",
        "| vehicles | stops | segments | s | ended by time | peak, MB | objective below no "
        "platooning |",
        "|--:|--:|--:|--:|--:|--:|--:|",
        *(
            f"| {r.vehicles} | {r.stops} | {r.segments} | {r.wall_s:.2f} "
            f"| {'yes' if r.timed_out else 'no'} | {r.peak_mb:.0f} "
            f"| {percent(saved_share(r.objective_kwh, r.base_kwh))} |"
            for r in runs
        ),
    ]


def rival_tables(runs: Sequence[CityRun]) -> list[str]:
    """Objectives against the rivals, and where physical energy is saved."""
    rivals = {
        "the VRP without platooning": [r.base_kwh for r in runs],
        "the same, chance meetings counted": [r.base_met_kwh for r in runs],
        "route-then-schedule": [r.greedy_kwh for r in runs],
    }
    if all(r.rival_kwh is not None for r in runs):
        name = f"PyVRP's own search without platooning, {runs[0].rival_cpu_s:g} CPU s"
        rivals[name] = [r.rival_kwh for r in runs if r.rival_kwh is not None]
    lines = [
        f"{len(runs)} cities: {size(runs[0])}.",
        "",
        "| objective below | mean | min | median | max |",
        "|---|--:|--:|--:|--:|",
    ]
    for name, objectives in rivals.items():
        shares = [
            saved_share(run.objective_kwh, rival)
            for run, rival in zip(runs, objectives, strict=True)
        ]
        s = spread(shares)
        lines.append(
            f"| {name} | {percent(s.mean)} | {percent(s.least)} | {percent(s.median)} "
            f"| {percent(s.most)} |"
        )
    lines += [
        "",
        "Physical energy saved on the VRP without platooning, in % of its energy. Acceleration has "
        "expected stops at signals and junctions in it; they stand beside it too, counted from "
        "planning speeds.",
        "",
        "| seed | objective, kWh | without platooning | chance meetings counted | greedy "
        "| PyVRP's own | took, s "
        "| energy without, kWh | saved | distance | drag | acceleration "
        "| expected stops | time on the road |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for r in runs:
        parts = (r.saved_distance_kwh, r.saved_drag_kwh, r.saved_acceleration_kwh)
        shares = [p / r.base_driven_kwh for p in (sum(parts), *parts, r.saved_stops_kwh)]
        lines.append(
            f"| {r.seed} | {r.objective_kwh:.4f} | {r.base_kwh:.4f} | {r.base_met_kwh:.4f} "
            f"| {r.greedy_kwh:.4f} | {'–' if r.rival_kwh is None else f'{r.rival_kwh:.4f}'} "
            f"| {r.wall_s:.1f} | {r.base_driven_kwh:.3f} | "
            + " | ".join(percent(share) for share in shares)
            + f" | {100 * relative(r.driving_h, r.base_driving_h):+.2f} % |"
        )
    return lines


def gap_table(gaps: Sequence[Gap]) -> list[str]:
    """Blocks beside the undivided optimum."""
    lines = [
        "| seed | vehicles | variables | blocks | before the sweeps, kWh | after | undivided "
        "| above it | of its gain | proven | undivided solve, s |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|--:|",
    ]
    lines += [
        f"| {g.seed} | {g.vehicles} | {g.variables} | {g.blocks} | {g.start_kwh:.4f} "
        f"| {g.sweep_kwh:.4f} | {g.optimum_kwh:.4f} | {percent(g.share, 3)} "
        f"| {percent(g.gained, 1)} | {'yes' if g.proven else 'no'} | {g.exact_s:.1f} |"
        for g in gaps
    ]
    return lines


def _range(values: Iterable[int]) -> str:
    found = sorted(values)
    least, most = found[0], found[-1]
    return f"{least}" if least == most else f"{least} to {most}"


def percent(share: float, digits: int = 2) -> str:
    """A share in %; what rounds to nothing has no sign."""
    return f"{round(100 * share, digits) + 0.0:.{digits}f} %"


def size(run: CityRun) -> str:
    """How large a city is, in words."""
    return f"{run.vehicles} vehicles, {run.stops} stops, {run.segments} segments"
