"""`slipstream evaluate --density`: the curve by vehicles a day, planned, and driven where asked."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from slipstream.errors import InputError
from slipstream_cli.progress import ProgressLine

if TYPE_CHECKING:
    from slipstream_lab.simulation.evaluation.measures import Evaluation
    from slipstream_lab.simulation.evaluation.runs import WorldFiles

_Evaluate = Callable[[Path, "WorldFiles"], "tuple[Evaluation, dict[str, Any]]"]
"""Evaluates files in a folder: what it found, and its summary."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add those of the curve."""
    command.add_argument(
        "--density",
        metavar="N,N",
        help="plan so many vehicles a day on the corridor with every strategy, no simulation",
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
        densities = parse_numbers("--density", options.density, 1, "20,50,100")
        own = (options.net, options.demand, options.rsus, options.fleet, options.sumocfg)
        sumo = (*options.routes, *options.additional)
        if options.scenario != "corridor" or any(part is not None for part in (*own, *sumo)):
            problem = "the law is of the corridor's roads and fleet"
            mend = "give --scenario corridor and no file of your own"
            raise InputError("evaluate", problem, mend, key="--density")
        if options.drive is None:
            numbers = (options.hours, options.waiting_kw, options.standing_kw)
            if options.arms or options.begin or any(given is not None for given in numbers):
                problem = "arms, hours and prices are of what is driven, and nothing is"
                raise InputError("evaluate", problem, "name densities as 29,100", key="--drive")
            return cls(options.out, densities, (), options.stored, options.json)
        driven = parse_numbers("--drive", options.drive, 1, "29,100")
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

        fleets = self._fleets(files)
        cells = curve_cells(self.densities, seeds)
        if not self.stored:
            with ProgressLine("planning", sys.stderr) as progress:
                plan_missing(cells, self.out, workers, progress.update)
        results = planned(cells, self.out)
        found: dict[int, Evaluation] = {}
        summaries: dict[str, Any] = {}
        if not (results or fleets):
            raise InputError(self.out, "nothing of these is stored", "run it without --stored")
        missing = write_curve(self.out, results, {}) if results else None
        for number, (vehicles, fleet) in enumerate(fleets.items(), 1):
            if sys.stderr.isatty():
                said = f"{vehicles} vehicles a day ({number} of {len(fleets)} that are driven)"
                print(said, file=sys.stderr)
            evaluation, summary = evaluate(fleet.parent, replace(files, fleet=fleet))
            found[vehicles], summaries[str(vehicles)] = evaluation, summary
        if found:
            missing = write_curve(self.out, results, found)
        if missing is not None:
            print(f"slipstream: {missing}", file=sys.stderr)
        if not self.quiet:
            print(self.out / "density.md")
        return {"planned": as_data(results), "driven": summaries}

    def _fleets(self, files: WorldFiles) -> dict[int, Path]:
        """Files with the fleets that are driven, by vehicles a day; all densities are checked."""
        import tomli_w

        from slipstream_lab.simulation.evaluation.density import scaled
        from slipstream_lab.simulation.evaluation.runs import not_writable, write_atomically

        own = files.load().fleet
        for vehicles in self.densities:
            scaled(own, vehicles, "--density")
        fleets = {n: scaled(own, n, "--drive") for n in self.driven}
        paths = {n: self.out / f"density-{n}" / "fleet.toml" for n in self.driven}
        try:
            for vehicles, path in paths.items():
                settings = fleets[vehicles].model_dump(mode="json", exclude_none=True)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomically(path, tomli_w.dumps(settings))
        except OSError as error:
            raise not_writable(self.out, error) from None
        return paths
