"""`slipstream world`: the closed loop live. SUMO drives, RSUs watch it, plans move its vehicles."""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream.service import set_from_handler
from slipstream_cli.progress import ProgressLine
from slipstream_lab.commands.live.bus_counts import BusCounts
from slipstream_lab.commands.live.local import check_ports_are_free, locked, watch
from slipstream_lab.commands.live.movement import FleetMovement
from slipstream_lab.commands.live.supervisor import Supervisor
from slipstream_lab.commands.sumo_files import add_options, scenario_name, sumo_files

if TYPE_CHECKING:
    from slipstream_lab.simulation.live.process import WorldProcess
    from slipstream_lab.simulation.live.world_spec import WorldCounts

_REPORT_S = 60.0
_BEGIN_S = 27000.0
_DAY_S = 86400.0


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "world",
        help="the closed loop live: SUMO before cameras, plans move vehicles",
        epilog="A world of your own: --net, and what belongs to it; see docs/world.md.",
    )
    command.add_argument("--scenario", help="troy (default), corridor, or a name")
    command.add_argument("--net", type=Path, help="another SUMO net than the scenario's")
    command.add_argument("--demand", type=Path, help="another demand (TOML)")
    add_options(command)
    command.add_argument("--fleet", type=Path, help="another fleet (TOML)")
    command.add_argument("--rsu-file", type=Path, help="other RSUs (TOML)")
    command.add_argument(
        "--begin",
        metavar="HH:MM",
        help="simulated time of day (default 07:30; of a SUMO configuration: 5 min after its own)",
    )
    command.add_argument(
        "--rsus", type=int, default=2, metavar="N", help="RSUs with a camera (default 2)"
    )
    command.add_argument("--fps", type=float, default=10.0, help="pictures a second (default 10)")
    command.add_argument(
        "--priority", action="store_true", help="vehicles may ask signals for green"
    )
    command.add_argument("--interval", type=float, default=60.0, help="seconds between cycles")
    command.add_argument("--seed", type=int, default=1, help="of traffic, orders and scenery")
    command.add_argument("--port", type=int, default=8080, help="dashboard's port (default 8080)")
    command.add_argument(
        "--state",
        type=Path,
        default=Path(".slipstream") / "world",
        help="folder for routes, settings and database",
    )
    command.add_argument("--seconds", type=float, help="stop after so long (default: run on)")
    command.add_argument("--json", action="store_true", help="print one JSON object at the end")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run until Ctrl-C, or for ``--seconds`` after the world has opened."""
    for name, low, high in (
        ("fps", 5.0, 30.0),
        ("interval", 2.0, 86400.0),
        ("rsus", 1, 100),
        ("seed", 0, 2**31 - 1),
    ):
        value = getattr(options, name)
        if not low <= value <= high:
            raise InputError(f"--{name}", f"{value:g} is out of range", f"give {low:g} to {high:g}")
    if options.seconds is not None and not options.seconds > 0:
        raise InputError("--seconds", f"{options.seconds:g} is out of range", "give more than 0")
    begin_s = None if options.begin is None else time_of_day_s(options.begin)
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: set_from_handler(stopping))
    with locked(options.state):
        check_ports_are_free(options.port)
        return _run(options, begin_s, stopping)


def time_of_day_s(text: str) -> float:
    """Seconds since midnight of ``HH:MM``. Raises InputError: it is no time of day."""
    match = re.fullmatch(r"(\d{1,2}):(\d{2})", text)
    if match is None or int(match[1]) > 23 or int(match[2]) > 59:
        raise InputError("--begin", f"{text!r} is no time of day", "give HH:MM, 00:00 to 23:59")
    return 3600.0 * int(match[1]) + 60.0 * int(match[2])


def _run(options: argparse.Namespace, begin_s: float | None, stopping: threading.Event) -> int:
    from slipstream_cli.place.site_file import write_site
    from slipstream_lab.commands.live.world_daemons import place_of_world
    from slipstream_lab.simulation.live.prepare import WARM_UP_S, prepare_world
    from slipstream_lab.simulation.live.process import WorldProcess, check_simulator

    check_simulator()
    files = sumo_files(options)
    name, from_s = scenario_name(options, files), files.begin_s or 0.0
    if begin_s is None:
        begin_s = _BEGIN_S if files.begin_s is None else from_s + WARM_UP_S
    if not from_s <= begin_s < _DAY_S:
        raise InputError(
            "--begin",
            f"{begin_s:g} s is not within the day's traffic",
            f"give {from_s:g} s or more, within the day",
        )
    supervisor = Supervisor(sys.stderr)
    with Router() as router, Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        prepared = prepare_world(
            name,
            options.state,
            BusSettings(connect=(router.endpoint,)),
            net=files.net,
            demand=options.demand,
            routes=files.routes,
            additional=files.additional,
            rsus=options.rsu_file,
            fleet=options.fleet,
            from_s=from_s,
            begin_s=begin_s,
            cameras=options.rsus,
            fps=options.fps,
            priority=options.priority,
            seed=options.seed,
            say=lambda line: supervisor.say("slipstream", line),
        )
        bus_counts, movement = BusCounts(), FleetMovement()
        bus_counts.listen(bus)
        movement.listen(bus)
        supervisor.say("slipstream", f"filling the roads of {name}")
        with WorldProcess(prepared) as world, ProgressLine("filling the roads", sys.stderr) as bar:
            cameras = world.open(stopping.is_set, lambda share: bar.update(round(100 * share), 100))
            if stopping.is_set():
                return 0
            place = place_of_world(
                options.state,
                prepared,
                cameras,
                bus_endpoint=router.endpoint,
                dashboard_port=options.port,
                interval_s=options.interval,
            )
            daemons = write_site(options.state / "site.toml", place)
            for camera in cameras:
                supervisor.say(
                    camera.rsu, f"{', '.join(camera.segments)}: pictures at {camera.url}"
                )
            try:
                for name, words in daemons.items():
                    supervisor.start(name, words)
                look = _world_monitor(world, supervisor)
                status = watch(supervisor, options.port, options.seconds, stopping, look)
            finally:
                supervisor.stop()
        counts = world.counts
    if options.json:
        figures = bus_counts.summary() | {
            **movement.summary(),
            "dashboard_http": status,
            "processes_restarted": supervisor.restarted,
            "world": None if counts is None else asdict(counts),
        }
        print(json.dumps(figures))
    if supervisor.refused:
        return 2
    return 1 if supervisor.given_up else 0


def _world_monitor(world: WorldProcess, supervisor: Supervisor) -> Callable[[float], None]:
    """A callback that reads the world's messages and logs its counts once a minute."""
    reported_s = 0.0

    def look(elapsed_s: float) -> None:
        nonlocal reported_s
        world.poll()
        if elapsed_s - reported_s >= _REPORT_S and world.counts is not None:
            reported_s = elapsed_s
            supervisor.say("world", minute_line(world.counts))

    return look


def minute_line(counts: WorldCounts) -> str:
    """The world's minute in a line."""
    # Later, as the command's other parts of the simulation.
    from slipstream_lab.simulation.fleet.safety import MAX_TELEPORTED

    minutes = round(counts.time_s / 60)
    line = (
        f"{minutes // 60:02}:{minutes % 60:02}, {counts.vehicles} vehicles on the road, "
        f"{counts.fleet_on_road} of the fleet; {counts.tours_begun} tours begun, "
        f"{counts.orders_served} orders served, {counts.orders_waiting} wait; "
        f"{counts.frames} pictures"
    )
    if counts.frames_skipped:
        line += f", {counts.frames_skipped} left out"
    for whose, found in (("fleet", counts.safety), ("others", counts.others)):
        line += f"; {whose}: {found.words}" if found.words else ""
    if counts.others.is_doubtful:
        line += f", above {MAX_TELEPORTED:.0%} of {counts.others.trips} trips: BLOCKED ROADS"
    if counts.slipped_s > 1.0:
        line += f"; {counts.slipped_s:.0f} s behind: this machine is too slow for it"
    return line
