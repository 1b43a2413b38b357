"""The tables of an evaluation: the paper's day, and ours arm by arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from slipstream_lab.simulation.evaluation.arms import (
    BASELINE,
    COOPERATIVE,
    EVERY_LEVER,
    INSTALLED,
    INSTALLED_PRIORITY,
    SHORTEST,
)
from slipstream_lab.simulation.evaluation.measures import Compared, Evaluation, Measures
from slipstream_lab.simulation.evaluation.report.cells import (
    AT_OWN_TIME,
    EQUAL_TIME,
    MEANS,
    WAIT_HEADS,
    WAITS,
    WAITS_NOTE,
    arm_files,
    arm_rows_source,
    equal_time,
    missing_notes,
    prices,
    saving,
)
from slipstream_lab.simulation.evaluation.report.formatting import (
    NOTHING,
    ReportTable,
    count,
    join_names,
    number,
    percent,
)
from slipstream_lab.simulation.evaluation.report.paper import (
    PAPER_BASELINE,
    PAPER_COOPERATIVE,
    PaperDay,
)

PARTS: Final[tuple[Callable[[Compared], float], ...]] = (
    lambda c: c.parts.distance_kwh,
    lambda c: c.parts.drag_kwh,
    lambda c: c.parts.acceleration_kwh,
    lambda c: c.parts.total_kwh,
)
SHARES: Final[tuple[Callable[[Compared], float], ...]] = (
    lambda c: c.shares.distance_kwh,
    lambda c: c.shares.drag_kwh,
    lambda c: c.shares.acceleration_kwh,
    lambda c: c.shares.total_kwh,
)
LOSSES: Final[tuple[Callable[[Measures], float], ...]] = (
    lambda m: m.losses.rolling_kwh,
    lambda m: m.losses.drag_kwh,
    lambda m: m.losses.arrival_kwh,
    lambda m: m.losses.stands_kwh,
    lambda m: m.losses.slowing_kwh,
)


def day_table(evaluation: Evaluation) -> ReportTable:
    """The paper's summary of its day, its columns beside ours."""
    ours = (SHORTEST, BASELINE, COOPERATIVE, EVERY_LEVER, INSTALLED, INSTALLED_PRIORITY)
    names = [name for name in ours if name in evaluation]
    papers = (PAPER_BASELINE, PAPER_COOPERATIVE)

    def row(
        what: str, paper: Callable[[PaperDay], str], ours: Callable[[str], str]
    ) -> tuple[str, ...]:
        return (what, *map(paper, papers), *map(ours, names))

    def of(what: Callable[[Measures], float], digits: int = 1) -> Callable[[str], str]:
        return lambda name: number(evaluation.figure(name, what), digits)

    rows = (
        row("distance, km", lambda p: f"{p.distance_km:,.1f}", of(lambda m: m.distance_km)),
        row("travel time, h", lambda p: f"{p.travel_h:.1f}", of(lambda m: m.travel_h, 2)),
        row("platooned, km", lambda p: f"{p.platooned_km:.1f}", of(lambda m: m.platooned_km)),
        row(
            "platooned, share of the distance",
            lambda p: percent(p.platooned_km / p.distance_km),
            lambda name: percent(evaluation.figure(name, lambda m: m.platooned_share)),
        ),
        row("energy, kWh", lambda p: f"{p.energy_kwh:.1f}", of(lambda m: m.energy_kwh)),
        row(
            f"energy saved{AT_OWN_TIME}",
            lambda p: percent(p.saving),
            lambda name: saving(evaluation, name, lambda c: c.saving),
        ),
        row(
            "energy saved at equal travel time",
            lambda _: NOTHING,
            lambda name: equal_time(evaluation, name),
        ),
    )
    return ReportTable(
        "The day, beside the paper's",
        ("", "paper: baseline", "paper: cooperative", *(f"ours: {name}" for name in names)),
        rows,
        f"ours from {arm_files(evaluation, names)}; the paper's from its table "
        '"24-Hour Microscopic Fleet Simulation Summary"',
        (
            f"{MEANS} A: shortest time, uncoordinated. B: the paper's baseline. C: every lever "
            "but signal priority. C+: every lever. installed: as a dispatcher is set by default. "
            "installed+: the same with signal priority. The vehicles of these two brake as their "
            f"type does, those of the others are the paper's ideal ones. {EQUAL_TIME}",
            *missing_notes(evaluation, names),
        ),
    )


