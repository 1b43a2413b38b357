"""Cells and notes that several tables have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean
from typing import Final

from slipstream_lab.simulation.evaluation.arms import BASELINE, EVERY_LEVER
from slipstream_lab.simulation.evaluation.measures import (
    Compared,
    Evaluation,
    Headline,
    Measures,
    SeedSpread,
)
from slipstream_lab.simulation.evaluation.report.formatting import (
    NOTHING,
    join_names,
    number,
    percent,
)
from slipstream_lab.simulation.evaluation.runs import Provenance

AT_OWN_TIME: Final = " at its own travel time"
"""Of a saving that is not to be quoted: driving slower has its part in it."""

MEANS: Final = "Means over the seeds ± standard deviation between them."
EQUAL_TIME: Final = (
    "Savings are between arms that served the same orders and whose vehicles are all at home. At "
    "equal travel time: against what B needs for each order when it is slowed or hurried to the "
    "arm's travel time, between paces that were simulated. Only that is a saving to quote."
)


def mean_s(waits_s: Sequence[float]) -> float | None:
    """Mean of some waits; None of none."""
    return fmean(waits_s) if waits_s else None


WAITS: Final[tuple[tuple[Callable[[Measures], float | None], int], ...]] = (
    (lambda m: mean_s(m.waits_s), 0),
    (lambda m: mean_s(m.depot_waits_s), 0),
    (lambda m: mean_s(m.stop_waits_s), 0),
    (lambda m: max(m.waits_s, default=None), 0),
    (lambda m: m.driving_h, 2),
    (lambda m: m.travel_h, 2),
)
"""Figures of waits, each with its digits."""
WAIT_HEADS: Final = (
    *("mean wait of a leg, s", "at the depot", "at stops", "longest, s"),
    *("driving, h", "with waits, h"),
)
WAITS_NOTE: Final = (
    "Waits: from when a leg could begin until its vehicle came onto the road, for other vehicles "
    "or for a gap in the traffic. No fleet of the scenarios has hubs."
)


def saving(evaluation: Evaluation, name: str, of: Callable[[Compared], float | None]) -> str:
    """A saving, of any arm but the baseline itself."""
    return NOTHING if name == BASELINE else percent(evaluation.against(name, of), 2)


def equal_time(evaluation: Evaluation, name: str) -> str:
    """The saving at equal time, of any arm but the baseline itself."""
    return saving(evaluation, name, lambda c: c.at_equal_time)


def saving_lost(evaluation: Evaluation, name: str, of: Callable[[Compared], float | None]) -> str:
    """Points of saving that the arm with every lever has more than another, seed by seed."""
    every, rest = evaluation.compared.get(EVERY_LEVER, {}), evaluation.compared.get(name, {})
    points = [
        100 * (mine - other)
        for seed in every
        if seed in rest
        and (mine := of(every[seed])) is not None
        and (other := of(rest[seed])) is not None
    ]
    found = SeedSpread.over(points)
    return NOTHING if found is None else f"{number(found, 2, sign=True)} points"


def arm_files(evaluation: Evaluation, names: Iterable[str]) -> str:
    """The files of arms, seeds in braces as a shell writes them."""
    said = []
    for name in dict.fromkeys(names):
        seeds = [str(s) for s, m in evaluation.runs.get(name, {}).items() if not m.faults]
        if seeds:
            inside = seeds[0] if len(seeds) == 1 else "{" + ",".join(seeds) + "}"
            said.append(f"`arms/{name}-{inside}.json`")
    return ", ".join(said)


def arm_rows_source(evaluation: Evaluation) -> str:
    """The files of a table with an arm a row."""
    lacking = any(len(of_seed) < len(evaluation.seeds) for of_seed in evaluation.runs.values())
    some = " that are there and sound" if lacking or evaluation.refused else ""
    seeds = join_names(evaluation.seeds)
    return f"`arms/ARM-SEED.json` of each row's ARM and the seeds {seeds}{some}"


def missing_notes(evaluation: Evaluation, names: Iterable[str]) -> tuple[str, ...]:
    """Why arms have no saving in some seeds, where they have none."""
    lines = [
        f"{name}: {words}"
        for name in dict.fromkeys(names)
        if name != BASELINE and (words := why_missing(evaluation.headline(name)))
    ]
    return (f"**No saving at equal travel time.** {'; '.join(lines)}.",) if lines else ()


def why_missing(headline: Headline) -> str:
    """Seeds that have no saving at equal travel time, by reason."""
    return by_reason(headline.missing)


def by_reason(reasons: Mapping[int, str]) -> str:
    """Reasons in words, each once with its seeds."""
    seeds: dict[str, list[int]] = {}
    for seed, reason in sorted(reasons.items()):
        seeds.setdefault(reason, []).append(seed)
    return "; ".join(
        f"seed{'s' if len(of) > 1 else ''} {join_names(of)}: {reason}"
        for reason, of in seeds.items()
    )


def prices(provenance: Provenance) -> str:
    """What waiting for other vehicles costs in an evaluation, in words."""
    at_depot, at_stops = provenance.waiting_kw, provenance.standing_kw
    if at_depot is None and at_stops is None:
        return "what slower driving would save"
    driving = "as driving time"
    depot = driving if at_depot is None else f"{at_depot:g} kW"
    stops = f"{driving} or {depot}, whichever is more" if at_depot is not None else driving
    if at_stops is not None:
        stops = f"{at_stops:g} kW"
    return f"{depot} at depots, {stops} at stops"
