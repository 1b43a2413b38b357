"""The routing benchmark: named instances, the city, fleet sizes, rivals, the undivided optimum."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Load, measured_on
from slipstream_lab.benchmarks.routing import report
from slipstream_lab.benchmarks.routing.figures import CityRun, Gap
from slipstream_lab.benchmarks.routing.instances import measure_instances
from slipstream_lab.benchmarks.routing.plots import draw
from slipstream_lab.benchmarks.routing.report import RoutingResults
from slipstream_lab.benchmarks.routing.watch import watched

PARTS: Final = ("instances", "city", "large", "scaling", "rivals", "gap")
_GENEROUS_S: Final = 300.0
"""What a run may take beyond its budget before it is ended."""


@dataclass(frozen=True)
class CitySize:
    """Of one generated city."""

    vehicles: int
    stops: int
    segments: int

    def with_vehicles(self, vehicles: int) -> CitySize:
        """The same for another fleet; stops grow with it, on the same network."""
        return CitySize(vehicles, round(self.stops * vehicles / self.vehicles), self.segments)


@dataclass(frozen=True)
class RoutingBenchForm:
    """How much is measured. `fleets`: sizes for the slope, on the network of ``city``."""

    repeats: int = 5
    city: CitySize = CitySize(200, 1000, 2000)
    city_seeds: tuple[int, ...] = (1, 2, 3)
    budget_s: float = 30.0
    large: CitySize = CitySize(2000, 10_000, 2000)
    large_s: float = 120.0
    best_s: float = 600.0
    best_seeds: tuple[int, ...] = (1,)
    fleets: tuple[int, ...] = (10, 20, 50, 100, 200, 350, 500)
    rivals: CitySize = CitySize(40, 200, 400)
    rival_s: float = 60.0
    rival_seeds: tuple[int, ...] = tuple(range(1, 21))
    gap: CitySize = CitySize(100, 500, 1000)
    gap_seeds: tuple[int, ...] = tuple(range(1, 6))
    gap_s: float = 120.0


FULL: Final = RoutingBenchForm()
SHORT: Final = RoutingBenchForm(
    repeats=1,
    city=CitySize(40, 200, 400),
    city_seeds=(1,),
    budget_s=10.0,
    large=CitySize(300, 1500, 600),
    large_s=20.0,
    best_s=20.0,
    fleets=(5, 10, 20),
    rivals=CitySize(10, 50, 200),
    rival_s=5.0,
    rival_seeds=(1, 2, 3),
    gap=CitySize(50, 250, 500),
    gap_seeds=(1, 2),
    gap_s=20.0,
)


@dataclass(frozen=True)
class RoutingBenchSettings:
    """What is measured and where it goes. `plots`: their folder; None: beside the report."""

    out: Path = Path(".slipstream/bench-routing")
    plots: Path | None = None
    form: RoutingBenchForm = FULL
    parts: tuple[str, ...] = PARTS


@dataclass
class _Bench:
    settings: RoutingBenchSettings
    say: Callable[[str], None]
    missing: list[str] = field(default_factory=list)

    @property
    def form(self) -> RoutingBenchForm:
        return self.settings.form

    @property
    def log(self) -> Path:
        return self.settings.out / "runs.log"

    def city(
        self,
        size: CitySize,
        seed: int,
        budget_s: float,
        solver_seed: int = 1,
        *flags: str,
        rival_s: float = 0.0,
    ) -> Iterator[CityRun]:
        """One cycle in a process of its own; nothing where it failed."""
        self.say(
            f"{size.vehicles} vehicles, {size.stops} stops, {size.segments} segments, city {seed}, "
            f"given {budget_s:g} s"
        )
        options = {"--seed": seed, "--budget": budget_s, "--solver-seed": solver_seed}
        limit_s = budget_s + rival_s
        if rival_s:
            options["--rival"] = rival_s
        result = self._run(
            "slipstream_lab.benchmarks.routing.city_run", size, options, limit_s, flags
        )
        if result is not None:
            values, peak = result
            yield CityRun(**values, peak_mb=peak)  # type: ignore[arg-type]

    def gap(self, size: CitySize, seed: int) -> Iterator[Gap]:
        """A city by blocks and undivided; nothing where it failed."""
        self.say(f"{size.vehicles} vehicles undivided, city {seed}")
        options = {"--seed": seed, "--exact": self.form.gap_s}
        result = self._run(
            "slipstream_lab.benchmarks.routing.gap_run", size, options, self.form.gap_s
        )
        if result is not None:
            yield Gap(**result[0])  # type: ignore[arg-type]

    def _run(
        self,
        module: str,
        size: CitySize,
        options: Mapping[str, object],
        limit_s: float,
        flags: Sequence[str] = (),
    ) -> tuple[dict[str, object], float] | None:
        sizes = {f"--{name}": value for name, value in asdict(size).items()}
        words = [str(word) for option in {**sizes, **options}.items() for word in option]
        words += flags
        try:
            return watched([sys.executable, "-m", module, *words], self.log, limit_s + _GENEROUS_S)
        except RuntimeError as error:
            self.missing.append(f"{size.vehicles} vehicles, {' '.join(words[6:])}: {error}")
            return None


def run_bench(settings: RoutingBenchSettings, say: Callable[[str], None]) -> RoutingResults:
    """Measure all and write the report; it is written after each part, so that none is lost.
    Raises InputError: a folder cannot be used.
    """
    for folder in (settings.out, settings.plots or settings.out):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(folder, f"{error.strerror}", "choose another folder") from None
    bench = _Bench(settings, say)
    bench.log.unlink(missing_ok=True)
    load = Load()
    results = RoutingResults()
    for part in settings.parts:
        results = _PARTS[part](bench, results)
        results = replace(results, missing=tuple(bench.missing))
        report.write(settings.out, results, _about(settings, load))
    draw(results, settings.plots or settings.out)
    return results


def _instances(bench: _Bench, results: RoutingResults) -> RoutingResults:
    bench.say("named instances")
    return replace(results, instances=tuple(measure_instances(bench.form.repeats)))


def _city(bench: _Bench, results: RoutingResults) -> RoutingResults:
    form = bench.form
    runs = [r for s in form.city_seeds for r in bench.city(form.city, 1, form.budget_s, s)]
    best = [r for s in form.best_seeds for r in bench.city(form.city, 1, form.best_s, s, "--long")]
    return replace(results, city=tuple(runs), best=tuple(best))


def _large(bench: _Bench, results: RoutingResults) -> RoutingResults:
    runs = bench.city(bench.form.large, 1, bench.form.large_s)
    return replace(results, large=tuple(runs))


def _scaling(bench: _Bench, results: RoutingResults) -> RoutingResults:
    """Searches end by what they have done, not by the clock."""
    sizes = [bench.form.city.with_vehicles(vehicles) for vehicles in bench.form.fleets]
    runs = [r for size in sizes for r in bench.city(size, 1, _GENEROUS_S, 1, "--unguarded")]
    return replace(results, fixed=tuple(runs))


def _rivals(bench: _Bench, results: RoutingResults) -> RoutingResults:
    form = bench.form
    runs = [
        run
        for seed in form.rival_seeds
        for run in bench.city(form.rivals, seed, form.budget_s, rival_s=form.rival_s)
    ]
    return replace(results, rivals=tuple(runs))


def _gap(bench: _Bench, results: RoutingResults) -> RoutingResults:
    gaps = [gap for seed in bench.form.gap_seeds for gap in bench.gap(bench.form.gap, seed)]
    return replace(results, gaps=tuple(gaps))


_PARTS: Final[dict[str, Callable[[_Bench, RoutingResults], RoutingResults]]] = {
    "instances": _instances,
    "city": _city,
    "large": _large,
    "scaling": _scaling,
    "rivals": _rivals,
    "gap": _gap,
}


def _about(settings: RoutingBenchSettings, load: Load) -> dict[str, object]:
    form = {FULL: "full", SHORT: "short: smaller than the aims ask"}.get(settings.form, "own")
    return measured_on(load, form=form, parts=", ".join(settings.parts))
