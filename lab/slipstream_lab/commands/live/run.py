"""`slipstream run`: everything on one machine, with embedded defaults."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings, check
from slipstream.errors import InputError
from slipstream.service import set_from_handler
from slipstream_cli.place.site_file import write_site
from slipstream_lab.commands.live.bus_counts import BusCounts
from slipstream_lab.commands.live.demo import make_clips, place_of_demo
from slipstream_lab.commands.live.local import check_ports_are_free, locked, watch
from slipstream_lab.commands.live.movement import FleetMovement
from slipstream_lab.commands.live.supervisor import Supervisor

if TYPE_CHECKING:
    from slipstream_lab.simulation.live.process import WorldProcess


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "run",
        help="the demo: two RSUs on video, a town's vans, dispatcher, page",
    )
    command.add_argument("--port", type=int, default=8080, help="dashboard's port (default 8080)")
    command.add_argument(
        "--state", type=Path, default=Path(".slipstream"), help="folder for clips and database"
    )
    command.add_argument("--interval", type=float, default=30.0, help="seconds between cycles")
    command.add_argument(
        "--hardware",
        default="",
        metavar="BACKEND",
        help="a quantum device beside the solvers: fake:FakeBoston, ibm:NAME or ibm:least-busy",
    )
    command.add_argument("--seconds", type=float, help="stop after so long (default: run on)")
    command.add_argument("--json", action="store_true", help="print one JSON object at the end")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run until Ctrl-C, or for ``--seconds``."""
    if not 1.0 <= options.interval <= 86400.0:
        raise InputError("--interval", f"{options.interval:g} is out of range", "give 1 to 86400")
    if options.seconds is not None and not options.seconds > 0:
        raise InputError("--seconds", f"{options.seconds:g} is out of range", "give more than 0")
    if options.hardware:
        from dispatcher_daemon.settings import HardwareSettings

        check({"backend": options.hardware}, HardwareSettings, "--hardware")
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: set_from_handler(stopping))
    with locked(options.state):
        check_ports_are_free(options.port)
        return _run(options, stopping)


def _run(options: argparse.Namespace, stopping: threading.Event) -> int:
    supervisor = Supervisor(sys.stderr)
    supervisor.say("slipstream", "making the roadside clips (once, about a minute)")
    clips = make_clips(options.state / "clips", stopping)
    if stopping.is_set():
        return 0
    with (
        Router() as router,
        Bus.open(BusSettings(connect=(router.endpoint,))) as bus,
        ExitStack() as stack,
    ):
        counts, movement = BusCounts(), FleetMovement()
        counts.listen(bus)
        movement.listen(bus)
        town = _open_town(options.state / "town", router, stack, supervisor, stopping)
        place = place_of_demo(
            clips,
            bus_endpoint=router.endpoint,
            database=options.state / "slipstream.db",
            dashboard_port=options.port,
            interval_s=options.interval,
            hardware=options.hardware,
            town=None if town is None else town.spec,
            tours=options.state / "agents",
        )
        daemons = write_site(options.state / "site.toml", place)
        try:
            for name, words in daemons.items():
                supervisor.start(name, words)
            look = _town_monitor(town, supervisor)
            status = watch(supervisor, options.port, options.seconds, stopping, look)
        finally:
            supervisor.stop()
    if options.json:
        of_town = None if town is None else town.counts
        figures = counts.summary() | {
            **movement.summary(),
            "town": None if of_town is None else asdict(of_town),
            "dashboard_http": status,
            "processes_restarted": supervisor.restarted,
        }
        print(json.dumps(figures))
    if supervisor.refused:
        return 2
    return 1 if supervisor.given_up else 0


def _open_town(
    folder: Path,
    router: Router,
    stack: ExitStack,
    supervisor: Supervisor,
    stopping: threading.Event,
) -> WorldProcess | None:
    """Start the town's vans; None where SUMO is not installed, or cannot run it."""
    try:
        from slipstream_lab.simulation.live.process import WorldProcess, check_simulator
        from slipstream_lab.simulation.live.town import town

        check_simulator()
        process = WorldProcess(town(folder, BusSettings(connect=(router.endpoint,))))
        stack.enter_context(process)
        process.open(stopping.is_set, lambda share: None)
    except ModuleNotFoundError as error:
        supervisor.say("town", f"no vans drive: {error.name} is not installed (slipstream-lab)")
        return None
    except (InputError, ChildProcessError) as error:
        supervisor.say("town", f"no vans drive: {error}")
        return None
    return process


def _town_monitor(town: WorldProcess | None, supervisor: Supervisor) -> Callable[[float], None]:
    """A callback that reads the town's messages; its end leaves the daemons alone."""
    ended = town is None

    def look(_: float) -> None:
        nonlocal ended
        if town is None or ended:
            return
        try:
            town.poll()
        except (InputError, ChildProcessError) as error:
            ended = True
            supervisor.say("town", f"the vans have stopped: {error}")

    return look
