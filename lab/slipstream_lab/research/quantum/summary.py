"""Means of results over instances, with their spread."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from dispatcher_daemon.solvers import BackendKind
from slipstream_lab.research.quantum.paper import PaperRow
from slipstream_lab.research.quantum.store import Record

Mark = BackendKind | str
"""How a row's figures came about: a `BackendKind`, "classical", "estimated" or "not run"."""

FIGURES: Final = (
    "wall_s",
    "train_s",
    "sample_s",
    "p_feasible",
    "p_optimal",
    "p_feasible_descended",
    "p_optimal_descended",
    "p_feasible_repaired",
    "p_optimal_repaired",
    "two_qubit_depth",
    "two_qubit_gates",
    "energy_kwh",
    "best_cost",
)

_SAME_KWH: Final = 1e-9


@dataclass(frozen=True)
class ShareSpread:
    """Mean over instances, standard deviation between them (0 for one), least and most."""

    mean: float
    deviation: float
    least: float
    most: float
    count: int


@dataclass(frozen=True)
class Added:
    """What a circuit adds to a control: mean difference of a share over instances.

    Attributes:
        control: its name.
        figure: which share.
        control_mean: the control's mean share.
        value: mean difference.
        shot_error: its standard error by the shots alone.
        spread_error: its standard error by the instances' spread.
    """

    control: str
    figure: str
    control_mean: float
    value: float
    shot_error: float
    spread_error: float


@dataclass(frozen=True)
class Line:
    """One row of a table.

    Attributes:
        key: stable name.
        title: for people.
        mark: how it came about.
        paper: the paper's figures.
        figures: spread by name of the figure (see `FIGURES`).
        gap: relative excess of the answer's objective over the optimum.
        raw_gap: the same of the best raw sample, of the instances that have a valid one.
        raw_hits, hits: instances in which a raw sample, or the answer after all stages, is optimal.
        added: against each control.
        uniform: exact raw shares of uniform bits, means over instances; empty: not known.
        reason: why there are no figures.
    """

    key: str
    title: str
    mark: Mark
    paper: PaperRow | None
    figures: dict[str, ShareSpread]
    gap: ShareSpread | None
    raw_gap: ShareSpread | None
    raw_hits: int | None
    hits: int | None
    added: tuple[Added, ...]
    uniform: Mapping[str, float] = field(default_factory=dict)
    reason: str | None = None


def spread(values: Iterable[float | None]) -> ShareSpread | None:
    """Spread of the values that are known; None without any."""
    known = [float(value) for value in values if value is not None]
    if not known:
        return None
    mean = math.fsum(known) / len(known)
    square = math.fsum((value - mean) ** 2 for value in known)
    deviation = math.sqrt(square / (len(known) - 1)) if len(known) > 1 else 0.0
    return ShareSpread(mean, deviation, min(known), max(known), len(known))


def summarise(
    key: str, title: str, mark: Mark, paper: PaperRow | None, records: Sequence[Record]
) -> Line:
    """One line from a row's records, at least one."""

    def all_of(field: str) -> list[Any]:
        return [record.get(field) for record in records]

    def hits(field: str) -> int | None:
        pairs = list(zip(all_of(field), all_of("optimal_cost"), strict=True))
        if all(field not in record for record in records):
            return None
        return sum(
            best is not None and bool(best <= optimum + _SAME_KWH) for best, optimum in pairs
        )

    def gap(field: str) -> ShareSpread | None:
        costs = zip(all_of(field), all_of("optimal_cost"), strict=True)
        return spread(
            (cost - best) / abs(best) if cost > best + _SAME_KWH else 0.0
            for cost, best in costs
            if cost is not None
        )

    return Line(
        key=key,
        title=title,
        mark=mark,
        paper=paper,
        figures={
            figure: found for figure in FIGURES if (found := spread(all_of(figure))) is not None
        },
        gap=gap("best_cost"),
        raw_gap=gap("best_cost_raw"),
        raw_hits=hits("best_cost_raw"),
        hits=hits("best_cost"),
        added=tuple(_added(records)),
        uniform=_uniform(
            [record["uniform_exact"] for record in records if "uniform_exact" in record]
        ),
    )


def _uniform(shares: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {
        key: math.fsum(of[key] for of in shares) / len(shares) for key in next(iter(shares), ())
    }


def _added(records: Sequence[Record]) -> Iterable[Added]:
    pairs = [
        (control, figure)
        for record in records
        for control, shares in (record.get("added") or {}).items()
        for figure in shares
    ]
    for control, figure in dict.fromkeys(pairs):
        # A record whose circuit gave no samples has nothing to compare.
        having = [r for r in records if figure in (r.get("added") or {}).get(control, {})]
        found = [r["added"][control][figure] for r in having]
        over = _spread_of(lambda d: d["value"], found)
        of_control = _spread_of(
            lambda r, c=control, f=figure: r["controls"][c][f],  # type: ignore[misc]
            having,
        )
        shot = math.sqrt(math.fsum(d["standard_error"] ** 2 for d in found)) / len(found)
        yield Added(
            control=control,
            figure=figure,
            control_mean=of_control.mean,
            value=over.mean,
            shot_error=shot,
            spread_error=over.deviation / math.sqrt(over.count),
        )


def _spread_of(get: Callable[[Any], float], records: Sequence[Any]) -> ShareSpread:
    found = spread(get(record) for record in records)
    if found is None:
        raise ValueError("no records")
    return found
