"""One cell of the study: a day's trips at one price, all strategies and the bound, stored."""

from __future__ import annotations

import ast
import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

from pydantic import TypeAdapter

import slipstream_lab.research.coordination
from dispatcher_daemon.settings import DispatcherSettings
from slipstream_lab.research.coordination.bound import upper_bound
from slipstream_lab.research.coordination.case import Case, build_case
from slipstream_lab.research.coordination.corridor import WINDOWS_MIN, corridor_freight
from slipstream_lab.research.coordination.freight import MS, Freight
from slipstream_lab.research.coordination.plan import Outcome, evaluate
from slipstream_lab.research.coordination.region import region_freight
from slipstream_lab.research.coordination.strategies import STRATEGIES
from slipstream_lab.simulation.evaluation.runs import write_atomically

_Content = TypeVar("_Content", "Plans", "Bounded")

Place = Literal["one", "ten", "region"]
"""The corridor with one carrier or ten, or the region."""

OWN: Final = "local search"
"""The strategy that aims are judged by."""
NONE_KWH: Final = 1e-6
"""Less than this is nothing."""
FORMAT: Final = 2
"""Of stored cells; those of another one are made anew."""
_REPORT_MODULES: Final = ("cells", "curve", "picture")
_BOUND_MODULES: Final = ("bound", "bins")
_STRATEGY_MODULES: Final = ("strategies", "local_search", "pairwise", "threshold", "schedule")


@dataclass(frozen=True)
class Cell:
    """What is planned."""

    place: Place
    vehicles: int
    window_min: int
    price_kw: int
    seed: int = 1

    @property
    def name(self) -> str:
        """For files."""
        trips = f"{self.place}-{self.vehicles}-{self.window_min}min"
        return f"{trips}-{self.price_kw}kw-seed{self.seed}"


@dataclass(frozen=True)
class Row:
    """What one strategy reached."""

    strategy: str
    outcome: Outcome
    wall_s: float

    @property
    def net_kwh(self) -> float:
        """What strategies maximise."""
        return self.outcome.net_kwh

    @property
    def worst_carrier_kwh(self) -> float:
        """Net value of the carrier that has least; alone it is 0."""
        return min(self.outcome.carrier_kwh)

    @property
    def is_fair(self) -> bool:
        """Whether no carrier has less than alone."""
        return self.worst_carrier_kwh >= -NONE_KWH


@dataclass(frozen=True)
class Plans:
    """What all strategies reached in a cell."""

    ceiling_kwh: float
    longest_wait_s: float
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Bounded:
    """A cell's bound."""

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

    def row(self, strategy: str) -> Row:
        """What a strategy reached."""
        return next(row for row in self.plans.rows if row.strategy == strategy)

    def net_share(self, strategy: str) -> float:
        """A strategy's net value as a share of the ceiling."""
        return self.row(strategy).net_kwh / self.plans.ceiling_kwh


def measured(cell: Cell, folder: Path, say: Callable[[str], None]) -> Result:
    """A cell's result; what this code has put into the folder before is not made again.

    A window in which no trip can use all its time at the price gives the same as a shorter one that
    does, which is then measured in its place.

    Raises:
        OSError: the folder cannot be written.
        RuntimeError: a strategy above the bound.
    """
    known = found(cell, folder)
    if known is not None:
        return known
    smallest = _smallest_window(cell)
    plans, bounded = _stored_plans(smallest, folder), _stored_bound(smallest, folder)
    if plans is None:
        plans = _plan(smallest, say)
        _store(_path(smallest, folder, "plans"), plans, plans_digest())
    if bounded is None:
        bounded = _bound(smallest, say)
        _store(_path(smallest, folder, "bound"), bounded, bound_digest())
    for row in plans.rows:
        if row.net_kwh > bounded.bound_kwh * (1 + 1e-9) + 1e-9:
            raise RuntimeError(f"{smallest.name}: {row.strategy} is above the bound")
    return Result(cell, plans, bounded)


def found(cell: Cell, folder: Path) -> Result | None:
    """A cell's result if it was measured before."""
    for shorter in _no_longer_windows(cell):
        plans = _stored_plans(shorter, folder)
        if plans is not None and (shorter == cell or not _binds(shorter, plans.longest_wait_s)):
            bounded = _stored_bound(shorter, folder)
            return None if bounded is None else Result(cell, plans, bounded)
    return None


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
    for path in sorted(Path(slipstream_lab.research.coordination.__path__[0]).glob("*.py")):
        if path.stem in _REPORT_MODULES or not counts(path.stem):
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
        row = Row(name, evaluate(case, plan), wall_s)
        rows.append(row)
        say(f"{cell.name}: {name}, {row.net_kwh / case.ceiling_kwh:.1%}, {wall_s:.1f} s")
    return Plans(case.ceiling_kwh, float(case.useful_ms.max()) / MS, tuple(rows))


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
        return region_freight(cell.window_min, cell.vehicles, cell.seed)
    return corridor_freight(cell.vehicles, cell.window_min, cell.place, cell.seed)


def _smallest_window(cell: Cell) -> Cell:
    for shorter in _no_longer_windows(cell):
        if shorter == cell or not _binds(shorter, float(_case(shorter).useful_ms.max()) / MS):
            break
    return shorter


def _no_longer_windows(cell: Cell) -> list[Cell]:
    """The cell by windows of the law up to its own."""
    shorter = [w for w in WINDOWS_MIN if w < cell.window_min and cell.price_kw > 0]
    return [replace(cell, window_min=w) for w in (*shorter, cell.window_min)]


def _binds(cell: Cell, longest_wait_s: float) -> bool:
    """Whether a trip could use more time than the window leaves it."""
    return longest_wait_s >= 2 * 60 * cell.window_min


def _path(cell: Cell, folder: Path, kind: str) -> Path:
    return folder / f"{cell.name}.{kind}.json"


def _store(path: Path, content: Plans | Bounded, digest: str) -> None:
    document = {"format": FORMAT, "code": digest, **asdict(content)}
    write_atomically(path, json.dumps(document, indent=1) + "\n")


def _stored(path: Path, digest: str, kind: type[_Content]) -> _Content | None:
    try:
        document = TypeAdapter(dict[str, Any]).validate_json(path.read_bytes())
        if (document.pop("format", None), document.pop("code", None)) != (FORMAT, digest):
            return None
        return TypeAdapter(kind).validate_python(document)
    except (OSError, ValueError):
        return None


def _stored_plans(cell: Cell, folder: Path) -> Plans | None:
    return _stored(_path(cell, folder, "plans"), plans_digest(), Plans)


def _stored_bound(cell: Cell, folder: Path) -> Bounded | None:
    return _stored(_path(cell, folder, "bound"), bound_digest(), Bounded)
