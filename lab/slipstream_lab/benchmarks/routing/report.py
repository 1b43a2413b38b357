"""The benchmark's report: what was measured beside what was aimed at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Final

from slipstream_lab.benchmarks.aims import Check, at_most, report_head, write_report
from slipstream_lab.benchmarks.routing.figures import (
    SAME_KWH,
    CityRun,
    Gap,
    InstanceRow,
    RivalSpread,
    log_slope,
    medians_by_size,
    relative,
    saved_share,
    spread,
)
from slipstream_lab.benchmarks.routing.tables import (
    city_table,
    gap_table,
    instance_table,
    percent,
    rival_tables,
    scaling_table,
    size,
)

EXACT: Final = "exact"
MAX_EXACT_S: Final = 0.1
PAPER_EXACT_S: Final = 0.400
MAX_CYCLE_S: Final = 30.0
MAX_PEAK_MB: Final = 2000.0
MAX_ABOVE_BEST: Final = 0.01
MAX_SLOPE: Final = 1.3
MIN_LARGE_SWEEPS: Final = 3
MAX_OVERRUN: Final = 0.1
MAX_BASE_ABOVE_RIVAL: Final = 0.005
"""Of base routes, against PyVRP's own search with more time."""


@dataclass(frozen=True)
class RoutingResults:
    """All that was measured."""

    instances: tuple[InstanceRow, ...] = ()
    city: tuple[CityRun, ...] = ()
    best: tuple[CityRun, ...] = ()
    large: tuple[CityRun, ...] = ()
    fixed: tuple[CityRun, ...] = ()
    rivals: tuple[CityRun, ...] = ()
    gaps: tuple[Gap, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def best_known_kwh(self) -> float:
        """Least objective that any run of the city has found."""
        return min(run.objective_kwh for run in (*self.city, *self.best))


def checks(results: RoutingResults) -> list[Check]:
    """Each aim with what was measured."""
    return [
        *_instance_checks(results.instances),
        *_city_checks(results),
        *_large_checks(results.large),
        *_slope_checks(results.fixed),
        *_rival_checks(results.rivals),
        *_gap_checks(results.gaps),
    ]


def _instance_checks(rows: Sequence[InstanceRow]) -> list[Check]:
    if not rows:
        return []
    times = [median(row.answers[EXACT].wall_s) for row in rows]
    exact = [row for row in rows if row.solved(EXACT) and row.answers[EXACT].optimal]
    return [
        at_most(
            f"exact answer to {len(rows)} named instances, median, s "
            f"(the paper's CPLEX: {PAPER_EXACT_S:.3f} s)",
            f"{median(times):.4f} ({min(times):.4f} to {max(times):.4f})",
            median(times),
            MAX_EXACT_S,
        ),
        Check(
            "of them answered with the published optimum, proven",
            f"{len(exact)} of {len(rows)}",
            "all",
            len(exact) == len(rows),
        ),
    ]


def _city_checks(results: RoutingResults) -> list[Check]:
    if not results.city:
        return []
    runs = results.city
    wall, peak = max(r.wall_s for r in runs), max(r.peak_mb for r in runs)
    found = [
        at_most(
            f"whole cycle: {size(runs[0])}; s, worst of {len(runs)}",
            f"{wall:.1f}",
            wall,
            MAX_CYCLE_S,
        ),
        at_most("its peak memory, all processes, MB", f"{peak:.0f}", peak, MAX_PEAK_MB),
    ]
    if results.best:
        above = max(relative(r.objective_kwh, results.best_known_kwh) for r in runs)
        longest = max(r.wall_s for r in results.best)
        found.append(
            Check(
                f"its objective above the best known (longest run: {longest:.0f} s), worst",
                percent(above),
                f"≤ {100 * MAX_ABOVE_BEST:g} %",
                above <= MAX_ABOVE_BEST,
            )
        )
    return found


def _large_checks(runs: Sequence[CityRun]) -> list[Check]:
    if not runs:
        return []
    (run,) = runs
    overrun = relative(run.wall_s, run.budget_s)
    return [
        Check(
            f"sweeps in {run.budget_s:g} s: {size(run)}",
            f"{run.sweeps}",
            f"≥ {MIN_LARGE_SWEEPS}",
            run.sweeps >= MIN_LARGE_SWEEPS,
        ),
        Check(
            "its time beyond what it was given",
            percent(overrun, 1),
            f"≤ {100 * MAX_OVERRUN:g} %",
            overrun <= MAX_OVERRUN,
        ),
        at_most(
            "its peak memory, all processes, MB", f"{run.peak_mb:.0f}", run.peak_mb, MAX_PEAK_MB
        ),
    ]


def _slope_checks(runs: Sequence[CityRun]) -> list[Check]:
    times = medians_by_size(runs)
    if len(times) < 2:
        return []
    slope = log_slope(*zip(*times, strict=True))
    return [
        at_most(
            f"log-log slope of time, {times[0][0]} to {times[-1][0]} vehicles, network fixed",
            f"{slope:.2f}",
            slope,
            MAX_SLOPE,
        )
    ]


def _rival_checks(runs: Sequence[CityRun]) -> list[Check]:
    if not runs:
        return []
    base = spread([saved_share(r.objective_kwh, r.base_kwh) for r in runs])
    greedy = spread([saved_share(r.objective_kwh, r.greedy_kwh) for r in runs])
    worse = sum(r.objective_kwh > min(r.base_kwh, r.base_met_kwh) + SAME_KWH for r in runs)
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
        *_own_search_checks(runs),
    ]


