"""`slipstream init`: the files of one's own place, ready for `slipstream check` and to start."""

from __future__ import annotations

import argparse
import json
import re
import shlex
import shutil
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.config import DEMO_NETWORK
from slipstream.errors import InputError
from slipstream.service.logs import complain
from slipstream_cli.place.maps import add_map_options, assumptions, extract_name
from slipstream_cli.place.streets import place_of

if TYPE_CHECKING:
    from slipstream.roads import RoadNetwork


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "init",
        help="commented files for a place of your own, for all daemons",
        description="Writes a site.toml for all daemons, a fleet and a camera into an empty "
        "folder, with what each key means, and prints how to start.",
    )
    command.add_argument(
        "folder", type=Path, nargs="?", default=Path(), metavar="DIR", help="an empty folder"
    )
    roads = command.add_mutually_exclusive_group()
    roads.add_argument("--net", default=DEMO_NETWORK, metavar="NET", help="a SUMO net, or 'demo'")
    roads.add_argument(
        "--osm", type=Path, metavar="FILE", help="an OpenStreetMap extract, made a net first"
    )
    add_map_options(command)
    command.add_argument(
        "--at",
        metavar="LAT,LON",
        help="the depot is where an address there is served, and never on an expressway, ramp or "
        "in a tunnel; on a net without a projection x and y in m "
        "(default: the middle of the largest connected part)",
    )
    command.add_argument("--rsu", default="rsu-1", help="name of the first roadside unit")
    command.add_argument("--vans", type=int, default=2, help="number of vans")
    command.add_argument(
        "--port",
        type=int,
        default=8080,
        help="of the page, on 127.0.0.1; the 3D view takes the next one",
    )
    command.add_argument("--json", action="store_true", help="print one JSON object")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the files, all or none of them."""
    folder = options.folder.absolute()
    _check_options(options, folder)
    # Made elsewhere: a place that the net lacks leaves no net behind in the folder.
    with tempfile.TemporaryDirectory() as built:
        if options.osm is None:
            demo = options.net == DEMO_NETWORK
            net = DEMO_NETWORK if demo else str(Path(options.net).absolute())
            return _write(options, folder, net, None)
        made = _imported(options, Path(built))
        return _write(options, folder, str(folder / made.name), made)


def _check_options(options: argparse.Namespace, folder: Path) -> None:
    from slipstream_cli.place.files import METRICS_PORTS

    if not 1 <= options.vans <= 100:
        raise InputError("--vans", f"{options.vans} is out of range", "give 1 to 100")
    if not re.fullmatch(r"[\w.-]{1,100}", options.rsu):
        problem = f"{options.rsu!r} is no name of a file"
        raise InputError("--rsu", problem, "take letters, digits, '.', '_' and '-'")
    if not 1 <= options.port <= 65534:
        raise InputError("--port", f"{options.port} is no port", "give 1 to 65534")
    if taken := {options.port, options.port + 1}.intersection(METRICS_PORTS.values()):
        problem = f"{min(taken)} is another daemon's"
        raise InputError("--port", f"{problem}; the 3D view takes the next one", "give another")
    _check_empty(folder)


def _write(options: argparse.Namespace, folder: Path, net: str, made: Path | None) -> int:
    """Write the files for a net, and the net too if it was made."""
    from slipstream.osm import largest_part
    from slipstream.roads.sumo_net import load_network
    from slipstream_cli.place.files import PlaceSite, files_of
    from slipstream_cli.place.layout import lay_out

    network = load_network(net if made is None else str(made))
    part = largest_part(network, net)
    layout = lay_out(part, _place(options.at, network))
    site = PlaceSite(folder, net, layout, options.rsu, options.vans, options.port)
    files = files_of(site)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if made is not None:
            shutil.copyfile(made, net)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        for name in (*files, *(() if made is None else (made.name,))):
            with suppress(OSError):
                (folder / name).unlink()
        raise InputError(folder, error.strerror or "not writable", "give another folder") from None
    street = _street(part, layout.depot)
    commands = start_commands(folder)
    if options.json:
        facts = {
            "folder": str(folder),
            "net": net,
            "depot": layout.depot,
            "street": street,
            "distance_m": None if layout.away_m is None else round(layout.away_m, 1),
        }
        print(json.dumps({**facts, "files": [*files], "start": list(commands)}))
        return 0
    for name in files:
        print(folder / name)
    away = "" if layout.away_m is None else f", {layout.away_m:.0f} m from {options.at}"
    print(f"depot: junction {layout.depot}{f' ({street})' if street else ''}{away}")
    print(f"camera: made up, on segment {layout.watched}; see docs/calibration.md")
    print("\nnext:")
    print(f"  slipstream check {shlex.quote(str(folder))}/*.toml")
    print("\nthen, each in a terminal of its own:")
    for line in commands:
        print(f"  {line}")
    print(f"\nthe page: http://127.0.0.1:{options.port}")
    return 0


def start_commands(folder: Path) -> tuple[str, ...]:
    """The commands that start a place's daemons, the router first."""
    path = shlex.quote(str(folder / "site.toml"))
    daemons = ("dispatcher", "dashboard", "agent", "edge")
    return ("slipstream router", *(f"slipstream {name} --config {path}" for name in daemons))


def _check_empty(folder: Path) -> None:
    if folder.is_dir():
        found = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
        if found:
            some = ", ".join(found[:3]) + (", ..." if len(found) > 3 else "")
            mend = "give an empty or a new folder; --net takes a network from anywhere"
            raise InputError(folder, f"not empty ({some})", mend)
    elif folder.exists():
        raise InputError(folder, "is no folder", "give an empty or a new folder")


def _imported(options: argparse.Namespace, folder: Path) -> Path:
    """The net of an OpenStreetMap extract, in the folder; what it had to assume is told."""
    from slipstream.osm import import_osm

    extract: Path = options.osm
    net = folder / f"{extract_name(extract)}.net.xml.gz"
    if extract.is_file():
        print(f"importing {extract}", file=sys.stderr)
    found = import_osm(extract, net, side=options.driving_side, country=options.country)
    for line in assumptions(found):
        complain(f"slipstream: {line}")
    return net


def _place(text: str | None, network: RoadNetwork) -> tuple[float, float] | None:
    if text is None:
        return None
    place = place_of(text, network)
    if place is None:
        raise InputError("--at", f"{text!r} is no place", "write it like 42.731,-73.677")
    return place


def _street(network: RoadNetwork, junction: str) -> str:
    """Names of the streets that meet at a junction."""
    ends = network.segments.values()
    names = {s.name for s in ends if junction in (s.start, s.end) and s.name}
    return ", ".join(sorted(names))