def energy_table(evaluation: Evaluation) -> ReportTable:
    """Every arm: energy, time, what was delivered, and the saving by each measure."""
    names = [name for name in evaluation.runs if name in evaluation]
    rows = tuple(
        (
            name,
            join_names([seed for seed, m in evaluation.runs[name].items() if not m.faults]),
            number(evaluation.figure(name, lambda m: m.energy_kwh), 1),
            number(evaluation.figure(name, lambda m: m.distance_km), 1),
            number(evaluation.figure(name, lambda m: m.travel_h), 2),
            count(evaluation.figure(name, lambda m: m.served)),
            count(evaluation.figure(name, lambda m: m.late)),
            number(evaluation.figure(name, lambda m: 1000 * m.per_order_kwh), 1),
            saving(evaluation, name, lambda c: c.saving),
            percent(evaluation.against(name, lambda c: c.travel), sign=True),
            equal_time(evaluation, name),
        )
        for name in names
    )
    return ReportTable(
        "Arms",
        (
            *("arm", "seeds", "kWh", "km", "travel h", "orders served", "late", "Wh/order"),
            *(f"saving{AT_OWN_TIME}", "travel time", "saving at equal travel time"),
        ),
        rows,
        arm_rows_source(evaluation),
        (
            f"{MEANS} Savings and travel times are against B of the same seed. {EQUAL_TIME} "
            "Late: begun after their latest time, or not begun though it is over.",
            *missing_notes(evaluation, names),
        ),
    )


def parts_table(evaluation: Evaluation) -> ReportTable:
    """The saving by its causes."""
    names = [name for name in evaluation.compared if evaluation.compared[name] and name != BASELINE]
    rows = tuple(
        (
            name,
            *(number(evaluation.against(name, of), 2, sign=True) for of in PARTS),
            *(percent(evaluation.against(name, of), 2, sign=True) for of in SHARES),
        )
        for name in names
    )
    return ReportTable(
        "Where the saving comes from",
        (
            *("arm", "distance, kWh", "drag, kWh", "acceleration, kWh", "sum, kWh"),
            *("distance, % of B", "drag", "acceleration", "sum"),
        ),
        rows,
        f"{arm_rows_source(evaluation)} and those of B, split by `split_saving` of summed energies",
        (
            "Drag: what driving in platoons saves on the same drives. Acceleration: less energy "
            "for changes of speed. Distance: less rolling resistance and undrafted drag, by "
            "shorter or slower drives.",
        ),
    )


def losses_table(evaluation: Evaluation) -> ReportTable:
    """Every arm: what its energy went into."""
    names = [name for name in evaluation.runs if name in evaluation]
    rows = tuple(
        (
            name,
            number(evaluation.figure(name, lambda m: 1000 * m.energy_kwh / m.distance_km), 1),
            *(number(evaluation.figure(name, of), 1) for of in LOSSES),
            number(evaluation.figure(name, lambda m: m.alone.total_kwh - m.energy_kwh), 2),
        )
        for name in names
    )
    return ReportTable(
        "What the energy went into",
        (
            *("arm", "Wh/km", "rolling, kWh", "drag, kWh", "braked to deliver, kWh"),
            *("braked to a stand on the road, kWh", "braked else, kWh", "drafting saved, kWh"),
        ),
        rows,
        arm_rows_source(evaluation),
        ("Of the same drives without any drafting; the parts but the last add up to them.",),
    )


