"""The curve: share of the drafting ceiling against vehicles a day, planned and driven.

Each density is planned, on the corridor or in another world, with every strategy and bounded, for
one carrier and for ten; what the dispatcher planned and vehicles drove in SUMO stands beside it.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, Final

from slipstream_lab.research.coordination.cells import (
    OWN,
    CellResult,
    CoordinationCell,
    found,
    measured,
)
from slipstream_lab.research.coordination.picture import (
    BOUND,
    PLACES,
    PRICES_KW,
    by_density,
    draw,
    shares,
)
from slipstream_lab.research.coordination.strategies import STRATEGIES
from slipstream_lab.simulation.evaluation.measures import Evaluation, SeedSpread
from slipstream_lab.simulation.evaluation.report import (
    ReportTable,
    as_markdown,
    density_tables,
    number,
    percent,
)
from slipstream_lab.simulation.evaluation.runs import WorldFiles, not_writable, write_atomically

WINDOW_MIN: Final = 10
"""A trip arrives so much before or after the preferred time at most: as long as the scenario's
vans may wait for each other at their depot."""
_NOTHING: Final = 0.0005
"""Of the drafting ceiling: shown as 0.0 %."""
_CELLS: Final = "planned"
_START_VEHICLES: Final = 200
"""A cell takes about as long as so many vehicles more."""


def curve_cells(
    densities: Iterable[int], seeds: Iterable[int], world: WorldFiles | None = None
) -> list[CoordinationCell]:
    """What is planned, on the corridor or in another world; densities in turn."""
    return [
        CoordinationCell(place, vehicles, WINDOW_MIN, price_kw, seed, world)
        for vehicles in densities
        for seed in seeds
        for price_kw in PRICES_KW
        for place in PLACES
    ]


def plan_missing(
    cells: Sequence[CoordinationCell],
    folder: Path,
    workers: int,
    progress: Callable[[int, int], None],
) -> int:
    """Plan and bound what the folder lacks; how many cells it had.

    Raises:
        InputError: the folder cannot be written. What was finished before is kept, as after
            KeyboardInterrupt.
        RuntimeError: a strategy above the bound.
    """
    at = folder / _CELLS
    missing = [cell for cell in cells if found(cell, at) is None]
    work = sum(cell.vehicles + _START_VEHICLES for cell in missing)
    done = 0
    try:
        at.mkdir(parents=True, exist_ok=True)
        for cell in _measured(missing, at, workers):
            done += cell.vehicles + _START_VEHICLES
            progress(done, work)
    except OSError as error:
        raise not_writable(at, error) from None
    return len(cells) - len(missing)


def _measured(
    cells: Sequence[CoordinationCell], at: Path, workers: int
) -> Iterable[CoordinationCell]:
    """The cells as they are finished."""
    if workers == 1 or len(cells) < 2:
        for cell in cells:
            measured(cell, at, _say_nothing)
            yield cell
        return
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, context, _leave_interrupts) as pool:
        futures = {pool.submit(measured, cell, at, _say_nothing): cell for cell in cells}
        try:
            for future in as_completed(futures):
                future.result()
                yield futures[future]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
            raise


def _say_nothing(_: str) -> None:
    pass


def _leave_interrupts() -> None:
    """An interrupt is the business of the process that asked."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def planned(cells: Iterable[CoordinationCell], folder: Path) -> list[CellResult]:
    """What the folder has of these cells."""
    return [r for cell in cells if (r := found(cell, folder / _CELLS)) is not None]


def planned_tables(results: Sequence[CellResult]) -> tuple[ReportTable, ...]:
    """Every strategy and the bound, a table for each price of waiting."""
    tables = []
    for price_kw in PRICES_KW:
        rows = []
        for place, name in PLACES.items():
            some = [r for r in results if (r.cell.place, r.cell.price_kw) == (place, price_kw)]
            for vehicles, cells in by_density(some).items():
                rows.append((name, f"{vehicles:,}", *_row(cells)))
        if rows:
            tables.append(_table(price_kw, tuple(rows)))
    return tuple(tables)


