"""The worlds benchmark: backgrounds, arms alone and in pairs, repetition, savings."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Load, measured_on
from slipstream_lab.benchmarks.routing.watch import watched
from slipstream_lab.benchmarks.world import report
from slipstream_lab.benchmarks.world.figures import Repeat, Saved, TimedRun
from slipstream_lab.benchmarks.world.report import WorldResults
from slipstream_lab.simulation.closed_loop.history_recording import history_of
from slipstream_lab.simulation.evaluation.arms import (
    BASELINE,
    COOPERATIVE,
    EVERY_LEVER,
    PACES,
    SHORTEST,
    noisy,
    paced,
)
from slipstream_lab.simulation.evaluation.measures import (
    Evaluation,
    SeedSpread,
    collect,
    compute_ceilings,
)
from slipstream_lab.simulation.evaluation.runs import ArmStore, World, WorldFiles, code_stamp
from slipstream_lab.simulation.scenarios.scenario import load_scenario, prepare

PARTS: Final = ("background", "arm", "pair", "same", "saving")
_HOUR_S: Final = 3600.0
_LIMIT_S: Final = 4 * 3600.0
_NOISE: Final = 0.2


@dataclass(frozen=True)
class WorldBenchForm:
    """How much is simulated."""

    scenarios: tuple[str, ...] = ("troy", "corridor")
    span_h: tuple[float, float] = (0.0, 24.0)
    same_span_h: tuple[float, float] = (7.0, 8.0)
    same_arms: str = "B,C,C+"
    saving_span_h: tuple[float, float] = (0.0, 24.0)
    saving_arms: str = ",".join(
        (SHORTEST, BASELINE, *map(paced, PACES), COOPERATIVE, EVERY_LEVER, noisy(_NOISE))
    )


FULL: Final = WorldBenchForm()
SHORT: Final = WorldBenchForm(
    scenarios=("troy",),
    span_h=(7.0, 7.25),
    same_span_h=(7.0, 7.25),
    same_arms="B,C+",
    saving_span_h=(7.0, 7.25),
    saving_arms=f"B,B-0.88,{COOPERATIVE},{EVERY_LEVER}",
)


@dataclass(frozen=True)
class WorldBenchSettings:
    """What is measured and where it goes. `out`: folder for the report and the evaluations; those
    of an earlier run are gone on with.
    """

    out: Path = Path(".slipstream/bench-world")
    form: WorldBenchForm = FULL
    seeds: tuple[int, ...] = (1, 2, 3)
    parts: tuple[str, ...] = PARTS


@dataclass
class _Bench:
    settings: WorldBenchSettings
    say: Callable[[str], None]
    missing: list[str] = field(default_factory=list)

    @property
    def form(self) -> WorldBenchForm:
        return self.settings.form

    @property
    def log(self) -> Path:
        return self.settings.out / "runs.log"

    @property
    def worlds(self) -> Iterator[tuple[str, int]]:
        """Each world with each seed."""
        for scenario in self.form.scenarios:
            for seed in self.settings.seeds:
                yield scenario, seed

    def timed(
        self, what: str, scenario: str, seed: int, core: int | None = None, beside: int = 0
    ) -> Iterator[TimedRun]:
        """One simulation in a process of its own; nothing where it failed."""
        begin_h, end_h = self.form.span_h
        self.say(f"{scenario}, seed {seed}: {what}, {end_h - begin_h:g} h")
        words = ["--scenario", scenario, "--seed", str(seed), "--folder", str(self._folder())]
        words += ["--begin", str(begin_h * _HOUR_S), "--end", str(end_h * _HOUR_S)]
        words += [] if core is None else ["--core", str(core)]
        command = [sys.executable, "-m", "slipstream_lab.benchmarks.world.timed_run", what, *words]
        try:
            result, peak = watched(command, self.log, _LIMIT_S)
        except RuntimeError as error:
            self.missing.append(f"{scenario}, seed {seed}, {what}: {error}")
            return
        yield TimedRun(
            what,
            scenario,
            seed,
            result["hours"],
            result["wall_s"],
            result["cpu_s"],
            peak,
            beside,
            tuple(result.get("faults", ())),
        )

    def ready(self, scenario: str, seed: int) -> None:
        """Write what all arms of a seed share, so that it is in no arm's time."""
        self.say(f"{scenario}, seed {seed}: history")
        begin_h, end_h = self.form.span_h
        loaded = load_scenario(scenario)
        prepare(loaded, seed, self._folder())
        history_of(loaded, seed, self._folder(), begin_s=begin_h * _HOUR_S, end_s=end_h * _HOUR_S)

    def evaluate(
        self, scenario: str, folder: Path, arms: str, span_h: tuple[float, float], seeds: str
    ) -> bool:
        """`slipstream evaluate` as a user runs it; whether it went well."""
        self.say(f"{scenario}: evaluate {arms}, seeds {seeds}, into {folder}")
        begin_h, end_h = span_h
        command = [sys.executable, "-m", "slipstream_cli", "evaluate", "--scenario", scenario]
        command += ["--out", str(folder), "--arms", arms, "--seeds", seeds]
        command += ["--begin", f"{begin_h:g}", "--hours", f"{end_h - begin_h:g}"]
        with self.log.open("a") as log:
            done = subprocess.run(command, stdout=log, stderr=log, check=False)
        if done.returncode != 0:
            why = f"slipstream evaluate ended with {done.returncode}; see {self.log}"
            self.missing.append(f"{scenario}, {arms}: {why}")
        return done.returncode == 0

    def _folder(self) -> Path:
        folder = self.settings.out / "background"
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def run_bench(settings: WorldBenchSettings, say: Callable[[str], None]) -> WorldResults:
    """Measure all and write the report; it is written after each part, so that none is lost.
    Raises InputError: the folder cannot be used.
    """
    try:
        settings.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(settings.out, f"{error.strerror}", "choose another folder") from None
    bench = _Bench(settings, say)
    bench.log.unlink(missing_ok=True)
    load = Load()
    results = WorldResults()
    for part in settings.parts:
        results = _PARTS[part](bench, results)
        results = replace(results, missing=tuple(bench.missing))
        report.write(settings.out, results, _about(settings, load))
    return results


