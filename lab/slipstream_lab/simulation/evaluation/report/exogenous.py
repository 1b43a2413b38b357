"""Tables of the exogenous evaluation, beside the closed loop's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from slipstream.energy.consumption import ETA_FOLLOWER
from slipstream_lab.simulation.evaluation.arms import BASELINE, COOPERATIVE, gated
from slipstream_lab.simulation.evaluation.measures import Evaluation, Measures
from slipstream_lab.simulation.evaluation.report.ablation_tables import noise_table
from slipstream_lab.simulation.evaluation.report.cells import (
    AT_OWN_TIME,
    arm_files,
    by_reason,
    saving,
)
from slipstream_lab.simulation.evaluation.report.formatting import (
    NOTHING,
    ReportTable,
    count,
    number,
    percent,
)
from slipstream_lab.simulation.evaluation.report.paper import (
    PAPER_BASELINE,
    PAPER_COOPERATIVE,
    PaperDay,
)


def exogenous_tables(
    closed: Evaluation | None, rsus: Evaluation, everywhere: Evaluation
) -> tuple[ReportTable, ...]:
    """The paper's tables by the paper's way of evaluating, beside the closed loop."""
    tables = [_day_table(closed, rsus, everywhere)]
    noise = noise_table(rsus)
    if noise is not None:
        tables.append(
            replace(
                noise,
                title="Noise on the features, exogenous",
                source=noise.source.replace("`arms/", "`exogenous-rsus/arms/"),
            )
        )
    return tuple(tables)


def _day_table(closed: Evaluation | None, rsus: Evaluation, everywhere: Evaluation) -> ReportTable:
    columns = [
        (f"{where}: {name}", study, name)
        for where, study, names in (
            ("RSUs", rsus, (BASELINE, COOPERATIVE, gated("open"), gated("random"))),
            ("everywhere", everywhere, (BASELINE, COOPERATIVE, gated("open"))),
            ("closed loop", closed, (BASELINE, COOPERATIVE)),
        )
        if study is not None
        for name in names
        if name in study
    ]

    def row(
        what: str,
        paper: Callable[[PaperDay], str],
        ours: Callable[[Evaluation, str], str],
    ) -> tuple[str, ...]:
        papers = (PAPER_BASELINE, PAPER_COOPERATIVE)
        return (what, *map(paper, papers), *(ours(study, name) for _, study, name in columns))

    def of(what: Callable[[Measures], float], digits: int = 1) -> Callable[[Evaluation, str], str]:
        return lambda study, name: number(study.figure(name, what), digits)

    rows = (
        row("distance, km", lambda p: f"{p.distance_km:,.1f}", of(lambda m: m.distance_km)),
        row("travel time, h", lambda p: f"{p.travel_h:.1f}", of(lambda m: m.travel_h, 2)),
        row("platooned, km", lambda p: f"{p.platooned_km:.1f}", of(lambda m: m.platooned_km)),
        row(
            "platooned, share of the distance",
            lambda p: percent(p.platooned_km / p.distance_km),
            lambda study, name: percent(study.figure(name, lambda m: m.platooned_share)),
        ),
        row("energy, kWh", lambda p: f"{p.energy_kwh:.1f}", of(lambda m: m.energy_kwh)),
        row(
            f"energy saved{AT_OWN_TIME}",
            lambda p: percent(p.saving),
            lambda study, name: saving(study, name, lambda c: c.saving),
        ),
        row(
            "of it by drag",
            lambda _: NOTHING,
            lambda study, name: saving(study, name, lambda c: c.shares.drag_kwh),
        ),
        row(
            "gates open, of those judged",
            lambda _: NOTHING,
            lambda study, name: percent(study.figure(name, lambda m: m.open_share)),
        ),
        row(
            "platoons in turbulence, one count a segment",
            lambda p: "0" if p.platooned_km else NOTHING,
            lambda study, name: count(study.figure(name, lambda m: m.disengagements)),
        ),
    )
    sources = [
        arm_files(study, names).replace("`arms/", f"`{prefix}arms/")
        for prefix, study, names in (
            ("exogenous-rsus/", rsus, rsus.runs),
            ("exogenous-everywhere/", everywhere, everywhere.runs),
            ("", closed, (BASELINE, COOPERATIVE)),
        )
        if study is not None
    ]
    return ReportTable(
        "The paper's way: on traffic that the fleet does not change",
        ("", "paper: baseline", "paper: cooperative", *(head for head, _, _ in columns)),
        rows,
        f"{'; '.join(sources)}; the paper's from its table "
        '"24-Hour Microscopic Fleet Simulation Summary"',
        (
            "Exogenous: every leg at the speeds that the background had on each segment in the "
            "five minutes in which it began; signals are in those speeds, not in the drive, so "
            "stops cost time there and no energy. RSUs: gates on the segments that the scenario's "
            "RSUs watch. Everywhere: on every segment with 60 m and more before its queue. "
            "Platoons: within the synchronization window at the times driven, on gates as they "
            "are then; no distance to form up, no one in between.",
            *_drag_note(rsus),
            *(
                f"{where}: no saving of {name}; {by_reason(study.apart[name])}."
                for where, study in (("RSUs", rsus), ("everywhere", everywhere))
                for name in study.runs
                if study.apart.get(name)
            ),
        ),
    )


def _drag_note(study: Evaluation) -> tuple[str, ...]:
    """What the paper's platooned distance can save by drag alone."""
    drag = study.figure(BASELINE, lambda m: m.driven.drag_kwh / m.energy_kwh)
    if drag is None:
        return ()
    share = PAPER_COOPERATIVE.platooned_km / PAPER_COOPERATIVE.distance_km
    return (
        f"Drag is {percent(drag.mean)} of the baseline's energy. With the paper's "
        f"{percent(share)} of the distance in platoons, and everybody there following, drafting "
        f"saves {percent(share * ETA_FOLLOWER * drag.mean, 2)}.",
    )
