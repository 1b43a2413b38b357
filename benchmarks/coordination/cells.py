"""One cell of the table: a day's trips at one price, all strategies and the bound."""

from __future__ import annotations

import ast
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
_BOUND_MODULES: Final = ("bound", "bins")
_STRATEGY_MODULES: Final = ("strategies", "local_search", "pairwise", "threshold", "schedule")


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
class Plans:
    """What all strategies reached in a cell.

    Attributes:
        ceiling_kwh: saving if everybody were a follower all the way.
        open_km: driven where platoons may.
        rows: one a strategy.
    """

    ceiling_kwh: float
    open_km: float
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Bounded:
    """A cell's bound.

    Attributes:
        bound_kwh: no plan's net value is above it.
        bin_s: its bins.
        wall_s: time that it took.
    """

    bound_kwh: float
    bin_s: float
    wall_s: float


@dataclass(frozen=True)
class Result:
    """A cell with what came out."""

    cell: Cell
    plans: Plans
    bounded: Bounded

    @property
    def best(self) -> Row:
        """Of the highest net value."""
        return max(self.plans.rows, key=lambda row: row.net_kwh)

    @property
    def bound_share(self) -> float:
        """The bound as a share of the ceiling."""
        return self.bounded.bound_kwh / self.plans.ceiling_kwh


def measured(cell: Cell, folder: Path, say: Callable[[str], None]) -> Result:
    """A cell's result; what this code has put into the folder before is not made again.

    A window in which no trip can use all its time at the price gives the same as a shorter one that
    does, which is then measured in its place.

    Raises:
        RuntimeError: a strategy above the bound.
    """
    smallest = _smallest_window(cell)
    plans, bounded = _stored_plans(smallest, folder), _stored_bound(smallest, folder)
    if plans is None:
        plans = _plan(smallest, say)
        _store(_path(smallest, folder, "plans"), asdict(plans), plans_digest())
    if bounded is None:
        bounded = _bound(smallest, say)
        _store(_path(smallest, folder, "bound"), asdict(bounded), bound_digest())
    for row in plans.rows:
        if row.net_kwh > bounded.bound_kwh * (1 + 1e-9) + 1e-9:
            raise RuntimeError(f"{smallest.name}: {row.strategy} is above the bound")
    return Result(cell, plans, bounded)


def found(cell: Cell, folder: Path) -> Result | None:
    """A cell's result if it was measured before."""
    smallest = _smallest_window(cell)
    plans, bounded = _stored_plans(smallest, folder), _stored_bound(smallest, folder)
    return None if plans is None or bounded is None else Result(cell, plans, bounded)


@cache
def plans_digest() -> str:
    """Of the code that plans depend on, but for comments and docstrings."""
    return _digest(lambda name: name not in _BOUND_MODULES)


@cache
def bound_digest() -> str:
    """Of the code that bounds depend on."""
    return _digest(lambda name: name not in _STRATEGY_MODULES)


def _digest(counts: Callable[[str], bool]) -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(research.coordination.__path__[0]).glob("*.py")):
        if not counts(path.stem):
            continue
        tree = ast.parse(path.read_bytes())
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                node.body = [part for part in body if not _is_text(part)]  # type: ignore[attr-defined]
        digest.update(ast.dump(tree).encode())
    return digest.hexdigest()[:16]


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _plan(cell: Cell, say: Callable[[str], None]) -> Plans:
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
    return Plans(case.ceiling_kwh, outcome.open_km, tuple(rows))


def _bound(cell: Cell, say: Callable[[str], None]) -> Bounded:
    case = _case(cell)
    began = time.perf_counter()
    bound = upper_bound(case)
    wall_s = time.perf_counter() - began
    say(f"{cell.name}: bound, {bound.kwh / case.ceiling_kwh:.1%}, {wall_s:.1f} s")
    return Bounded(bound.kwh, bound.bin_s, wall_s)


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


def _path(cell: Cell, folder: Path, kind: str) -> Path:
    return folder / f"{cell.name}.{kind}.json"


def _store(path: Path, content: Mapping[str, Any], digest: str) -> None:
    draft = path.with_suffix(".part")
    draft.write_text(json.dumps({"code": digest, **content}, indent=1) + "\n", encoding="utf-8")
    draft.replace(path)


def _stored(path: Path, digest: str) -> dict[str, Any] | None:
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if content.pop("code", None) == digest else None


def _stored_plans(cell: Cell, folder: Path) -> Plans | None:
    content = _stored(_path(cell, folder, "plans"), plans_digest())
    if content is None:
        return None
    return Plans(**{**content, "rows": tuple(Row(**row) for row in content["rows"])})


def _stored_bound(cell: Cell, folder: Path) -> Bounded | None:
    content = _stored(_path(cell, folder, "bound"), bound_digest())
    return None if content is None else Bounded(**content)