def _background(bench: _Bench, results: WorldResults) -> WorldResults:
    runs = [run for world in bench.worlds for run in bench.timed("background", *world)]
    return replace(results, runs=(*results.runs, *runs))


def _arm(bench: _Bench, results: WorldResults) -> WorldResults:
    """The arm with every lever, of the first seed, held on one core."""
    seed, core = bench.settings.seeds[0], min(os.sched_getaffinity(0))
    runs: list[TimedRun] = []
    for scenario in bench.form.scenarios:
        bench.ready(scenario, seed)
        runs += bench.timed(EVERY_LEVER, scenario, seed, core)
    return replace(results, runs=(*results.runs, *runs))


def _pair(bench: _Bench, results: WorldResults) -> WorldResults:
    """Two arms at once, a core each."""
    seed, cores = bench.settings.seeds[0], sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        bench.missing.append("two arms side by side: one core")
        return results
    runs = []
    for scenario in bench.form.scenarios:
        bench.ready(scenario, seed)
        with ThreadPoolExecutor(2) as pool:
            jobs = [
                pool.submit(list[TimedRun], bench.timed(arm, scenario, seed, core, 1))
                for arm, core in zip((COOPERATIVE, EVERY_LEVER), cores, strict=False)
            ]
            runs += [run for job in jobs for run in job.result()]
    return replace(results, runs=(*results.runs, *runs))


