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
from simulation.evaluation.measures import Evaluation, collect
from simulation.evaluation.runs import Store, Told, World, WorldFiles, code_stamp, run_missing
from simulation.exogenous.day import exogenous_day
from simulation.exogenous.recorded import Recorded, Watched, record_background
from simulation.scenarios.scenario import Background, SignalControl
from simulation.sumo import run_apart

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
