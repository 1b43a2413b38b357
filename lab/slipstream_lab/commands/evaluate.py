"""`slipstream evaluate`: a day's arms in the closed loop, as the paper's tables and figures."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from slipstream.errors import InputError
from slipstream.site import load_site
from slipstream.vehicle_types import PRESETS
from slipstream_cli.progress import ProgressLine
from slipstream_lab.commands import sumo_files
from slipstream_lab.commands.curve import Curve, add_options, parse_numbers

if TYPE_CHECKING:
    from slipstream_lab.simulation.closed_loop.policy import Policy, WaitingPrices
    from slipstream_lab.simulation.evaluation.measures import Evaluation
    from slipstream_lab.simulation.evaluation.report import ReportTable
    from slipstream_lab.simulation.evaluation.runs import ArmStore, Simulate, World, WorldFiles
    from slipstream_lab.simulation.exogenous.recorded import Watched
    from slipstream_lab.simulation.sumo import SumoFiles

_EXIT_INTERRUPTED: Final = 130
_GRID_S: Final = 300


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "evaluate",
        help="the paper's day in SUMO, closed loop, arm against arm",
        description="Drives a delivery fleet through a simulated day, once for each arm and seed, "
        "and writes the paper's tables and figures with ours beside them. With --density it plans "
        "platoons by vehicles a day instead, and draws the curve. What is finished is kept; the "
        "same command goes on where it was interrupted.",
    )
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="for all results")
    command.add_argument(
        "--hours",
        type=float,
        help="in which orders are released; arms go on until everybody is at home (default: to the "
        "end of the day)",
    )
    command.add_argument(
        "--begin",
        type=float,
        metavar="HOUR",
        help="of the day (default: 0; with --hours the busiest hour of the fleet's orders; or when "
        "a SUMO configuration begins)",
    )
    command.add_argument(
        "--seeds", default="1,2,3", metavar="N,N", help="a day each (default: 1,2,3)"
    )
    command.add_argument(
        "--arms",
        metavar="NAME,NAME",
        help="arms, or all, main, levers, gating, noise, exogenous "
        "(default: all, with --drive B,C)",
    )
    command.add_argument(
        "--scenario",
        help="troy, corridor, or a name of your own with --net (default: troy)",
    )
    for names, what in (
        (("--net",), "SUMO net"),
        (("--demand",), "demand (TOML)"),
        (("--rsus", "--rsu-file"), "RSUs (TOML)"),
        (("--fleet",), "fleet (TOML)"),
    ):
        command.add_argument(
            *names, type=Path, metavar="FILE", help=f"{what} instead of the scenario's"
        )
    command.add_argument(
        "--type",
        choices=tuple(PRESETS),
        help="of the fleet's vehicles (default: its file's, else paper_car)",
    )
    sumo_files.add_options(command)
    command.add_argument(
        "--signals", choices=("actuated", "fixed"), default="actuated", help="how they are timed"
    )
    command.add_argument(
        "--road",
        choices=("dry", "wet", "snow"),
        default="dry",
        help="state of the roads, by which vehicles brake and keep gaps (default: dry)",
    )
    for name, where, default in (
        ("--waiting-kw", "its depot", "what slower driving would save"),
        ("--standing-kw", "a stop, served", "the same, or as --waiting-kw if that is more"),
    ):
        command.add_argument(
            name,
            type=float,
            metavar="KW",
            help="price of an hour in which a vehicle waits for others at "
            f"{where}, kWh; 0: free (default: {default})",
        )
    add_options(command)
    command.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="arms at once (default: as many as cores, or as the cluster has processes)",
    )
    command.add_argument(
        "--cluster",
        type=Path,
        metavar="FILE",
        help="settings of the cluster whose workers simulate the arms: the scheduler's file",
    )
    command.add_argument(
        "--databases",
        action="store_true",
        help="also keep each simulated arm's cycles, plans and energy ledger, as "
        "DIR/databases/ARM-SEED.db; what is stored already has none",
    )
    command.add_argument(
        "--stored", action="store_true", help="simulate nothing, report what is stored"
    )
    command.add_argument("--json", action="store_true", help="print the summary as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Simulate what is missing, write the results, print the main figures."""
    from slipstream_lab.simulation.evaluation.arms import choose

    curve = Curve.of(options)
    options.arms = options.arms or ("all" if curve is None else "B,C")
    policies, seeds = choose(options.arms), parse_numbers("--seeds", options.seeds, 0, "1,2,3")
    own = sumo_files.sumo_files(options)
    span_s, workers = _span(options, own), _workers(options.workers)
    prices = _prices(options)

    # Later: they take seconds to load, which a slip on the command line need not wait for.
    from slipstream_lab.simulation.evaluation.report import as_json
    from slipstream_lab.simulation.evaluation.runs import WorldFiles

    files = WorldFiles(
        sumo_files.scenario_name(options, own),
        own.net,
        options.demand,
        own.routes,
        options.rsus,
        options.fleet,
        own.additional,
        options.type,
    )

    def evaluated(out: Path, of: WorldFiles) -> tuple[Evaluation, dict[str, Any]]:
        return _evaluate(options, out, of, policies, seeds, span_s, prices, workers)

    try:
        if curve is None:
            _, summary = evaluated(options.out, files)
        else:
            summary = curve.make(seeds, workers, files, evaluated)
    except KeyboardInterrupt:
        said = "interrupted; the same command goes on from what is stored in"
        print(f"slipstream: {said} {options.out}", file=sys.stderr)
        return _EXIT_INTERRUPTED
    if options.json:
        print(as_json(summary), end="")
    return 0