def _table(price_kw: int, rows: tuple[tuple[str, ...], ...]) -> ReportTable:
    heads = (
        *("carriers", "vehicles a day", "seeds", *STRATEGIES, BOUND, "best plan, of the bound"),
        *(f"{OWN}: drafting", "in platoons", "mean wait, s"),
    )
    return ReportTable(
        f"Planned only: waiting at {price_kw} kW, arrival within ±{WINDOW_MIN} min",
        heads,
        rows,
        f"`{_CELLS}/*-{price_kw}kw-*.json`",
        (
            "Means over the seeds, a day each, ± standard deviation between them. Net value "
            "(drafting less stops at hubs and waiting) as a share of the drafting ceiling; no plan "
            "is worth more than the bound. Drafting: before stops and waiting are taken off; in "
            "platoons: of the way where they may drive; both and the wait by the local search. "
            r"\*: on some day a carrier has less than alone.",
        ),
    )


def _row(cells: Sequence[CellResult]) -> tuple[str, ...]:
    # The share of a bound that is next to nothing says nothing.
    bounded = [r for r in cells if r.bound_share >= _NOTHING]
    own = [(r.row(OWN).outcome, r.plans.ceiling_kwh) for r in cells]

    def unfair(strategy: str) -> str:
        return "" if all(r.row(strategy).is_fair for r in cells) else r"\*"

    return (
        str(len(cells)),
        *(percent(spread) + unfair(name) for name, spread in shares(cells).items()),
        percent(SeedSpread.over([r.bound_share for r in cells])),
        percent(SeedSpread.over([r.best.net_kwh / r.bounded.bound_kwh for r in bounded])),
        percent(SeedSpread.over([o.drafting_kwh / ceiling_kwh for o, ceiling_kwh in own])),
        percent(SeedSpread.over([o.platooned_km / o.open_km for o, _ in own])),
        number(SeedSpread.over([o.mean_wait_s for o, _ in own]), 0),
    )


_DIFFERENCES: Final = f"""## What differs between planned only and driven

Their shares do not compare point by point; the upper bound is of what is planned only.

- Demand: a day's single trips by the law of docs/coordination.md; driven: rounds with several
  orders each (docs/scenarios.md), in the hours that were simulated.
- Carriers: one, and ten; driven: one.
- Ready: with one carrier one by one within 30 min of each wave, with ten all day; driven: all
  orders of a wave at once, so that vans meet without a wait.
- Who plans: each strategy, which knows the whole day; driven: the dispatcher, every five minutes,
  from what is ordered by then.
- Waits: at origins and ramps, arrival within ±{WINDOW_MIN} min, at the price that is given; driven:
  up to ten minutes at the depot and at stops, at the prices under the table of waits.
- Gates: all open where RSUs watch; driven: as RSUs report them.
- Share: drafting less stops and waiting; driven: drafting alone, and what was planned of it.
"""


def write_curve(
    folder: Path,
    results: Sequence[CellResult],
    driven: Mapping[int, Evaluation],
    made_up: Sequence[str] = (),
) -> str | None:
    """Write `density.md` and `density.png`; returns why there is no picture, if so.

    Args:
        made_up: what of the world nobody gave, in words.

    Raises:
        InputError: a file cannot be written.
    """
    parts = [as_markdown(table) for table in planned_tables(results)]
    if driven:
        parts += [*map(as_markdown, density_tables(driven)), _DIFFERENCES]
    if made_up:
        parts.append("\n".join(["## Made up", "", *(f"- {line}" for line in made_up), ""]))
    try:
        write_atomically(folder / "density.md", "\n".join(parts))
        draw(results, driven, folder / "density.png")
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "matplotlib":
            raise
        return "matplotlib is not installed, so no figure is drawn"
    except OSError as error:
        raise not_writable(Path(error.filename or folder), error) from None
    return None


def as_data(results: Sequence[CellResult]) -> list[dict[str, Any]]:
    """Means and spreads of what was planned, for JSON."""
    found = []
    for price_kw in PRICES_KW:
        for place in PLACES:
            some = [r for r in results if (r.cell.place, r.cell.price_kw) == (place, price_kw)]
            for vehicles, cells in by_density(some).items():
                spreads = {**shares(cells), BOUND: SeedSpread.over([r.bound_share for r in cells])}
                found.append(
                    {
                        "waiting_kw": price_kw,
                        "carriers": place,
                        "vehicles": vehicles,
                        "seeds": [r.cell.seed for r in cells],
                        "share_of_ceiling": {n: s and asdict(s) for n, s in spreads.items()},
                    }
                )
    return found
