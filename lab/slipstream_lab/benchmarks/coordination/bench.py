"""The coordination benchmark: all cells in turn, gone on with where it was interrupted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Load, measured_on
from slipstream_lab.benchmarks.coordination import report
from slipstream_lab.research.coordination.cells import (
    CellResult,
    CoordinationCell,
    Place,
    found,
    measured,
)
from slipstream_lab.research.coordination.trips.corridor import DENSITIES, WINDOWS_MIN
from slipstream_lab.research.coordination.trips.region import TRUCKS

PRICES_KW: Final = (10, 0, 27)
"""10: a driver's time partly used otherwise; 0: free waits; 27: what slower driving would save."""


@dataclass(frozen=True)
class CoordinationBenchForm:
    """How much is planned."""

    vehicles: tuple[int, ...] = DENSITIES
    windows_min: tuple[int, ...] = WINDOWS_MIN
    prices_kw: tuple[int, ...] = PRICES_KW
    trucks: int = TRUCKS

    def cells(self) -> Iterator[CoordinationCell]:
        """All cells; the quick ones of a price and window first."""
        for price_kw in self.prices_kw:
            for window_min in sorted(self.windows_min, key=lambda w: (w != 10, -w)):
                for vehicles in self.vehicles:
                    places: tuple[Place, ...] = ("one", "ten")
                    for place in places:
                        yield CoordinationCell(place, vehicles, window_min, price_kw)
                if self.trucks:
                    yield CoordinationCell("region", self.trucks, window_min, price_kw)


FULL: Final = CoordinationBenchForm()
SHORT: Final = CoordinationBenchForm(
    vehicles=(20, 50), windows_min=(1, 5), prices_kw=(10, 0), trucks=60
)


@dataclass(frozen=True)
class CoordinationBenchSettings:
    """What is planned and where it goes. `out`: folder for the report and the cells; those of an
    earlier run are gone on with.
    """

    out: Path = Path(".slipstream/bench-coordination")
    form: CoordinationBenchForm = FULL


def run_bench(settings: CoordinationBenchSettings, say: Callable[[str], None]) -> list[CellResult]:
    """Plan all cells and write the report; it is written after each, so that none is lost.

    Raises:
        InputError: the folder cannot be used.
        RuntimeError: a strategy above the bound: one of both is wrong.
    """
    folder = settings.out / "cells"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(settings.out, f"{error.strerror}", "choose another folder") from None
    load, cells = Load(), list(settings.form.cells())
    results: list[CellResult] = []
    for number, cell in enumerate(cells, 1):
        if found(cell, folder) is None:
            say(f"{number} of {len(cells)}: {cell.name}")
        results.append(measured(cell, folder, say))
        report.write(settings.out, results, _about(settings, load))
    return results


def _about(settings: CoordinationBenchSettings, load: Load) -> dict[str, object]:
    form = {FULL: "full", SHORT: "short: a minute or two"}
    return measured_on(load, form=form.get(settings.form, "own"))