def driving_table(evaluation: Evaluation) -> ReportTable:
    """Every arm: how it drove, and what others had of it."""
    names = [name for name in evaluation.runs if name in evaluation]
    rows = tuple(
        (
            name,
            count(evaluation.figure(name, lambda m: m.stops)),
            number(evaluation.figure(name, lambda m: m.stops / m.distance_km), 2),
            number(evaluation.figure(name, lambda m: m.waited_h), 2),
            number(evaluation.figure(name, lambda m: m.platooned_km), 1),
            number(evaluation.figure(name, lambda m: m.planned_platooned_km), 1),
            percent(evaluation.figure(name, lambda m: m.platooned_share)),
            count(evaluation.figure(name, lambda m: m.disengagements)),
            number(evaluation.figure(name, lambda m: m.turbulent_s), 0),
            count(evaluation.figure(name, lambda m: m.open_turbulent)),
            number(evaluation.against(name, lambda c: c.others_s), 2, sign=True),
            count(evaluation.figure(name, lambda m: m.unfinished)),
        )
        for name in names
    )
    return ReportTable(
        "How they drove",
        (
            *("arm", "stops", "stops/km", "standing, h", "platooned km", "planned", "share"),
            *("disengagements", "platooned in turbulence, s", "open gates in turbulence"),
            *("others, s a trip", "unfinished"),
        ),
        rows,
        arm_rows_source(evaluation),
        (
            "Platooned km: driven with a drag reduction; planned: by the plans, what later ones "
            "replaced left out. Disengagements: platoons that had to part because the traffic was "
            "turbulent in truth. "
            "Open gates in turbulence: segments let for platoons while turbulent in truth, summed "
            "over dispatch cycles (the paper: no violation). Others: mean duration of the "
            "background's trips against B's. Unfinished: tours under way at the end.",
        ),
    )


def safety_table(evaluation: Evaluation) -> ReportTable:
    """Every arm, refused ones too: what went wrong, the fleet's apart from others'."""
    rows = []
    for name, of_seed in evaluation.runs.items():
        for seed, m in of_seed.items():
            own, others, least_m = m.safety, m.others_safety, m.safety.least_gap_m
            pairs = (
                (own.collisions, others.collisions),
                (own.emergency_stops, others.emergency_stops),
                (own.teleports, others.teleports),
            )
            rows.append(
                (
                    *(name, str(seed)),
                    *(f"{of_fleet} + {of_others}" for of_fleet, of_others in pairs),
                    *(str(own.promises_broken), number(own.most_over_mps2, 2)),
                    *(str(own.held_back), number(least_m, 2)),
                )
            )
    return ReportTable(
        "Safety",
        (
            *("arm", "seed", "collisions", "emergency stops", "teleports"),
            *("promises broken", "by at most, m/s²", "held back, steps", "least gap, m"),
        ),
        tuple(rows),
        arm_rows_source(evaluation),
        (
            "Each count: of the fleet + of others, as SUMO has them; others' count against no arm. "
            "Promises broken: times that a vehicle began to brake harder than its follower reckons "
            "with. Held back: SUMO's own check braked a vehicle of a platoon harder than its "
            "agent. Least gap: between a follower and the vehicle that it followed. Arms other "
            "than the installed ones have the paper's ideal vehicles.",
        ),
    )


def waits_table(evaluation: Evaluation) -> ReportTable:
    """Every arm: how long its vehicles waited, and for how long they drove."""
    names = [name for name in evaluation.runs if name in evaluation]
    rows = tuple(
        (
            name,
            *(number(evaluation.figure(name, of), digits) for of, digits in WAITS),
            count(evaluation.figure(name, lambda m: m.late)),
        )
        for name in names
    )
    return ReportTable(
        "Waits",
        ("arm", *WAIT_HEADS, "late"),
        rows,
        arm_rows_source(evaluation),
        (WAITS_NOTE, f"An hour of waiting for others costs {prices(evaluation.provenance)}."),
    )