def _evaluate(
    options: argparse.Namespace,
    out: Path,
    files: WorldFiles,
    policies: Sequence[Policy],
    seeds: Sequence[int],
    span_s: tuple[float, float],
    prices: WaitingPrices,
    workers: int,
) -> tuple[Evaluation, dict[str, Any]]:
    """One evaluation in its folder, and its summary."""
    from slipstream_lab.simulation.evaluation.measures import collect
    from slipstream_lab.simulation.evaluation.report import (
        terminal_summary,
        whole_summary,
        write_results,
    )
    from slipstream_lab.simulation.evaluation.runs import ArmStore, World, code_stamp

    background = options.out / "background"
    world = World(files, background, options.signals, span_s, prices, options.road)
    _refuse_exogenous(options, world)
    left_out = world.scenario.left_out
    if left_out is not None:
        print(f"slipstream: {world.scenario.net}: {left_out}", file=sys.stderr)
    made = world.made_up(seeds[0])
    for line in made:
        print(f"slipstream: made up: {line}", file=sys.stderr)
    with ArmStore(out, world.provenance, code_stamp()) as store:
        kept = 0 if options.stored else _simulate(options, policies, seeds, store, world, workers)
        evaluation = collect(store, world.provenance, seeds)
        if not evaluation.arms:
            raise InputError(out, "no arm of these seeds is stored", "run it without --stored")
        refused: InputError | None = None
        exogenous: Mapping[Watched, Evaluation] = {}
        try:
            exogenous = _exogenous(options, world, seeds, workers)
        except InputError as error:  # as of a background with a teleport: the other arms count
            refused = error
        more = _further_tables(world, evaluation, exogenous)
        missing = write_results(out, evaluation, more, exogenous, made)
    if missing is not None:
        print(f"slipstream: {missing}", file=sys.stderr)
    if not options.json:
        if kept:
            print(f"{kept} of {len(policies) * len(seeds)} arms were stored already")
        print(terminal_summary(evaluation))
        print(f"{out / 'report.md'}")
    _refuse_gridlock(evaluation)
    if refused is not None:
        problem = f"no exogenous evaluation: {refused.problem}"
        raise InputError(refused.source, problem, refused.mend, key=refused.key)
    return evaluation, whole_summary(evaluation, more, exogenous, made)


def _simulate(
    options: argparse.Namespace,
    policies: Sequence[Policy],
    seeds: Sequence[int],
    store: ArmStore,
    world: World,
    workers: int,
) -> int:
    """Simulate what the store lacks; how many arms it had."""
    from slipstream_lab.simulation.evaluation.runs import run_missing

    if options.databases and options.cluster is not None:
        problem = "arms on a cluster keep no database"
        raise InputError("--databases", problem, "leave out --cluster or this")
    span_s = world.provenance.begin_s, world.provenance.end_s
    simulate: Simulate = world.simulate
    with contextlib.ExitStack() as stack:
        if options.cluster is not None:
            from dispatcher_daemon.settings import SchedulerSettings
            from slipstream_lab.simulation.evaluation.runs.cluster import arms_on

            settings = load_site(options.cluster, "scheduler", SchedulerSettings)
            arms = stack.enter_context(arms_on(settings.cluster))
            simulate = partial(world.simulate, run=arms.run)
            workers = options.workers or arms.processes
        elif options.databases:
            simulate = partial(world.simulate, databases=store.folder / "databases")
        progress = stack.enter_context(ProgressLine("simulating", sys.stderr))
        update = _update_of(progress)
        done = run_missing(policies, seeds, span_s, store, simulate, workers, update)
    return done.kept


def _exogenous(
    options: argparse.Namespace, world: World, seeds: Sequence[int], workers: int
) -> dict[Watched, Evaluation]:
    """The exogenous evaluation, if it is asked for or stored."""
    from slipstream_lab.simulation.evaluation.arms import wants_exogenous
    from slipstream_lab.simulation.evaluation.exogenous import ARMS, exogenous_evaluation

    stored = options.stored or not wants_exogenous(options.arms)
    found: dict[Watched, Evaluation] = {}
    for watched in ARMS:
        if stored and not (options.out / f"exogenous-{watched}").is_dir():
            continue
        with ProgressLine(f"on recorded traffic, watched: {watched}", sys.stderr) as progress:
            evaluation = exogenous_evaluation(
                world, watched, seeds, options.out, workers, _update_of(progress), stored=stored
            )
        if evaluation.arms:
            found[watched] = evaluation
    return found


