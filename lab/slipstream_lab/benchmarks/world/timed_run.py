"""One simulation in a process of its own, its times as JSON on the last line; on given cores.

`background` simulates a day's background with its RSUs, `arm` one arm of the closed loop.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from pathlib import Path

from slipstream_lab.simulation.closed_loop.arm import STEP_S
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.runs import World, WorldFiles
from slipstream_lab.simulation.scenarios.acceptance import AcceptanceLimits
from slipstream_lab.simulation.scenarios.day import run_day
from slipstream_lab.simulation.scenarios.scenario import day_spec, load_scenario, prepare


def main() -> None:
    """Read the arguments, simulate, print."""
    parser = argparse.ArgumentParser(prog="python -m slipstream_lab.benchmarks.world.timed_run")
    parser.add_argument("what", choices=("background", *POLICIES))
    parser.add_argument("--scenario", required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--begin", type=float, required=True, help="s since midnight")
    parser.add_argument("--end", type=float, required=True, help="s since midnight")
    parser.add_argument("--folder", type=Path, required=True, help="of routes and histories")
    parser.add_argument("--core", type=int, help="to stay on")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    if options.core is not None:
        os.sched_setaffinity(0, {options.core})
    result = _background(options) if options.what == "background" else _arm(options)
    print(json.dumps(result))


def _background(options: argparse.Namespace) -> dict[str, object]:
    """The trips' routes, and SUMO with the RSUs' windows: all that a day's background takes."""
    began = time.monotonic()
    scenario = load_scenario(options.scenario)
    background = prepare(scenario, options.seed, options.folder)
    prepared_s = time.monotonic() - began
    order = day_spec(scenario, background, options.folder, begin_s=options.begin, end_s=options.end)
    day = run_day(order)
    return {
        **_named(options, began),
        "prepared_s": prepared_s,
        "trips": day.statistics.inserted,
        "faults": AcceptanceLimits().faults(day),
    }


def _arm(options: argparse.Namespace) -> dict[str, object]:
    """One arm, its route file and its history being there."""
    span_s = options.begin, options.end
    world = World(WorldFiles(options.scenario), options.folder, "actuated", span_s)
    began = time.monotonic()
    result = world.simulate(POLICIES[options.what], options.seed, lambda _now, _end: None)
    return {
        **_named(options, began),
        "legs": len(result.legs),
        "steps": round((options.end - options.begin) / STEP_S),
    }


def _named(options: argparse.Namespace, began: float) -> dict[str, object]:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return {
        "what": options.what,
        "scenario": options.scenario,
        "seed": options.seed,
        "hours": (options.end - options.begin) / 3600,
        "wall_s": time.monotonic() - began,
        "cpu_s": sum(u.ru_utime + u.ru_stime for u in used),
    }


if __name__ == "__main__":
    main()
