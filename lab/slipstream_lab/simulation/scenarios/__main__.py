"""Builds scenarios' nets and simulates their background: ``python -m
slipstream_lab.simulation.scenarios``.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from slipstream.config import load
from slipstream.errors import InputError
from slipstream.osm import import_osm
from slipstream_lab.simulation.scenarios.acceptance import AcceptanceLimits, clock
from slipstream_lab.simulation.scenarios.day import run_day
from slipstream_lab.simulation.scenarios.demand import DrawnBreakdown, draw_deliveries
from slipstream_lab.simulation.scenarios.networks import (
    CorridorSettings,
    build_net,
    corridor_plan,
    scenario_network,
    troy_plan,
    write_fixed_time,
)
from slipstream_lab.simulation.scenarios.record import SimulatedDay
from slipstream_lab.simulation.scenarios.scenario import (
    day_spec,
    load_scenario,
    made_up,
    prepare,
)


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 2 on bad input, with one line."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        extra = "sim" if error.name == "libsumo" else "sim,dispatcher"
        line = f"error: {error.name}: not installed; pip install 'slipstream[{extra}]'"
        print(line, file=sys.stderr)
        return 2


def build(options: argparse.Namespace) -> int:
    """Build a net from its sources, with its fixed-time signals beside it."""
    net = options.out / f"{options.world}.net.xml.gz"
    if options.world == "osm":
        if options.extract is None:
            raise InputError("build osm", "no extract", "give --extract FILE", key="--extract")
        import_osm(options.extract, net)
    elif options.world == "corridor":
        shape = (
            CorridorSettings() if options.shape is None else load(options.shape, CorridorSettings)
        )
        build_net(corridor_plan(shape), net)
    else:
        build_net(troy_plan(options.sources), net)
    network = scenario_network(net)
    signals = write_fixed_time(net, options.out / f"{options.world}-fixed.add.xml")
    km = sum(segment.length_m for segment in network.segments.values()) / 1000
    print(f"{net}: {len(network.segments)} segments, {km:.0f} km, {signals} signals")
    return 0


def day(options: argparse.Namespace) -> int:
    """Simulate a day's background, write its figures, and refuse it if it is not fit."""
    if not 0 <= options.begin < options.end <= 24:
        problem = f"from {options.begin:g} to {options.end:g} is no part of a day"
        raise InputError("day", problem, "give hours from 0 to 24", key="--begin")
    if options.seed < 0:
        raise InputError("day", f"{options.seed} is no seed", "give 0 or more", key="--seed")
    scenario = load_scenario(
        options.scenario,
        net=options.net,
        demand=options.demand,
        rsus=options.rsus,
        fleet=options.fleet,
        routes=options.routes,
        additional=options.additional,
    )
    if scenario.left_out is not None:
        print(f"{scenario.net}: {scenario.left_out}", file=sys.stderr)
    background = prepare(scenario, options.seed, options.out)
    for line in made_up(scenario, background, options.seed):
        print(f"made up: {line}", file=sys.stderr)
    order = day_spec(
        scenario,
        background,
        options.out,
        signals=options.signals,
        begin_s=options.begin * 3600.0,
        end_s=options.end * 3600.0,
    )

    def show(now_s: float, _: float) -> None:
        if sys.stderr.isatty():
            print(f"\r{scenario.name} {clock(now_s)}", end="", file=sys.stderr, flush=True)

    simulated = run_day(order, show)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    faults = AcceptanceLimits().faults(simulated)
    _write(options.out, scenario.name, options.seed, simulated, faults, background.breakdowns)
    found = simulated.statistics
    if options.json:
        print((options.out / f"{scenario.name}-{options.seed}.json").read_text(), end="")
    else:
        for first, hour in enumerate(simulated.hours, start=int(simulated.begin_s // 3600)):
            stable = f" {hour.stable_share:5.0%} stable" if hour.judged else ""
            print(
                f"{first:02}:00 {hour.speed_mps * 3.6:5.1f} km/h {hour.running:6.0f} vehicles "
                f"{hour.stops_per_km:5.2f} stops/km {hour.waiting_share:5.0%} standing{stable}"
            )
        print(
            f"{found.inserted} of {found.loaded} trips, {simulated.wall_s:.0f} s; "
            f"{'fit' if not faults else 'refused'}"
        )
    AcceptanceLimits().check(simulated, f"{scenario.name}, seed {options.seed}")
    return 0


def fleet(options: argparse.Namespace) -> int:
    """Tell how large a day's deliveries are."""
    from slipstream_lab.simulation.scenarios.sizing import fleet_size

    scenario = load_scenario(options.scenario, net=options.net, fleet=options.fleet)
    if options.seed < 0:
        raise InputError("fleet", f"{options.seed} is no seed", "give 0 or more", key="--seed")
    deliveries = draw_deliveries(scenario.fleet, scenario.network, options.seed)
    size = fleet_size(deliveries, scenario.network)
    print(
        f"{size.served} of {size.orders} orders in {size.rounds} rounds: "
        f"{size.distance_km:.0f} km, {size.time_h:.1f} h; "
        f"{len(size.departures)} cycles send somebody, "
        f"{sum(count > 1 for count in size.departures)} more than one"
    )
    return 0


def _write(
    folder: Path,
    name: str,
    seed: int,
    day: SimulatedDay,
    faults: tuple[str, ...],
    breakdowns: Sequence[DrawnBreakdown],
) -> None:
    """Figures as JSON, hours as CSV."""
    figures = {
        "scenario": name,
        "seed": seed,
        "begin_s": day.begin_s,
        "end_s": day.end_s,
        **asdict(day.statistics),
        "gridlock_s": day.gridlock_s,
        "breakdowns": [asdict(standing) for standing in breakdowns],
        "faults": faults,
        "wall_s": round(day.wall_s, 1),
    }
    (folder / f"{name}-{seed}.json").write_text(json.dumps(figures, indent=1) + "\n")
    with (folder / f"{name}-{seed}-hours.csv").open("w", newline="", encoding="utf-8") as file:
        rows = [asdict(hour) for hour in day.hours]
        writer = csv.DictWriter(file, ["hour", *rows[0]], lineterminator="\n")
        writer.writeheader()
        for first, row in enumerate(rows, start=int(day.begin_s // 3600)):
            rounded = {k: "" if math.isnan(v) else round(v, 4) for k, v in row.items()}
            writer.writerow({"hour": first, **rounded})


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.simulation.scenarios", description=__doc__
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    make = commands.add_parser("build", help="build a net from its sources (needs netconvert)")
    make.add_argument("world", choices=("troy", "corridor", "osm"))
    make.add_argument("--out", type=Path, required=True, help="folder to write into")
    make.add_argument("--sources", type=Path, help="troy: folder with junctions.csv and roads.csv")
    make.add_argument("--shape", type=Path, help="corridor: its parameters (TOML)")
    make.add_argument("--extract", type=Path, help="osm: an OpenStreetMap extract")
    make.set_defaults(run=build)
    simulate = commands.add_parser("day", help="simulate a day's background and judge it")
    simulate.add_argument("scenario", help="troy, corridor, or a name of your own with --net")
    simulate.add_argument("--seed", type=int, default=1)
    simulate.add_argument("--out", type=Path, required=True, help="folder to write into")
    for part, what in (
        ("net", "SUMO net"),
        ("demand", "demand (TOML)"),
        ("rsus", "RSUs (TOML)"),
        ("fleet", "fleet (TOML)"),
    ):
        simulate.add_argument(f"--{part}", type=Path, help=f"{what} instead of the scenario's")
    for part, what in (
        ("routes", "SUMO route file instead of the demand"),
        ("additional", "SUMO additional file"),
    ):
        simulate.add_argument(
            f"--{part}", type=Path, action="append", default=[], help=f"{what}; more than one too"
        )
    simulate.add_argument("--signals", choices=("actuated", "fixed"), default="actuated")
    simulate.add_argument("--begin", type=float, default=0.0, help="hour of the day")
    simulate.add_argument("--end", type=float, default=24.0, help="hour of the day")
    simulate.add_argument("--json", action="store_true")
    simulate.set_defaults(run=day)
    count = commands.add_parser("fleet", help="how large a day's deliveries are")
    count.add_argument("scenario", help="troy, corridor, or a name of your own with --net")
    count.add_argument("--seed", type=int, default=1)
    count.add_argument("--net", type=Path, help="SUMO net instead of the scenario's")
    count.add_argument("--fleet", type=Path, help="fleet (TOML) instead of the scenario's")
    count.set_defaults(run=fleet)
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