def _further_tables(
    world: World, evaluation: Evaluation, exogenous: Mapping[Watched, Evaluation]
) -> tuple[ReportTable, ...]:
    """Ceilings, and the exogenous evaluation where there is one."""
    from slipstream_lab.simulation.evaluation.report import ceiling_tables, exogenous_tables

    tables = ceiling_tables(evaluation, world.scenario.network)
    if {"rsus", "everywhere"} <= set(exogenous):
        tables += exogenous_tables(evaluation, exogenous["rsus"], exogenous["everywhere"])
    return tables


def _update_of(progress: ProgressLine) -> Callable[[float, float], None]:
    return lambda passed_s, whole_s: progress.update(round(passed_s), round(whole_s))


def _refuse_exogenous(options: argparse.Namespace, world: World) -> None:
    """Exogenous arms are the paper's, and so is their vehicle."""
    from slipstream_lab.simulation.evaluation.arms import wants_exogenous

    kind = world.scenario.fleet.type
    if kind != "paper_car" and not options.stored and wants_exogenous(options.arms):
        problem = f"exogenous arms have the paper's car, and the fleet is of type {kind}"
        raise InputError("evaluate", problem, "give --arms B,C", key="--arms")


def _refuse_gridlock(evaluation: Evaluation) -> None:
    """A scenario that gridlocks is bad input; what stood is in the report all the same."""
    for name, seed, faults in evaluation.refused:
        if any(fault.startswith("gridlock") for fault in faults):
            raise InputError(
                f"{evaluation.provenance.scenario}, arm {name}, seed {seed}",
                faults[0],
                "take fewer trips or another network",
            )


def _span(options: argparse.Namespace, own: SumoFiles) -> tuple[float, float]:
    """Begin and end of the simulated time, s since midnight."""
    begin_h, hours = options.begin, options.hours
    if begin_h is None and own.begin_s is not None:
        begin_h = own.begin_s / 3600
    elif begin_h is None:
        begin_h = 0.0 if hours is None or not 0 < hours < 24 else _busiest_h(options, own)
    if hours is None:
        # To the whole five minutes before a configuration ends.
        end_h = 24.0 if own.end_s is None else own.end_s // _GRID_S * _GRID_S / 3600
        hours = end_h - begin_h
    if not (begin_h >= 0 and hours > 0 and begin_h + hours <= 24):
        problem = f"{hours:g} hours from {begin_h:g} are no part of a day"
        raise InputError("evaluate", problem, "give hours from 0 to 24", key="--hours")
    begin_s, end_s = round(begin_h * 3600), round((begin_h + hours) * 3600)
    for key, time_s in (("--begin", begin_s), ("--hours", end_s)):
        if time_s % _GRID_S:
            problem = "no multiple of five minutes"
            raise InputError("evaluate", problem, "give one, as 7.25 or 0.5", key=key)
    return float(begin_s), float(end_s)


def _busiest_h(options: argparse.Namespace, own: SumoFiles) -> float:
    """The hour that most orders come from, and a line that says so."""
    from slipstream_lab.simulation.scenarios.demand import busiest_begin_s
    from slipstream_lab.simulation.scenarios.scenario import BUILT_IN, fleet_settings

    name = sumo_files.scenario_name(options, own)
    if own.net is None and name not in BUILT_IN:
        return 0.0  # refused where the scenario is loaded
    fleet = fleet_settings(
        name, options.fleet, own_net=own.net is not None, own_routes=bool(own.routes)
    )
    begin_h = busiest_begin_s(fleet, options.hours) / 3600
    until = f"{begin_h:g}:00, where most orders come within {options.hours:g} h"
    print(f"slipstream: no --begin: it begins at {until}", file=sys.stderr)
    return begin_h


def _prices(options: argparse.Namespace) -> WaitingPrices:
    """What waiting for other vehicles costs."""
    from slipstream_lab.simulation.closed_loop.policy import WaitingPrices
    from slipstream_lab.simulation.evaluation.arms import wants_exogenous

    given = {"--waiting-kw": options.waiting_kw, "--standing-kw": options.standing_kw}
    for key, price_kw in given.items():
        if price_kw is None:
            continue
        if not (math.isfinite(price_kw) and price_kw >= 0):
            problem = f"no price: {price_kw:g}"
            raise InputError("evaluate", problem, "give 0 or more, as 2.5", key=key)
        if wants_exogenous(options.arms):
            problem = "waiting has no price in exogenous arms"
            raise InputError("evaluate", problem, "give --arms B,C", key=key)
    return WaitingPrices(options.waiting_kw, options.standing_kw)


def _workers(count: int | None) -> int:
    if count is not None and count < 1:
        raise InputError("evaluate", f"{count} arms at once", "give 1 or more", key="--workers")
    return count or len(os.sched_getaffinity(0))
