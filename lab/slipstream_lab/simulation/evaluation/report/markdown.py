"""The report of an evaluation in Markdown: every number with the files that it comes from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from slipstream_lab.simulation.evaluation.arms import (
    BASELINE,
    COOPERATIVE,
    EVERY_LEVER,
    INSTALLED,
    INSTALLED_PRIORITY,
)
from slipstream_lab.simulation.evaluation.measures import Evaluation, no_platoons
from slipstream_lab.simulation.evaluation.report.ablation_tables import (
    gating_table,
    lever_table,
    noise_table,
)
from slipstream_lab.simulation.evaluation.report.cells import (
    by_reason,
    equal_time,
    prices,
    why_missing,
)
from slipstream_lab.simulation.evaluation.report.formatting import (
    ReportTable,
    as_markdown,
    join_names,
    number,
    percent,
)
from slipstream_lab.simulation.evaluation.report.tables import (
    day_table,
    driving_table,
    energy_table,
    losses_table,
    parts_table,
    safety_table,
    waits_table,
)
from slipstream_lab.simulation.fleet.safety import MAX_TELEPORTED, OthersSafety
from slipstream_lab.simulation.scenarios.acceptance import clock

_NO_PLATOON: Final = "Nobody drove in a platoon"


def report(
    evaluation: Evaluation,
    pictures: Sequence[str],
    missing: str | None,
    more: Sequence[ReportTable] = (),
    made_up: Sequence[str] = (),
) -> str:
    """The whole report."""
    tables = (
        day_table(evaluation),
        energy_table(evaluation),
        parts_table(evaluation),
        losses_table(evaluation),
        driving_table(evaluation),
        safety_table(evaluation),
        waits_table(evaluation),
        lever_table(evaluation),
        gating_table(evaluation),
        noise_table(evaluation),
        *more,
    )
    parts = [
        _head(evaluation),
        *(as_markdown(table) for table in tables if table is not None),
        _figures(pictures, missing),
        _provenance(evaluation, made_up),
    ]
    return "\n".join(parts)


def headlines(evaluation: Evaluation) -> list[str]:
    """What came out, a sentence an arm: a saving for each order at equal travel time, or why there
    is none.
    """
    lines = []
    for name, words in (
        (COOPERATIVE, "every lever but signal priority"),
        (EVERY_LEVER, "every lever"),
        (INSTALLED, "as a dispatcher is set by default"),
        (INSTALLED_PRIORITY, "the same with signal priority"),
    ):
        if name not in evaluation:
            continue
        found = evaluation.headline(name)
        missing = why_missing(found)
        said = f"{name}, {words}: "
        if found.saving is None:
            said += f"no saving can be told; {missing}"
        else:
            seeds = f"{len(found.seeds)} seeds"
            if len(found.seeds) == 1:
                seeds = f"seed {found.seeds[0]} alone, so without a ±"
            said += (
                f"saves {percent(found.saving)} for each order at equal travel time against "
                f"{BASELINE} ({found.orders} orders, {seeds})"
            )
            said += f"; not in it: {missing}" if missing else ""
        lines.append(said)
    some = f"none of {COOPERATIVE}, {EVERY_LEVER}, {INSTALLED} is there"
    return lines or [f"no saving can be told: {some}"]


def platoonless(evaluation: Evaluation) -> list[str]:
    """Why nobody drove in a platoon, a line for all arms that have the same reason."""
    arms: dict[str, list[str]] = {}
    for name, of_seed in no_platoons(evaluation).items():
        arms.setdefault(by_reason(of_seed), []).append(name)
    return [f"{join_names(names)}: {reason}" for reason, names in arms.items()]


def refusals(evaluation: Evaluation) -> list[str]:
    """Arms whose figures do not count, a line each."""
    return [
        f"{name}, seed {seed}, is refused: {join_names(faults)}"
        for name, seed, faults in evaluation.refused
    ]


def doubts(evaluation: Evaluation) -> list[str]:
    """Seeds in which so many of the others were teleported that their traffic says little."""
    by_seed: dict[int, list[OthersSafety]] = {}
    for _, seed, others in evaluation.doubtful:
        by_seed.setdefault(seed, []).append(others)
    lines = []
    for seed, arms in by_seed.items():
        most = max(arms, key=lambda others: others.teleports)
        lines.append(
            f"seed {seed}: in {len(arms)} arms SUMO teleported more than {MAX_TELEPORTED:.0%} of "
            f"the others, who had stood for 300 s (up to {most.teleports} of {most.trips} trips): "
            "so blocked a traffic says little; take fewer trips (--demand) or another net"
        )
    return lines


def gaps(evaluation: Evaluation) -> list[str]:
    """What makes the evaluation less than whole: arms without some seed, code that changed."""
    lines = [
        f"{name} has no seed {join_names(lacking)}"
        for name, of_seed in evaluation.arms.items()
        if (lacking := [seed for seed in evaluation.seeds if seed not in of_seed])
    ]
    if len(evaluation.codes) > 1:
        lines.append(
            "arms were simulated by different code, see `code` in `arms.csv`: "
            "delete those of the older one to simulate them anew"
        )
    return lines


def _head(evaluation: Evaluation) -> str:
    provenance = evaluation.provenance
    lines = [
        f"# Evaluation: {provenance.scenario}",
        "",
        f"Orders of {clock(provenance.begin_s)} to {_end(provenance.end_s)}, "
        f"{provenance.signals} signals, "
        f"seeds {join_names(evaluation.seeds)}. Made by `slipstream evaluate` from the files named "
        "under each table; nothing in it is typed by hand but the paper's figures.",
    ]
    if lacking := platoonless(evaluation):
        lines += ["", f"**{_NO_PLATOON}.**", "", *(f"- {line}." for line in lacking)]
    lines += ["", *(f"- {line}." for line in headlines(evaluation))]
    for title, words in (
        ("Refused: their figures count nowhere", refusals(evaluation)),
        ("Doubtful: traffic that stands", doubts(evaluation)),
        ("Not whole", gaps(evaluation)),
    ):
        if words:
            lines += ["", f"**{title}.**", "", *(f"- {line}" for line in words)]
    return "\n".join(lines) + "\n"


def _figures(pictures: Sequence[str], missing: str | None) -> str:
    lines = ["## Figures", ""]
    titles = {
        "cumulative.png": ("Energy and platooned distance so far", "cumulative.csv"),
        "hourly.png": ("Energy of each hour by policy", "hourly.csv"),
    }
    for name, (title, data) in titles.items():
        drawn = f"![{title}]({name})" if name in pictures else f"{title}: not drawn."
        lines += [drawn, "", f"Source: `{data}`.", ""]
    if missing is not None:
        lines += [missing, ""]
    lines.append("The energy of a leg is spread evenly over its time on the road.")
    return "\n".join(lines) + "\n"


def _provenance(evaluation: Evaluation, made_up: Sequence[str]) -> str:
    provenance = evaluation.provenance
    lines = [
        "## What it stands on",
        "",
        f"- scenario {provenance.scenario}; SHA-256 of its net `{provenance.net[:12]}`, background "
        f"`{provenance.demand[:12]}`, fleet `{provenance.fleet[:12]}`"
        + ("" if provenance.type is None else f" of type {provenance.type}")
        + ", RSUs "
        + (f"`{provenance.rsus[:12]}`" if provenance.rsus else "placed by the traffic"),
        *(f"- made up: {line}" for line in made_up),
        f"- {provenance.begin_s:g} to {provenance.end_s:g} s, steps of {provenance.step_s:g} s, "
        f"{provenance.signals} signals; an hour of waiting for other vehicles costs "
        f"{prices(provenance)}",
        *(f"- code: {code}" for code in evaluation.codes),
        "- `arms.csv`: every figure of every arm and seed in full",
        "- `run.json`: how long the arms took; no part of the results",
    ]
    return "\n".join(lines) + "\n"


def _end(time_s: float) -> str:
    return "24:00" if time_s == 86400 else clock(time_s)


def terminal_summary(evaluation: Evaluation) -> str:
    """The main figures for a terminal."""
    lines = [f"{_NO_PLATOON}: {line}" for line in platoonless(evaluation)]
    lines.append(
        f"{'arm':20} {'seeds':>5} {'orders':>7} {'kWh':>9} {'km':>9} {'h':>7} "
        f"{'saved at equal time':>20}"
    )
    for name, of_seed in evaluation.runs.items():
        if name not in evaluation:
            continue
        energy = evaluation.figure(name, lambda m: m.energy_kwh)
        distance = evaluation.figure(name, lambda m: m.distance_km)
        hours = evaluation.figure(name, lambda m: m.travel_h)
        served = sum(m.served for m in of_seed.values() if not m.faults)
        lines.append(
            f"{name:20} {sum(not m.faults for m in of_seed.values()):5} {served:7} "
            f"{number(energy and energy.mean, 1):>9} {number(distance and distance.mean, 1):>9} "
            f"{number(hours and hours.mean, 2):>7} "
            f"{'' if name == BASELINE else equal_time(evaluation, name):>20}"
        )
    notes = (headlines, refusals, doubts, gaps)
    return "\n".join([*lines, *(line for of in notes for line in of(evaluation))])
