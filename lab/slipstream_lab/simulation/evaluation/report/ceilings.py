"""Tables of what could be saved at best, and of how much of it each lever reaches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from slipstream.energy.drafting import greatest_reduction
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.evaluation.arms import BASELINE, COOPERATIVE, EVERY_LEVER, only
from slipstream_lab.simulation.evaluation.measures import (
    Ceilings,
    Compared,
    Evaluation,
    SeedSpread,
    compute_ceilings,
    share_of_ceiling,
)
from slipstream_lab.simulation.evaluation.report.cells import MEANS, arm_files
from slipstream_lab.simulation.evaluation.report.formatting import NOTHING, ReportTable, percent
from slipstream_lab.simulation.evaluation.report.proximity import proximity_table

_CEILINGS: Final = (
    ("every kilometre drafted", "drafting", None),
    (
        "no signals or traffic, at the limit",
        "no signals or traffic",
        "no signals or traffic, drafting",
    ),
    (
        "no signals or traffic, in the same time",
        "the same in the same time",
        "the same in the same time, drafting",
    ),
    ("no braking at all, in the same time", "no braking", "no braking, drafting"),
)
"""(Words, key of `Ceilings.savings` alone, key drafted)."""


@dataclass(frozen=True)
class _Reach:
    """A saving and the ceiling that it is held against."""

    words: str
    arm: str
    of: Callable[[Compared], float | None]
    ceiling: str


def _drag(compared: Compared) -> float:
    return compared.shares.drag_kwh


def _equal(compared: Compared) -> float | None:
    return compared.at_equal_time


_REACHES: Final = (
    _Reach("platoons alone, by drag", only("platoons"), _drag, "drafting"),
    _Reach("C, by drag", COOPERATIVE, _drag, "drafting"),
    _Reach("C+, by drag", EVERY_LEVER, _drag, "drafting"),
    _Reach("departures alone", only("departures"), _equal, "the same in the same time"),
    _Reach("eco-approach alone", only("eco_approach"), _equal, "the same in the same time"),
    _Reach("priority alone", only("priority"), _equal, "the same in the same time"),
    _Reach("coasting alone", only("coasting"), _equal, "no braking"),
    _Reach("C", COOPERATIVE, _equal, "no braking, drafting"),
    _Reach("C+", EVERY_LEVER, _equal, "no braking, drafting"),
)


def ceiling_tables(evaluation: Evaluation, roads: RoadNetwork) -> tuple[ReportTable, ...]:
    """What the baseline's legs would cost at best, where their energy goes, and the levers' shares
    of it; nothing where there is no sound baseline.
    """
    fit = evaluation.results(BASELINE)
    if not fit:
        return ()
    kind = evaluation.provenance.vehicle_type
    best = {seed: compute_ceilings(result, roads, kind) for seed, result in fit.items()}
    lengths_m = {name: segment.length_m for name, segment in roads.segments.items()}
    together = proximity_table(evaluation, lengths_m)
    return (
        _ceiling_table(evaluation, best),
        *_reach_table(evaluation, best),
        *(() if together is None else (together,)),
    )


def _ceiling_table(evaluation: Evaluation, best: Mapping[int, Ceilings]) -> ReportTable:
    saved = {seed: found.savings() for seed, found in best.items()}

    def over(key: str | None) -> str:
        return (
            NOTHING
            if key is None
            else percent(SeedSpread.over([s[key] for s in saved.values()]), 1)
        )

    most = greatest_reduction(evaluation.provenance.vehicle_type.drafting)
    slower = SeedSpread.over([f.free.travel_s / f.driven.travel_s - 1 for f in best.values()])
    time = {"no signals or traffic": percent(slower, 1, sign=True)}
    rows = tuple(
        (
            words,
            NOTHING if alone == "drafting" else over(alone),
            over("drafting" if alone == "drafting" else drafted),
            time.get(alone, percent(0.0)),
        )
        for words, alone, drafted in _CEILINGS
    )
    return ReportTable(
        "Ceilings: what B's legs could save at best",
        ("", "alone", "every kilometre drafted", "travel time"),
        rows,
        f"{arm_files(evaluation, [BASELINE])}, by `simulation.evaluation.measures.ceilings`",
        (
            f"{MEANS} On the baseline's own paths. Drafted: {100 * most:.0f} % less drag for "
            "everybody all the way, as if nobody led. No signals or traffic: empty roads, with "
            "turns, lower limits and deliveries. No braking: each leg at its mean speed from end "
            "to end, the least that its distance can cost in its time; deliveries cost nothing "
            "there, so nobody gets near it.",
        ),
    )


def _reach_table(evaluation: Evaluation, best: Mapping[int, Ceilings]) -> tuple[ReportTable, ...]:
    rows, names = [], [BASELINE]
    for reach in _REACHES:
        found = {
            seed: value
            for seed, compared in evaluation.compared.get(reach.arm, {}).items()
            if seed in best and (value := reach.of(compared)) is not None
        }
        if not found:
            continue
        limits = {seed: best[seed].savings()[reach.ceiling] for seed in found}
        shares = [
            share
            for seed, saving in found.items()
            if (share := share_of_ceiling(saving, limits[seed])) is not None
        ]
        names.append(reach.arm)
        rows.append(
            (
                reach.words,
                percent(SeedSpread.over(list(found.values())), 2, sign=True),
                reach.ceiling,
                percent(SeedSpread.over(list(limits.values()))),
                percent(SeedSpread.over(shares)),
            )
        )
    if not rows:
        return ()
    return (
        ReportTable(
            "Levers as shares of their ceilings",
            ("lever", "saving", "ceiling", "at most", "reached"),
            tuple(rows),
            f"{arm_files(evaluation, names)}, and the ceilings above",
            (
                "Savings by drag are those of the same drives without drafting, as a share of B; "
                'the others are at equal travel time. "The same" is no signals or traffic. '
                "Routes have no ceiling here: it keeps the baseline's paths.",
            ),
        ),
    )
