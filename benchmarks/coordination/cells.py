"""One cell of the table: a day's trips at one price, all strategies and the bound."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import research.coordination
from dispatcher_daemon.settings import DispatcherSettings
from research.coordination.bound import upper_bound
from research.coordination.case import Case, build_case
from research.coordination.corridor import WINDOWS_MIN, corridor_freight
from research.coordination.freight import MS, Freight
from research.coordination.plan import evaluate
from research.coordination.region import region_freight
from research.coordination.strategies import STRATEGIES

Place = Literal["one", "ten", "region"]
"""The corridor with one carrier or ten, or the region."""

_SEED: Final = 1


@dataclass(frozen=True)
class Cell:
    """What is planned.

    Attributes:
        place: and carriers.
        vehicles: a day.
        window_min: half of the interval of arrival.
        price_kw: of waiting.
    """

    place: Place
    vehicles: int
    window_min: int
    price_kw: int

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.place}-{self.vehicles}-{self.window_min}min-{self.price_kw}kw"


@dataclass(frozen=True)
class Row:
    """What one strategy reached; names as in `research.coordination.plan.Outcome`."""

    strategy: str
    net_kwh: float
    drafting_kwh: float
    stops_kwh: float
    waiting_kwh: float
    mean_wait_s: float
    max_wait_s: float
    platooned_km: float
    worst_carrier_kwh: float
    wall_s: float


@dataclass(frozen=True)
class Result:
    """A cell with what came out.

    Attributes:
        cell: planned.
        ceiling_kwh: saving if everybody were a follower all the way.
        bound_kwh: no plan's net value is above it.
        bin_s: of the bound.
        bound_s: time that it took.
        open_km: driven where platoons may.
        rows: one a strategy.
        code: digest of the code that made it.
    """

    cell: Cell
    ceiling_kwh: float
    bound_kwh: float
    bin_s: float
    bound_s: float
    open_km: float
    rows: tuple[Row, ...]
    code: str

    @property
    def best(self) -> Row:
        """Of the highest net value."""
        return max(self.rows, key=lambda row: row.net_kwh)


def measured(cell: Cell, folder: Path, say: Callable[[str], None]) -> Result:
    """A cell's result, from the folder if this code has put it there.

    A window in which no trip can use all its time at the price gives the same as a shorter one that
    does, which is then measured in its place.
    """
    smallest = _smallest_window(cell)
    made = _stored(folder / f"{smallest.name}.json")
    if made is None:
        made = _measure(smallest, say)
        path = folder / f"{smallest.name}.json"
        draft = path.with_suffix(".part")
        draft.write_text(json.dumps(asdict(made), indent=1) + "\n", encoding="utf-8")
        draft.replace(path)
    return replace(made, cell=cell)


def found(cell: Cell, folder: Path) -> Result | None:
    """A cell's result if it was measured before."""
    made = _stored(folder / f"{_smallest_window(cell).name}.json")
    return None if made is None else replace(made, cell=cell)


@cache
def code_digest() -> str:
    """Of the modules that results depend on."""
    digest = hashlib.sha256()
    for path in sorted(Path(research.coordination.__path__[0]).glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _measure(cell: Cell, say: Callable[[str], None]) -> Result:
    case = _case(cell)
    rows = []
    for name, strategy in STRATEGIES.items():
        began = time.perf_counter()
        plan = strategy(case)
        wall_s = time.perf_counter() - began
        outcome = evaluate(case, plan)
        rows.append(
            Row(
                name,
                outcome.net_kwh,
                outcome.drafting_kwh,
                outcome.stops_kwh,
                outcome.waiting_kwh,
                outcome.mean_wait_s,
                outcome.max_wait_s,
                outcome.platooned_km,
                min(outcome.carrier_kwh),
                wall_s,
            )
        )
        say(f"{cell.name}: {name}, {outcome.net_kwh / case.ceiling_kwh:.1%}, {wall_s:.1f} s")
    began = time.perf_counter()
    bound = upper_bound(case)
    wall_s = time.perf_counter() - began
    say(f"{cell.name}: bound, {bound.kwh / case.ceiling_kwh:.1%}, {wall_s:.1f} s")
    for row in rows:
        if row.net_kwh > bound.kwh * (1 + 1e-9) + 1e-9:
            raise RuntimeError(f"{cell.name}: {row.strategy} is above the bound")
    return Result(
        cell,
        case.ceiling_kwh,
        bound.kwh,
        bound.bin_s,
        wall_s,
        outcome.open_km,
        tuple(rows),
        code_digest(),
    )


def _case(cell: Cell) -> Case:
    return build_case(_freight(cell), cell.price_kw, DispatcherSettings().sync_window_s)


def _freight(cell: Cell) -> Freight:
    if cell.place == "region":
        return region_freight(cell.window_min, cell.vehicles, _SEED)
    return corridor_freight(cell.vehicles, cell.window_min, cell.place, _SEED)


@cache
def _smallest_window(cell: Cell) -> Cell:
    if cell.price_kw == 0:
        return cell
    longest_ms = int(_case(replace(cell, window_min=max(WINDOWS_MIN))).useful_ms.max())
    for window_min in WINDOWS_MIN:
        if window_min == cell.window_min or 2 * 60 * MS * window_min > longest_ms:
            return replace(cell, window_min=window_min)
    return cell


def _stored(path: Path) -> Result | None:
    try:
        content: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if content.get("code") != code_digest():
        return None
    rows = tuple(Row(**row) for row in content["rows"])
    return Result(**{**content, "cell": Cell(**content["cell"]), "rows": rows})