def _own_search_checks(runs: Sequence[CityRun]) -> list[Check]:
    """Against the routes of PyVRP's own search of the whole fleet."""
    asked = [(run, run.rival_kwh) for run in runs if run.rival_kwh is not None]
    if not asked:
        return []
    above = max(relative(run.base_kwh, rival_kwh) for run, rival_kwh in asked)
    below = spread([saved_share(run.objective_kwh, rival_kwh) for run, rival_kwh in asked])
    name = f"PyVRP's own search without platooning, {asked[0][0].rival_cpu_s:g} CPU s"
    return [
        Check(
            f"base routes above {name}, worst of {len(asked)}",
            percent(above),
            f"≤ {100 * MAX_BASE_ABOVE_RIVAL:g} %",
            above <= MAX_BASE_ABOVE_RIVAL,
        ),
        Check(f"objective below {name}, mean", _shown(below), "> 0 %", below.mean > 0),
    ]


def _shown(shares: RivalSpread) -> str:
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


def markdown(results: RoutingResults, about: Mapping[str, object]) -> str:
    """The report as people read it."""
    lines = report_head("Routing core: how good, how fast", about, checks(results), results.missing)
    if results.instances:
        lines += ["", "## Named instances", "", *instance_table(results.instances)]
    if results.city:
        lines += [
            "",
            "## A city",
            "",
            *city_table(results.city, results.best, results.best_known_kwh),
        ]
    if results.large:
        best_kwh = min(run.objective_kwh for run in results.large)
        lines += ["", "## The largest city", "", *city_table(results.large, (), best_kwh)]
    if results.fixed:
        lines += ["", "## Time against fleet size", "", *scaling_table(results.fixed)]
    if results.rivals:
        lines += ["", "## Against the rivals", "", *rival_tables(results.rivals)]
    if results.gaps:
        lines += ["", "## Blocks against the undivided optimum", "", *gap_table(results.gaps)]
    return "\n".join(lines) + "\n"


def write(folder: Path, results: RoutingResults, about: Mapping[str, object]) -> None:
    """Write report.md and report.json into an existing folder."""
    content = {"checks": [asdict(c) for c in checks(results)], **asdict(results)}
    write_report(folder, markdown(results, about), about, content)
