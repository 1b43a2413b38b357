"""Evaluations of one fleet by density: share of the drafting ceiling, planned and driven."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from slipstream_lab.simulation.evaluation.arms import BASELINE, COOPERATIVE
from slipstream_lab.simulation.evaluation.measures import Evaluation, Measures, SeedSpread
from slipstream_lab.simulation.evaluation.report.cells import (
    AT_OWN_TIME,
    EQUAL_TIME,
    MEANS,
    WAIT_HEADS,
    WAITS,
    WAITS_NOTE,
    missing_notes,
    prices,
)
from slipstream_lab.simulation.evaluation.report.formatting import (
    ReportTable,
    count,
    number,
    percent,
)
from slipstream_lab.simulation.fleet.drafting import CAUSES

_Figure = Callable[[Measures], float | None]


def _planned_share(found: Measures) -> float:
    return found.planned_drafting_kwh / found.ceiling_kwh


def _driven_share(found: Measures) -> float:
    return found.drafted_kwh / found.ceiling_kwh


def _kept(found: Measures) -> float | None:
    planned = found.planned_drafting_kwh
    return found.drafted_kwh / planned if planned > 0 else None


_Spreads = dict[int, SeedSpread | None]


def density_shares(evaluations: Mapping[int, Evaluation]) -> tuple[_Spreads, _Spreads]:
    """(Planned, driven) share of the drafting ceiling of the cooperative arm."""
    shown = _with_cooperative(evaluations)
    return (
        {n: e.figure(COOPERATIVE, _planned_share) for n, e in shown.items()},
        {n: e.figure(COOPERATIVE, _driven_share) for n, e in shown.items()},
    )


def density_tables(evaluations: Mapping[int, Evaluation]) -> tuple[ReportTable, ...]:
    """What the cooperative arm planned and drove, and why not all of it."""
    shown = _with_cooperative(evaluations)
    source = f"arm {COOPERATIVE} of `density-N/arms.csv`"

    def rows(*columns: tuple[Callable[..., str], _Figure]) -> tuple[tuple[str, ...], ...]:
        return tuple(
            (str(n), *(words(e.figure(COOPERATIVE, of)) for words, of in columns))
            for n, e in shown.items()
        )

    def km(found: SeedSpread | None) -> str:
        return number(found, 1)

    def kwh(found: SeedSpread | None) -> str:
        return number(found, 2)

    reached = rows(
        (count, lambda m: float(m.legs)),
        (km, lambda m: m.distance_km),
        (kwh, lambda m: m.ceiling_kwh),
        (percent, _planned_share),
        (percent, _driven_share),
        (percent, _kept),
        (km, lambda m: m.planned_platooned_km),
        (km, lambda m: m.platooned_km),
        (count, lambda m: float(m.disengagements)),
        (count, lambda m: float(m.late)),
    )
    saved = tuple(
        (
            percent(e.against(COOPERATIVE, lambda c: c.saving), 2),
            percent(e.against(COOPERATIVE, lambda c: c.travel), 1, sign=True),
            percent(e.against(COOPERATIVE, lambda c: c.at_equal_time), 2),
        )
        for e in shown.values()
    )
    heads = (
        *("vehicles a day", "legs", "km", "drafting ceiling, kWh", "planned", "driven"),
        *("driven of planned", "planned in platoons, km", "driven in platoons, km"),
        *("forced apart", "late", f"saved{AT_OWN_TIME}", "travel time"),
        "saved at equal travel time",
    )
    return (
        ReportTable(
            "Driven: share of the drafting ceiling by density",
            heads,
            tuple((*row, *more) for row, more in zip(reached, saved, strict=True)),
            source,
            (
                f"{MEANS} Ceiling: everybody a follower all the way. Planned: by the newest plan "
                f"of each vehicle, at planned speeds. Saved: all of {COOPERATIVE} against "
                f"{BASELINE}. {EQUAL_TIME}",
                *(
                    f"{n} vehicles a day: {note}"
                    for n, e in shown.items()
                    for note in missing_notes(e, [COOPERATIVE])
                ),
            ),
        ),
        ReportTable(
            "Driven: waits",
            ("vehicles a day", *WAIT_HEADS, "late"),
            rows(
                *((partial(number, digits=digits), of) for of, digits in WAITS),
                (count, lambda m: float(m.late)),
            ),
            source,
            (WAITS_NOTE, *_priced(shown)),
        ),
        ReportTable(
            "Planned in a platoon and not driven in one, km",
            ("vehicles a day", *CAUSES),
            rows(*((km, lambda m, cause=cause: m.missed_km[cause]) for cause in CAUSES)),
            source,
            (
                "By the plan that was in force. Gates: not open, or parting before one. Apart: "
                "partners that have not met, as one left or drove late.",
            ),
        ),
    )


def _priced(shown: Mapping[int, Evaluation]) -> tuple[str, ...]:
    """What waiting costs; the same at all densities."""
    said = {prices(evaluation.provenance) for evaluation in shown.values()}
    return tuple(f"An hour of waiting for others costs {words}." for words in sorted(said))


def _with_cooperative(evaluations: Mapping[int, Evaluation]) -> dict[int, Evaluation]:
    """Those that have the arm, rising."""
    return {n: e for n, e in sorted(evaluations.items()) if COOPERATIVE in e}
