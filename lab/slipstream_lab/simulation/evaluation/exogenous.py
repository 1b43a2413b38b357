"""The exogenous evaluation of the same days; its arms are stored in separate folders."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from slipstream_lab.simulation.closed_loop.arm import home_by_s
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.arms import (
    BASELINE,
    COOPERATIVE,
    NOISES,
    POLICIES,
    gated,
    noisy,
)
from slipstream_lab.simulation.evaluation.measures import Evaluation, collect
from slipstream_lab.simulation.evaluation.runs import (
    ArmStore,
    World,
    WorldFiles,
    code_stamp,
    run_missing,
)
from slipstream_lab.simulation.exogenous.day import exogenous_day
from slipstream_lab.simulation.exogenous.recorded import RecordedTraffic, Watched, record_background
from slipstream_lab.simulation.scenarios.scenario import BackgroundTraffic, SignalControl
from slipstream_lab.simulation.sumo import Progress, run_in_subprocess

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
class ExogenousSpec:
    """One exogenous arm, for a subprocess. `span_s`: begin and end of the orders' release; the
    record goes on until their arms end.
    """

    files: WorldFiles
    background: BackgroundTraffic
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
        progress: called with the simulated time done and the total, s.

    Raises:
        InputError: a background is not fit, or the folder is of another evaluation.
    """
    provenance = replace(
        world.provenance,
        step_s=_STEP_S,
        rsus=f"{watched} {world.provenance.rsus}"[:72],
        waiting_kw=None,  # the paper's objective has no price of waiting
        standing_kw=None,
    )
    span_s = provenance.begin_s, provenance.end_s
    lock = threading.Lock()

    def simulate(policy: Policy, seed: int, report: Progress) -> ArmResult:
        background = replace(world.background(seed), trips=None, routes=None)
        spec = ExogenousSpec(
            world.files,
            background,
            world.folder,
            watched,
            policy,
            seed,
            provenance.signals,
            span_s,
        )
        with lock:  # the first arm of a seed records its background for all
            _recorded(spec)
        source = f"{provenance.scenario}, {background.files[0].name}"
        return run_in_subprocess(run_exogenous, spec, source, provenance.end_s, report)

    policies = [POLICIES[name] for name in ARMS[watched]]
    with ArmStore(folder / f"exogenous-{watched}", provenance, code_stamp()) as store:
        if not stored:
            run_missing(policies, seeds, span_s, store, simulate, workers, progress)
        return collect(store, provenance, seeds)


def run_exogenous(spec: ExogenousSpec, report_time: Callable[[float], None]) -> ArmResult:
    """Evaluate an arm in this process, on a background that is recorded already."""
    return exogenous_day(
        spec.files.load(),
        _recorded(spec),
        spec.policy,
        spec.seed,
        end_s=spec.span_s[1],
        progress=lambda now_s, _: report_time(now_s),
    )


def _recorded(spec: ExogenousSpec) -> RecordedTraffic:
    begin_s, end_s = spec.span_s
    scenario = spec.files.load()
    return record_background(
        scenario,
        spec.background,
        spec.folder,
        watched=spec.watched,
        signals=spec.signals,
        begin_s=begin_s,
        end_s=home_by_s(scenario.fleet, end_s),
    )
