"""The benchmark's report: what was measured beside what was aimed at."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Final

from benchmarks.aims import Check, check_table
from benchmarks.routing.figures import (
    CityRun,
    Gap,
    InstanceRow,
    Spread,
    log_slope,
    medians_by_size,
    relative,
    saved_share,
    spread,
)

EXACT: Final = "exact"
MOST_EXACT_S: Final = 0.1
PAPER_EXACT_S: Final = 0.400
MOST_CYCLE_S: Final = 30.0
MOST_PEAK_MB: Final = 2000.0
MOST_ABOVE_BEST: Final = 0.01
MOST_SLOPE: Final = 1.3
_SAME_KWH: Final = 1e-6


@dataclass(frozen=True)
class Results:
    """All that was measured.

    Attributes:
        instances: the named instances.
        city: repeats of one city's cycle.
        best: runs of the same city with much more time.
        fixed: cycles by fleet size on one network.
        growing: cycles by fleet size on a network that grows with it.
        rivals: one cycle of each of several cities.
        gaps: small cities whose undivided optimum can be computed.
        missing: why something was not measured.
    """

    instances: tuple[InstanceRow, ...] = ()
    city: tuple[CityRun, ...] = ()
    best: tuple[CityRun, ...] = ()
    fixed: tuple[CityRun, ...] = ()
    growing: tuple[CityRun, ...] = ()
    rivals: tuple[CityRun, ...] = ()
    gaps: tuple[Gap, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def best_known_kwh(self) -> float:
        """Least objective that any run of the city has found."""
        return min(run.objective_kwh for run in (*self.city, *self.best))


def checks(results: Results) -> list[Check]:
    """Each aim with what was measured."""
    return [
        *_instance_checks(results.instances),
        *_city_checks(results),
        *_slope_checks(results),
        *_rival_checks(results.rivals),
        *_gap_checks(results.gaps),
    ]


def _instance_checks(rows: Sequence[InstanceRow]) -> list[Check]:
    if not rows:
        return []
    times = [median(row.answers[EXACT].wall_s) for row in rows]
    exact = [row for row in rows if _hits(row, EXACT) and row.answers[EXACT].optimal]
    return [
        Check(
            f"exact answer to {len(rows)} named instances, median, s "
            f"(the paper's CPLEX: {PAPER_EXACT_S:.3f} s)",
            f"{median(times):.4f} ({min(times):.4f} to {max(times):.4f})",
            f"≤ {MOST_EXACT_S:g}",
            median(times) <= MOST_EXACT_S,
        ),
        Check(
            "of them answered with the published optimum, proven",
            f"{len(exact)} of {len(rows)}",
            "all",
            len(exact) == len(rows),
        ),
    ]


def _city_checks(results: Results) -> list[Check]:
    if not results.city:
        return []
    runs = results.city
    wall, peak = max(r.wall_s for r in runs), max(r.peak_mb for r in runs)
    found = [
        Check(
            f"whole cycle: {_size(runs[0])}; s, worst of {len(runs)}",
            f"{wall:.1f}",
            f"≤ {MOST_CYCLE_S:g}",
            wall <= MOST_CYCLE_S,
        ),
        Check(
            "its peak memory, all processes, MB",
            f"{peak:.0f}",
            f"≤ {MOST_PEAK_MB:g}",
            peak <= MOST_PEAK_MB,
        ),
    ]
    if results.best:
        above = max(relative(r.objective_kwh, results.best_known_kwh) for r in runs)
        longest = max(r.wall_s for r in results.best)
        found.append(
            Check(
                f"its objective above the best known (longest run: {longest:.0f} s), worst",
                percent(above),
                f"≤ {100 * MOST_ABOVE_BEST:g} %",
                above <= MOST_ABOVE_BEST,
            )
        )
    return found


def _slope_checks(results: Results) -> list[Check]:
    found = []
    for runs, what in ((results.fixed, "fixed"), (results.growing, "growing with the fleet")):
        times = medians_by_size(runs)
        if len(times) < 2:
            continue
        slope = log_slope(*zip(*times, strict=True))
        found.append(
            Check(
                f"log-log slope of time, {times[0][0]} to {times[-1][0]} vehicles, network {what}",
                f"{slope:.2f}",
                f"≤ {MOST_SLOPE:g}",
                slope <= MOST_SLOPE,
            )
        )
    return found


def _rival_checks(runs: Sequence[CityRun]) -> list[Check]:
    if not runs:
        return []
    base = spread([saved_share(r.objective_kwh, r.base_kwh) for r in runs])
    greedy = spread([saved_share(r.objective_kwh, r.greedy_kwh) for r in runs])
    worse = sum(r.objective_kwh > min(r.base_kwh, r.base_met_kwh) + _SAME_KWH for r in runs)
    return [
        Check(
            f"objective below the VRP without platooning, {len(runs)} cities, mean",
            _shown(base),
            "> 0 %",
            base.mean > 0,
        ),
        Check(
            "cities in which it is above it, chance meetings counted", f"{worse}", "0", worse == 0
        ),
        Check(
            "objective below route-then-schedule greedy, mean",
            _shown(greedy),
            "> 0 %",
            greedy.mean > 0,
        ),
    ]


def _shown(shares: Spread) -> str:
    return f"{percent(shares.mean)} ({percent(shares.least)} to {percent(shares.most)})"


def _gap_checks(gaps: Sequence[Gap]) -> list[Check]:
    proven = [gap.share for gap in gaps if gap.proven]
    if not gaps:
        return []
    if not proven:
        return [Check("blocks above the undivided optimum", "none proven", "known", None)]
    found, gained = spread(proven), fmean(gap.gained for gap in gaps if gap.proven)
    return [
        Check(
            f"blocks above the undivided optimum, {len(proven)} of {len(gaps)} proven, mean",
            f"{percent(found.mean, 3)} (worst {percent(found.most, 3)}); "
            f"{percent(gained, 1)} of its gain",
            "known",
            True,
        )
    ]


def markdown(results: Results, about: Mapping[str, object]) -> str:
    """The report as people read it."""
    lines = ["# Routing core: how good, how fast", ""]
    lines += [f"- {name}: {value}" for name, value in about.items()]
    lines += [f"- **not measured:** {why}" for why in results.missing]
    lines += ["", *check_table(checks(results))]
    if results.instances:
        lines += ["", "## Named instances", "", *_instance_table(results.instances)]
    if results.city:
        lines += ["", "## A city", "", *_city_table(results)]
    if results.fixed or results.growing:
        lines += ["", "## Time against fleet size", "", *_scaling_table(results)]
    if results.rivals:
        lines += ["", "## Against the rivals", "", *_rival_tables(results.rivals)]
    if results.gaps:
        lines += ["", "## Blocks against the undivided optimum", "", *_gap_table(results.gaps)]
    return "\n".join(lines) + "\n"


def _instance_table(rows: Sequence[InstanceRow]) -> list[str]:
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
        hits = sum(_hits(row, name) for row in rows)
        lines.append(
            f"| {name} | {median(times):.4f} | {max(times):.4f} | {hits} of {len(rows)} "
            f"| {shown} | {len(rows) - len(gaps)} |"
        )
    return lines


def _hits(row: InstanceRow, solver: str) -> bool:
    found = row.answers[solver].objective_kwh
    return found is not None and abs(found - row.optimum_kwh) <= _SAME_KWH


def _city_table(results: Results) -> list[str]:
    best = results.best_known_kwh
    lines = [
        f"{_size(results.city[0])}. Best known: {best:.4f} kWh.",
        "",
        "| given, s | seed | took, s | processor, s | peak, MB | objective, kWh | above best "
        "| cost | saving | without platooning | greedy | blocks | sweeps | unserved "
        "| stages, s |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|",
    ]
    lines += [
        f"| {r.budget_s:g} | {r.solver_seed} | {r.wall_s:.1f} | {r.cpu_s:.1f} | {r.peak_mb:.0f} "
        f"| {r.objective_kwh:.4f} | {percent(relative(r.objective_kwh, best))} "
        f"| {r.cost_kwh:.4f} | {r.saving_kwh:.4f} | {r.base_kwh:.4f} | {r.greedy_kwh:.4f} "
        f"| {r.blocks} | {r.sweeps} | {r.unserved} | {_stages(r)} |"
        for r in (*results.city, *results.best)
    ]
    return lines


def _stages(run: CityRun) -> str:
    text = ", ".join(f"{name} {seconds:.1f}" for name, seconds in run.stages_s.items())
    return f"{text}; ended by time" if run.timed_out else text


def _scaling_table(results: Results) -> list[str]:
    lines = [
        "| network | vehicles | stops | segments | s, median | s, min to max | peak, MB "
        "| objective below no platooning |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for series, name in ((results.fixed, "fixed"), (results.growing, "growing")):
        for vehicles, seconds in medians_by_size(series):
            runs = [r for r in series if r.vehicles == vehicles]
            times = [r.wall_s for r in runs]
            saved = median(saved_share(r.objective_kwh, r.base_kwh) for r in runs)
            lines.append(
                f"| {name} | {vehicles} | {runs[0].stops} | {runs[0].segments} | {seconds:.2f} "
                f"| {min(times):.2f} to {max(times):.2f} | {max(r.peak_mb for r in runs):.0f} "
                f"| {percent(saved)} |"
            )
    return lines


def _rival_tables(runs: Sequence[CityRun]) -> list[str]:
    rivals = {
        "the VRP without platooning": [r.base_kwh for r in runs],
        "the same, chance meetings counted": [r.base_met_kwh for r in runs],
        "route-then-schedule": [r.greedy_kwh for r in runs],
    }
    lines = [
        f"{len(runs)} cities: {_size(runs[0])}.",
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
        "Physical energy saved on the VRP without platooning, in % of its energy; expected stops "
        "at signals and junctions are no part of it and stand beside it.",
        "",
        "| seed | objective, kWh | without platooning | chance meetings counted | greedy | took, s "
        "| energy without, kWh | saved | distance | drag | acceleration "
        "| expected stops | time on the road |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for r in runs:
        parts = (r.saved_distance_kwh, r.saved_drag_kwh, r.saved_acceleration_kwh)
        shares = [p / r.base_driven_kwh for p in (sum(parts), *parts, r.saved_stops_kwh)]
        lines.append(
            f"| {r.seed} | {r.objective_kwh:.4f} | {r.base_kwh:.4f} | {r.base_met_kwh:.4f} "
            f"| {r.greedy_kwh:.4f} | {r.wall_s:.1f} | {r.base_driven_kwh:.3f} | "
            + " | ".join(percent(share) for share in shares)
            + f" | {100 * relative(r.driving_h, r.base_driving_h):+.2f} % |"
        )
    return lines


def _gap_table(gaps: Sequence[Gap]) -> list[str]:
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


def _size(run: CityRun) -> str:
    return f"{run.vehicles} vehicles, {run.stops} stops, {run.segments} segments"


def write(folder: Path, results: Results, about: Mapping[str, object]) -> None:
    """Write report.md and report.json into an existing folder."""
    (folder / "report.md").write_text(markdown(results, about))
    content = {"about": dict(about), "checks": [asdict(c) for c in checks(results)]}
    content |= asdict(results)
    (folder / "report.json").write_text(json.dumps(content, indent=1, default=str) + "\n")
