"""Cells and notes that several tables have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from statistics import fmean
from typing import Final

from simulation.evaluation.arms import BASELINE, EVERY_LEVER
from simulation.evaluation.measures import Compared, Evaluation, Measures, Spread
from simulation.evaluation.report.formatting import NOTHING, join_names, number, percent
from simulation.evaluation.runs import Provenance

_SLOWER: Final = "†"
_FASTER: Final = "‡"

MEANS: Final = "Means over the seeds ± standard deviation between them."
EQUAL_TIME: Final = (
    "At equal travel time: against what B needs for each served order when it is slowed or hurried "
    "to the arm's travel time."
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
    """The saving at equal time, marked where the baseline was not simulated that slow or fast."""
    if name == BASELINE:
        return NOTHING
    beyond = {c.extrapolated for c in evaluation.compared.get(name, {}).values()}
    marks = (_SLOWER if "slower" in beyond else "") + (_FASTER if "faster" in beyond else "")
    return percent(evaluation.against(name, lambda c: c.at_equal_time), 2) + marks


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
    found = Spread.over(points)
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


def range_notes(evaluation: Evaluation, names: Iterable[str]) -> tuple[str, ...]:
    """What the marks of extrapolated comparisons mean, where there are any."""
    beyond = {c.extrapolated for n in names for c in evaluation.compared.get(n, {}).values()}
    notes = []
    if "slower" in beyond:
        notes.append(
            f"{_SLOWER} Slower than the slowest baseline in some seed: its curve is extrapolated."
        )
    if "faster" in beyond:
        notes.append(
            f"{_FASTER} Faster than the fastest baseline in some seed: held against the fastest."
        )
    return tuple(notes)


def order_notes(evaluation: Evaluation, names: Iterable[str]) -> tuple[str, ...]:
    """A warning where arms did not serve as many orders as the baseline."""
    unlike = [
        name
        for name in names
        if any(not c.same_orders for c in evaluation.compared.get(name, {}).values())
    ]
    if not unlike:
        return ()
    return (
        f"**Not as many orders served as by B in every seed: {join_names(unlike)}.** There totals "
        "do not compare; the saving per order and at equal travel time do.",
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
