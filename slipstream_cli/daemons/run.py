"""`slipstream run`: everything on one machine, with embedded defaults."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from pathlib import Path

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings, check
from slipstream.errors import InputError
from slipstream_cli.daemons.bus_counts import BusCounts
from slipstream_cli.daemons.demo import make_clips, write_settings
from slipstream_cli.daemons.local import check_port_is_free, locked, watch
from slipstream_cli.daemons.supervisor import Supervisor


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "run", help="the demo on this machine: two RSUs on video, dispatcher, dashboard"
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
        signal.signal(number, lambda *_: stopping.set())
    with locked(options.state):
        check_port_is_free(options.port)
        return _run(options, stopping)


def _run(options: argparse.Namespace, stopping: threading.Event) -> int:
    supervisor = Supervisor(sys.stderr)
    supervisor.say("slipstream", "making the roadside clips (once, about a minute)")
    clips = make_clips(options.state / "clips", stopping)
    if stopping.is_set():
        return 0
    with Router() as router, Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        counts = BusCounts()
        counts.listen(bus)
        files = write_settings(
            options.state / "settings",
            clips,
            bus_endpoint=router.endpoint,
            database=options.state / "slipstream.db",
            dashboard_port=options.port,
            interval_s=options.interval,
            hardware=options.hardware,
        )
        address = f"http://127.0.0.1:{options.port}"
        try:
            for name, (command, path) in files.items():
                supervisor.start(name, (command, "--config", str(path)))
            status = watch(supervisor, address, options.seconds, stopping)
        finally:
            supervisor.stop()
    if options.json:
        figures = counts.summary() | {
            "dashboard_http": status,
            "processes_restarted": supervisor.restarted,
        }
        print(json.dumps(figures))
    if supervisor.refused:
        return 2
    return 1 if supervisor.given_up else 0
