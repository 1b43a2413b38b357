"""One cell of the study: a day's trips at one price, all strategies and the bound, stored."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import TypeAdapter

from dispatcher_daemon.settings import DispatcherSettings
from slipstream.sources import sources_digest
from slipstream_lab.research.coordination.bound import upper_bound
from slipstream_lab.research.coordination.case import CoordinationCase, build_case
from slipstream_lab.research.coordination.plan import PlanOutcome, evaluate
from slipstream_lab.research.coordination.strategies import STRATEGIES
from slipstream_lab.research.coordination.trips.corridor import WINDOWS_MIN, scenario_freight
from slipstream_lab.research.coordination.trips.freight import MS, Freight
from slipstream_lab.research.coordination.trips.region import region_freight
from slipstream_lab.simulation.evaluation.runs import WorldFiles, write_atomically
from slipstream_lab.simulation.scenarios.scenario import Scenario, load_scenario

Place = Literal["one", "ten", "region"]
"""A scenario's roads with one carrier or ten, or the region."""

OWN: Final = "local search"
"""The strategy that aims are judged by."""
NONE_KWH: Final = 1e-6
"""Less than this is nothing."""
FORMAT: Final = 3
"""Of stored cells; those of another one are made anew."""
_PACKAGE: Final = "slipstream_lab.research.coordination"
_REPORTS: Final = tuple(f"{_PACKAGE}/{module}.py" for module in ("cells", "curve", "picture"))


@dataclass(frozen=True)
class CoordinationCell:
    """What is planned. `world`: another one than the corridor."""

    place: Place
    vehicles: int
    window_min: int
    price_kw: int
    seed: int = 1
    world: WorldFiles | None = None

    @property
    def name(self) -> str:
        """For files."""
        trips = f"{self.place}-{self.vehicles}-{self.window_min}min"
        return f"{trips}-{self.price_kw}kw-seed{self.seed}"


@dataclass(frozen=True)
class StrategyRow:
    """What one strategy reached."""

    strategy: str
    outcome: PlanOutcome
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
    rows: tuple[StrategyRow, ...]


@dataclass(frozen=True)
class Bounded:
    """A cell's bound."""

    bound_kwh: float
    bin_s: float
    wall_s: float


@dataclass(frozen=True)
class CellResult:
    """A cell with what came out."""

    cell: CoordinationCell
    plans: Plans
    bounded: Bounded

    @property
    def best(self) -> StrategyRow:
        """Of the highest net value."""
        return max(self.plans.rows, key=lambda row: row.net_kwh)

    @property
    def bound_share(self) -> float:
        """The bound as a share of the ceiling."""
        return self.bounded.bound_kwh / self.plans.ceiling_kwh

    def row(self, strategy: str) -> StrategyRow:
        """What a strategy reached."""
        return next(row for row in self.plans.rows if row.strategy == strategy)

    def net_share(self, strategy: str) -> float:
        """A strategy's net value as a share of the ceiling."""
        return self.row(strategy).net_kwh / self.plans.ceiling_kwh


def measured(cell: CoordinationCell, folder: Path, say: Callable[[str], None]) -> CellResult:
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
    plans, bounded = _plan(smallest, say), _bound(smallest, say)
    for row in plans.rows:
        if row.net_kwh > bounded.bound_kwh * (1 + 1e-9) + 1e-9:
            raise RuntimeError(f"{smallest.name}: {row.strategy} is above the bound")
    result = CellResult(smallest, plans, bounded)
    document = {"format": FORMAT, "code": _code(smallest.world), **asdict(result)}
    text = json.dumps(document, indent=1, default=str)  # paths
    write_atomically(_path(smallest, folder), text + "\n")
    return replace(result, cell=cell)


def found(cell: CoordinationCell, folder: Path) -> CellResult | None:
    """The result of a cell if it is stored; by a shorter window if that has the same plans."""
    for shorter in _no_longer_windows(cell):
        stored = _stored(_path(shorter, folder), _code(cell.world))
        if stored is not None and (
            shorter == cell or not _binds(shorter, stored.plans.longest_wait_s)
        ):
            return replace(stored, cell=cell)
    return None


@cache
def _code(world: WorldFiles | None) -> str:
    """Digest of the code that plans and bounds are made by, and of the world's files."""
    code = sources_digest((_PACKAGE,), _REPORTS)[:16]
    if world is None:
        return code
    scenario = _scenario(world)
    said = sha256(scenario.net.read_bytes())
    for part in (scenario.demand, scenario.fleet):
        said.update(part.digest_text().encode())
    said.update(repr(scenario.rsus).encode())
    return f"{code}-{said.hexdigest()[:16]}"


def _plan(cell: CoordinationCell, say: Callable[[str], None]) -> Plans:
    case = _case(cell)
    rows = []
    for name, strategy in STRATEGIES.items():
        began = time.perf_counter()
        plan = strategy(case)
        wall_s = time.perf_counter() - began
        row = StrategyRow(name, evaluate(case, plan), wall_s)
        rows.append(row)
        say(f"{cell.name}: {name}, {row.net_kwh / case.ceiling_kwh:.1%}, {wall_s:.1f} s")
    return Plans(case.ceiling_kwh, float(case.useful_ms.max()) / MS, tuple(rows))


def _bound(cell: CoordinationCell, say: Callable[[str], None]) -> Bounded:
    case = _case(cell)
    began = time.perf_counter()
    bound = upper_bound(case)
    wall_s = time.perf_counter() - began
    say(f"{cell.name}: bound, {bound.kwh / case.ceiling_kwh:.1%}, {wall_s:.1f} s")
    return Bounded(bound.kwh, bound.bin_s, wall_s)


def _case(cell: CoordinationCell) -> CoordinationCase:
    return build_case(_freight(cell), cell.price_kw, DispatcherSettings().sync_window_s)


def _freight(cell: CoordinationCell) -> Freight:
    if cell.place == "region":
        return region_freight(cell.window_min, cell.vehicles, cell.seed)
    scenario = _scenario(cell.world)
    return scenario_freight(scenario, cell.vehicles, cell.window_min, cell.place, cell.seed)


@cache
def _scenario(world: WorldFiles | None) -> Scenario:
    return load_scenario("corridor") if world is None else world.load()


def _smallest_window(cell: CoordinationCell) -> CoordinationCell:
    for shorter in _no_longer_windows(cell):
        if shorter == cell or not _binds(shorter, float(_case(shorter).useful_ms.max()) / MS):
            break
    return shorter


def _no_longer_windows(cell: CoordinationCell) -> list[CoordinationCell]:
    """The cell by windows of the law up to its own."""
    shorter = [w for w in WINDOWS_MIN if w < cell.window_min and cell.price_kw > 0]
    return [replace(cell, window_min=w) for w in (*shorter, cell.window_min)]


def _binds(cell: CoordinationCell, longest_wait_s: float) -> bool:
    """Whether a trip could use more time than the window leaves it."""
    return longest_wait_s >= 2 * 60 * cell.window_min


def _path(cell: CoordinationCell, folder: Path) -> Path:
    return folder / f"{cell.name}.json"


def _stored(path: Path, code: str) -> CellResult | None:
    """What a file has; None where it is missing, damaged or of another format or code."""
    try:
        document = TypeAdapter(dict[str, Any]).validate_json(path.read_bytes())
        if (document.pop("format", None), document.pop("code", None)) != (FORMAT, code):
            return None
        return TypeAdapter(CellResult).validate_python(document)
    except (OSError, ValueError):
        return None
