"""Tables of what was varied: levers, gating, noise."""

from __future__ import annotations

from slipstream_lab.simulation.closed_loop.policy import LEVERS, Gating
from slipstream_lab.simulation.evaluation.arms import (
    BASELINE,
    COOPERATIVE,
    EVERY_LEVER,
    NOISES,
    gated,
    noisy,
    only,
    without,
)
from slipstream_lab.simulation.evaluation.measures import Evaluation
from slipstream_lab.simulation.evaluation.report.cells import (
    AT_OWN_TIME,
    arm_files,
    equal_time,
    saving,
    saving_lost,
)
from slipstream_lab.simulation.evaluation.report.formatting import (
    ReportTable,
    count,
    number,
    percent,
)
from slipstream_lab.simulation.evaluation.report.paper import PAPER_NOISE


def lever_table(evaluation: Evaluation) -> ReportTable | None:
    """What each lever earns alone, and what is lost without it; None where no such arm is."""
    rows = []
    for lever in LEVERS:
        alone, rest = only(lever), without(lever)
        if alone not in evaluation and rest not in evaluation:
            continue
        rows.append(
            (
                lever.replace("_", "-"),
                saving(evaluation, alone, lambda c: c.saving),
                equal_time(evaluation, alone),
                saving_lost(evaluation, rest, lambda c: c.saving),
                saving_lost(evaluation, rest, lambda c: c.at_equal_time),
            )
        )
    if not rows:
        return None
    names = [
        *(BASELINE, EVERY_LEVER),
        *(name for lever in LEVERS for name in (only(lever), without(lever))),
    ]
    return ReportTable(
        "Levers",
        (
            *("lever", f"saving of B with it alone{AT_OWN_TIME}", "at equal travel time"),
            *(f"points that C+ loses without it{AT_OWN_TIME}", "at equal travel time"),
        ),
        tuple(rows),
        arm_files(evaluation, names),
        ("C+ without priority is C. Levers share what can be had: columns do not add up.",),
    )


def gating_table(evaluation: Evaluation) -> ReportTable | None:
    """The cooperative arm with RSUs' gates, without, and with random ones."""
    kinds: tuple[tuple[Gating, str], ...] = (
        ("rsu", "as RSUs report"),
        ("open", "open wherever watched"),
        ("random", "random, as often"),
    )
    names = [gated(kind) for kind, _ in kinds]
    if not any(name in evaluation for name in names[1:]):
        return None
    rows = tuple(
        (
            words,
            name,
            number(evaluation.figure(name, lambda m: m.energy_kwh), 1),
            saving(evaluation, name, lambda c: c.saving),
            equal_time(evaluation, name),
            number(evaluation.figure(name, lambda m: m.platooned_km), 1),
            count(evaluation.figure(name, lambda m: m.disengagements)),
            number(evaluation.figure(name, lambda m: m.turbulent_s), 0),
            count(evaluation.figure(name, lambda m: m.open_turbulent)),
        )
        for name, (_, words) in zip(names, kinds, strict=True)
        if name in evaluation
    )
    return ReportTable(
        "Gating",
        (
            *("gates", "arm", "kWh", f"saving{AT_OWN_TIME}", "saving at equal travel time"),
            *("platooned km", "disengagements"),
            *("platooned in turbulence, s", "open gates in turbulence"),
        ),
        rows,
        arm_files(evaluation, names),
    )


def noise_table(evaluation: Evaluation) -> ReportTable | None:
    """The paper's noise table, its columns beside ours; None without a noisy arm."""
    levels = [level for level in (0.0, *NOISES) if noisy(level) in evaluation]
    if not any(levels):
        return None
    rows = []
    for level in levels:
        name, paper = noisy(level), PAPER_NOISE[level]
        found = evaluation.against(name, lambda c: c.saving)
        rows.append(
            (
                f"{level:.0%}",
                percent(paper.stable_share),
                percent(evaluation.figure(name, lambda m: m.open_share)),
                f"{paper.platooned_km:.1f}",
                number(evaluation.figure(name, lambda m: m.platooned_km), 1),
                f"{paper.energy_kwh:.1f}",
                number(evaluation.figure(name, lambda m: m.energy_kwh), 1),
                percent(paper.saving),
                percent(found, 2),
                equal_time(evaluation, name),
                percent(paper.saving / PAPER_NOISE[0.0].saving),
                percent(_kept(evaluation, name)),
            )
        )
    columns = [
        f"{what}{whose}"
        for what in ("stable segments", "platooned km", "kWh", f"saving{AT_OWN_TIME}")
        for whose in (", paper", "")
    ]
    return ReportTable(
        "Noise on the features",
        (
            *("noise", *columns, "saving at equal travel time", "saving kept, paper"),
            "saving kept at equal travel time",
        ),
        tuple(rows),
        f"ours from {arm_files(evaluation, map(noisy, levels))}; the paper's from its "
        'table "Noise Propagation & System Robustness"',
        (
            "Stable segments: ours is the share of judged segments whose gate was open, over all "
            "dispatch cycles, the error of the perception included; the paper counts against its "
            "noiseless state.",
        ),
    )


def _kept(evaluation: Evaluation, name: str) -> float | None:
    """Share of the cooperative arm's saving at equal travel time that another arm has, on the seeds
    of both.
    """
    mine, exact = evaluation.compared.get(name, {}), evaluation.compared.get(COOPERATIVE, {})
    both = [
        (own.at_equal_time, best.at_equal_time)
        for seed, own in mine.items()
        if (best := exact.get(seed)) is not None
    ]
    pairs = [(own, best) for own, best in both if own is not None and best is not None]
    whole = sum(best for _, best in pairs)
    return sum(own for own, _ in pairs) / whole if whole > 0 else None
