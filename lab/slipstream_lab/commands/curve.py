"""`slipstream evaluate --density`: the curve by vehicles a day, planned, and driven where asked."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from slipstream.config import Settings
from slipstream.errors import InputError
from slipstream_cli.progress import ProgressLine

if TYPE_CHECKING:
    from slipstream_lab.simulation.evaluation.measures import Evaluation
    from slipstream_lab.simulation.evaluation.runs import WorldFiles

_Evaluate = Callable[[Path, "WorldFiles"], "tuple[Evaluation, dict[str, Any]]"]
"""Evaluates files in a folder: what it found, and its summary."""
_MOST_VEHICLES: Final = 3000
"""A day: more take hours and gigabytes."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add those of the curve."""
    command.add_argument(
        "--density",
        metavar="N,N",
        help="plan so many vehicles a day on the scenario's roads with every strategy, no "
        "simulation",
    )
    command.add_argument(
        "--drive",
        metavar="N,N",
        help="with --density: vehicles a day that are driven in SUMO too (default: none)",
    )


def parse_numbers(key: str, text: str, least: int, example: str) -> tuple[int, ...]:
    """Whole numbers of a comma-separated list, rising, each once. Raises InputError: there is
    none, or one below `least`.
    """
    try:
        numbers = sorted({int(part) for part in text.split(",") if part.strip()})
    except ValueError:
        numbers = []
    if not numbers or numbers[0] < least:
        problem = f"no whole numbers from {least} on: {text!r}"
        raise InputError("evaluate", problem, f"give some as {example}", key=key)
    return tuple(numbers)


def _densities(key: str, text: str, example: str) -> tuple[int, ...]:
    numbers = parse_numbers(key, text, 1, example)
    if numbers[-1] > _MOST_VEHICLES:
        problem = f"{numbers[-1]} vehicles a day are too many"
        raise InputError("evaluate", problem, f"give {_MOST_VEHICLES} at most", key=key)
    return numbers


@dataclass(frozen=True)
class Curve:
    """What is asked for."""

    out: Path
    densities: tuple[int, ...]
    driven: tuple[int, ...]
    stored: bool
    quiet: bool

    @classmethod
    def of(cls, options: argparse.Namespace) -> Self | None:
        """By the command's options; None where they do not ask for a curve. Raises InputError:
        options that are wrong, or do not go together.
        """
        from slipstream_lab.simulation.evaluation.arms import wants_exogenous

        if options.density is None:
            if options.drive is not None:
                mend = "give --density too, as --density 20,50,100"
                raise InputError("evaluate", "there is no curve to add to", mend, key="--drive")
            return None
        densities = _densities("--density", options.density, "20,50,100")
        if options.drive is None:
            numbers = (options.hours, options.waiting_kw, options.standing_kw)
            if options.arms or options.begin or any(given is not None for given in numbers):
                problem = "arms, hours and prices are of what is driven, and nothing is"
                raise InputError("evaluate", problem, "name densities as 29,100", key="--drive")
            return cls(options.out, densities, (), options.stored, options.json)
        driven = _densities("--drive", options.drive, "29,100")
        if wants_exogenous(options.arms or ""):
            mend = "give --arms B,C"
            raise InputError("evaluate", "no density has exogenous arms", mend, key="--arms")
        return cls(options.out, densities, driven, options.stored, options.json)

    def make(
        self, seeds: Sequence[int], workers: int, files: WorldFiles, evaluate: _Evaluate
    ) -> dict[str, Any]:
        """Plan and drive what is missing, write table and picture; the summary.

        Raises:
            InputError: a density that the fleet cannot have, a folder that cannot be written, or
                nothing that is stored.
        """
        from slipstream_lab.research.coordination.curve import (
            as_data,
            curve_cells,
            plan_missing,
            planned,
            write_curve,
        )
        from slipstream_lab.simulation.evaluation.runs import WorldFiles

        # The law was made for the corridor, whose parts are all given.
        own = files != WorldFiles("corridor")
        made: list[str] = []
        if own:
            files = self._world(files, seeds[0], made)
        fleets = self._fleets(files, made if own else [])
        if not self.quiet:
            for line in made:
                print(f"slipstream: made up: {line}", file=sys.stderr)
        cells = curve_cells(self.densities, seeds, files if own else None)
        if not self.stored:
            with ProgressLine("planning", sys.stderr) as progress:
                plan_missing(cells, self.out, workers, progress.update)
        results = planned(cells, self.out)
        found: dict[int, Evaluation] = {}
        summaries: dict[str, Any] = {}
        if not (results or fleets):
            raise InputError(self.out, "nothing of these is stored", "run it without --stored")
        missing = write_curve(self.out, results, {}, made) if results else None
        for number, (vehicles, fleet) in enumerate(fleets.items(), 1):
            if sys.stderr.isatty():
                said = f"{vehicles} vehicles a day ({number} of {len(fleets)} that are driven)"
                print(said, file=sys.stderr)
            evaluation, summary = evaluate(fleet.parent, replace(files, fleet=fleet))
            found[vehicles], summaries[str(vehicles)] = evaluation, summary
        if found:
            missing = write_curve(self.out, results, found, made)
        if missing is not None:
            print(f"slipstream: {missing}", file=sys.stderr)
        if not self.quiet:
            print(self.out / "density.md")
        return {"planned": as_data(results), "driven": summaries, "made_up": made}

    def _world(self, files: WorldFiles, seed: int, made: list[str]) -> WorldFiles:
        """With RSUs for all densities and seeds: those that one seed's traffic has placed are put
        into a file. `made` gets what nobody gave.
        """
        from slipstream_lab.simulation.rsus import RsuFile
        from slipstream_lab.simulation.scenarios.scenario import made_up, prepare

        scenario = files.load()
        if scenario.rsus is not None and scenario.fleet.depots and not scenario.made_up:
            return files
        background = prepare(scenario, seed, self.out / "background")
        made += made_up(scenario, background, seed)
        if scenario.rsus is not None:
            return files
        if not background.rsus:
            problem = "no segment is long enough for an RSU"
            raise InputError(scenario.net, problem, "give RSUs", key="--rsus")
        path = self.out / "rsus.toml"
        self._write(path, RsuFile(rsus=background.rsus))
        return replace(files, rsus=path)

    def _fleets(self, files: WorldFiles, made: list[str]) -> dict[int, Path]:
        """Files with the fleets that are driven, by vehicles a day. `made` gets the law."""
        from slipstream_lab.simulation.evaluation.density import scaled, tours

        if not self.driven:
            return {}
        scenario = files.load()
        fleet, own = scenario.fleet, tours(scenario)
        made.append(
            f"driven fleets: {own} tours a day are made with {fleet.orders} orders and "
            f"{fleet.vehicles} vehicles (seed 1, empty roads); N vehicles a day have N / {own} of "
            "both"
        )
        fleets = {n: scaled(fleet, n, own, "--drive") for n in self.driven}
        paths = {n: self.out / f"density-{n}" / "fleet.toml" for n in self.driven}
        for vehicles, path in paths.items():
            self._write(path, fleets[vehicles])
        return paths

    def _write(self, path: Path, settings: Settings) -> None:
        """Raises InputError: the folder cannot be written."""
        import tomli_w

        from slipstream_lab.simulation.evaluation.runs import not_writable, write_atomically

        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(
                path, tomli_w.dumps(settings.model_dump(mode="json", exclude_none=True))
            )
        except OSError as error:
            raise not_writable(self.out, error) from None