def _same(bench: _Bench, results: WorldResults) -> WorldResults:
    """The same evaluation twice, from nothing, in folders of their own."""
    form, seed = bench.form, str(bench.settings.seeds[0])
    repeats = []
    for scenario in form.scenarios:
        stamp = time.time_ns()
        folders = [bench.settings.out / f"same-{scenario}-{stamp}-{i}" for i in (1, 2)]
        if all(
            bench.evaluate(scenario, f, form.same_arms, form.same_span_h, seed) for f in folders
        ):
            files, different = compare_folders(*folders)
            hours = form.same_span_h[1] - form.same_span_h[0]
            repeats.append(Repeat(scenario, hours, form.same_arms, files, different))
    return replace(results, repeats=tuple(repeats))


def compare_folders(first: Path, second: Path) -> tuple[int, tuple[str, ...]]:
    """(Files of results in both or either, names of those that differ or are in one alone).

    Wall times are no results.
    """
    names = sorted(
        {
            path.relative_to(folder).as_posix()
            for folder in (first, second)
            for path in folder.rglob("*")
            if path.is_file() and path.name not in ("run.json", ".lock")
        }
    )
    different = []
    for name in names:
        pair = [folder / name for folder in (first, second)]
        if not all(p.is_file() for p in pair) or pair[0].read_bytes() != pair[1].read_bytes():
            different.append(name)
    return len(names), tuple(different)


def _saving(bench: _Bench, results: WorldResults) -> WorldResults:
    form, seeds = bench.form, bench.settings.seeds
    saved, tables = [], []
    for scenario in form.scenarios:
        begin_h, end_h = form.saving_span_h
        folder = bench.settings.out / f"{scenario}-{begin_h:g}-{end_h:g}"
        join_names = ",".join(map(str, seeds))
        if bench.evaluate(scenario, folder, form.saving_arms, form.saving_span_h, join_names):
            saved.append(read_saved(scenario, folder, form.saving_span_h, seeds))
            tables.append(str(folder))
    return replace(results, saved=tuple(saved), tables=tuple(tables))


def read_saved(
    scenario: str, folder: Path, span_h: tuple[float, float], seeds: Sequence[int]
) -> Saved:
    """Figures of an evaluation's folder."""
    span_s = span_h[0] * _HOUR_S, span_h[1] * _HOUR_S
    world = World(WorldFiles(scenario), folder / "background", "actuated", span_s)
    with ArmStore(folder, world.provenance, code_stamp()) as store:
        found = collect(store, world.provenance, seeds)

    def equal(name: str) -> float | None:
        return _mean(found.against(name, lambda c: c.at_equal_time))

    return Saved(
        scenario,
        span_h[1] - span_h[0],
        tuple(seeds),
        equal(EVERY_LEVER),
        equal(COOPERATIVE),
        equal(noisy(_NOISE)),
        _mean(found.against(COOPERATIVE, lambda c: c.shares.drag_kwh)),
        _drafting(found, world),
        tuple(f"{name} of seed {seed}" for name, seed, _ in found.refused),
    )


def _drafting(found: Evaluation, world: World) -> float | None:
    """What every kilometre drafted would save of the baseline, mean of the seeds."""
    roads, kind = world.scenario.network, world.scenario.fleet.vehicle_type
    shares = [
        compute_ceilings(stored.result, roads, kind).savings()["drafting"]
        for seed, stored in found.arms.get(BASELINE, {}).items()
        if not found.runs[BASELINE][seed].faults
    ]
    return sum(shares) / len(shares) if shares else None


def _mean(spread: SeedSpread | None) -> float | None:
    return None if spread is None else spread.mean


_PARTS: Final[dict[str, Callable[[_Bench, WorldResults], WorldResults]]] = {
    "background": _background,
    "arm": _arm,
    "pair": _pair,
    "same": _same,
    "saving": _saving,
}


def _about(settings: WorldBenchSettings, load: Load) -> dict[str, object]:
    form = {FULL: "full", SHORT: "short: minutes, which no aim is judged by"}
    return measured_on(
        load,
        form=form.get(settings.form, "own"),
        parts=", ".join(settings.parts),
        seeds=", ".join(map(str, settings.seeds)),
    )
