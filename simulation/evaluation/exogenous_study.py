"""The exogenous evaluation of the same days: arms in folders of their own, and its tables."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from simulation.closed_loop.policy import Policy
from simulation.closed_loop.record import ArmResult
from simulation.evaluation.arms import BASELINE, COOPERATIVE, NOISES, POLICIES, gated, noisy
from simulation.evaluation.cells import files, saving
from simulation.evaluation.evaluation import Evaluation, collect
from simulation.evaluation.ground import code_stamp
from simulation.evaluation.measures import Measures
from simulation.evaluation.paper import PAPER_BASELINE, PAPER_COOPERATIVE, PaperDay
from simulation.evaluation.run import Told, run_missing
from simulation.evaluation.store import Store
from simulation.evaluation.studies import noise_table
from simulation.evaluation.words import NOTHING, Table, count, number, percent
from simulation.evaluation.world import World, WorldFiles
from simulation.exogenous.day import exogenous_day
from simulation.exogenous.recorded import Recorded, Watched, record_background
from simulation.scenarios.apart import run_apart
from simulation.scenarios.scenario import Background, SignalControl
from slipstream.energy import ETA_FOLLOWER

ARMS: Final[Mapping[Watched, tuple[str, ...]]] = {
    "rsus": (
        *(BASELINE, COOPERATIVE, gated("open"), gated("random")),
        *(noisy(noise) for noise in NOISES),
    ),
    "everywhere": (BASELINE, COOPERATIVE, gated("open")),
}
"""Names of the arms, by where traffic is watched; of their levers only platoons count."""

_STEP_S: Final = 1.0


@dataclass(frozen=True)
class ExogenousOrder:
    """One exogenous arm, for a process of its own.

    Attributes:
        files: of the scenario.
        background: of the seed.
        folder: where its record lies.
        watched: where traffic is judged.
        policy: of the arm.
        seed: of the deliveries, the perception's errors and the searches.
        signals: how they were run when the background was recorded.
        span_s: begin and end of the record.
    """

    files: WorldFiles
    background: Background
    folder: Path
    watched: Watched
    policy: Policy
    seed: int
    signals: SignalControl
    span_s: tuple[float, float]


def exogenous_evaluation(
    world: World,
    watched: Watched,
    seeds: Sequence[int],
    folder: Path,
    workers: int,
    progress: Callable[[float, float], None],
    *,
    stored: bool = False,
) -> Evaluation:
    """Evaluate what the folder lacks, and collect all that it has.

    Args:
        folder: of the evaluation; these arms lie in `exogenous-rsus` and `exogenous-everywhere`.
        workers: arms at once.
        progress: told how much simulated time is done, of how much.
        stored: nothing is simulated, what is there is collected.

    Raises:
        InputError: a background is not fit, or the folder is of another evaluation.
    """
    ground = replace(world.ground, step_s=_STEP_S, rsus=f"{watched} {world.ground.rsus}"[:72])
    span_s = ground.begin_s, ground.end_s
    lock = threading.Lock()

    def simulate(policy: Policy, seed: int, told: Told) -> ArmResult:
        background = replace(world.background(seed), trips=None, routes=None)
        order = ExogenousOrder(
            world.files,
            background,
            background.file.parent,
            watched,
            policy,
            seed,
            ground.signals,
            span_s,
        )
        with lock:  # the first arm of a seed records its background for all
            _recorded(order)
        source = f"{ground.scenario}, {background.file.name}"
        return run_apart(run_exogenous, order, source, ground.end_s, told)

    policies = [POLICIES[name] for name in ARMS[watched]]
    with Store(folder / f"exogenous-{watched}", ground, code_stamp()) as store:
        if not stored:
            run_missing(policies, seeds, span_s, store, simulate, workers, progress)
        return collect(store, ground, seeds)


def run_exogenous(order: ExogenousOrder, tell: Callable[[float], None]) -> ArmResult:
    """Evaluate an arm in this process, on a background that is recorded already."""
    day = exogenous_day(
        order.files.load(),
        _recorded(order),
        order.policy,
        order.seed,
        progress=lambda now_s, _: tell(now_s),
    )
    return day.arm


def exogenous_tables(
    closed: Evaluation | None, rsus: Evaluation, everywhere: Evaluation
) -> tuple[Table, ...]:
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


def _day_table(closed: Evaluation | None, rsus: Evaluation, everywhere: Evaluation) -> Table:
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
            "energy saved",
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
        files(study, names).replace("`arms/", f"`{prefix}arms/")
        for prefix, study, names in (
            ("exogenous-rsus/", rsus, rsus.runs),
            ("exogenous-everywhere/", everywhere, everywhere.runs),
            ("", closed, (BASELINE, COOPERATIVE)),
        )
        if study is not None
    ]
    return Table(
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


def _recorded(order: ExogenousOrder) -> Recorded:
    begin_s, end_s = order.span_s
    return record_background(
        order.files.load(),
        order.background,
        order.folder,
        watched=order.watched,
        signals=order.signals,
        begin_s=begin_s,
        end_s=end_s,
    )
