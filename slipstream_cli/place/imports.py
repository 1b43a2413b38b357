"""`slipstream import`: what others have made becomes ours."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slipstream.errors import InputError
from slipstream_cli.laboratory import find_part
from slipstream_cli.place.maps import add_map_options, assumptions, extract_name

if TYPE_CHECKING:
    from slipstream.osm import Import
    from slipstream.roads import RoadNetwork


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "import", help="a road network from OpenStreetMap, or instances of published sets"
    )
    kinds = command.add_subparsers(dest="kind", required=True, metavar="KIND")
    osm = kinds.add_parser(
        "osm",
        help="a SUMO net from an OpenStreetMap extract (needs netconvert)",
        description="Builds a SUMO net of the roads for cars, says what it left out and why, and "
        "writes a small fleet file to begin with.",
    )
    osm.add_argument(
        "extract", type=Path, metavar="FILE", help=".osm or .osm.xml (also .gz, .bz2), or .osm.pbf"
    )
    osm.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write into")
    add_map_options(osm)
    osm.add_argument("--json", action="store_true", help="print a summary as JSON")
    osm.set_defaults(run=run_osm)
    add_sets = find_part("import-sets")
    if add_sets is not None:
        add_sets(kinds)


def run_osm(options: argparse.Namespace) -> int:
    """Build the net, and tell what is in it and what to do with it."""
    from slipstream.osm import import_osm, largest_part
    from slipstream.roads.sumo_net import load_network

    name = extract_name(options.extract)
    net, fleet = options.out / f"{name}.net.xml.gz", options.out / f"{name}-fleet.json"
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        found = import_osm(options.extract, net, side=options.driving_side, country=options.country)
        whole = load_network(net)
        network = largest_part(whole, net)
        if not fleet.exists():
            fleet.write_text(json.dumps(_first_fleet(network), indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        problem = error.strerror or "not writable"
        raise InputError(options.out, problem, "give another folder", key="--out") from None
    summary: dict[str, Any] = {
        "net": str(net),
        "fleet": str(fleet),
        "segments": len(whole.segments),
        "km": round(sum(s.length_m for s in whole.segments.values()) / 1000, 1),
        "signals": len(whole.signals),
        "connected_segments": len(network.segments),
        "ways": found.ways,
        "ways_left_out": dict(found.left_out),
        "turn_restrictions": found.restrictions,
        "turn_restrictions_ignored": found.ignored_restrictions,
        "driving_side": found.side.side,
        "driving_side_by": found.side.why,
        "country": found.country,
        "limits_not_signed": [
            {"kmh": kmh, "why": why, "km": round(km, 2)} for (kmh, why), km in found.assumed.items()
        ],
        "netconvert_warnings": dict(found.warnings),
    }
    if options.json:
        print(json.dumps(summary))
        return 0
    _tell(summary, found)
    print(f"\nnext:\n  slipstream init DIR --net {shlex.quote(str(net))}")
    for line in _next_steps(name, net, fleet, options.out):
        print(f"  {line}")
    return 0


def _tell(summary: Mapping[str, Any], found: Import) -> None:
    print(
        f"{summary['net']}: {summary['segments']} segments, {summary['km']:g} km, "
        f"{summary['signals']} junctions with signals, from {summary['ways']} ways"
    )
    print("ways left out:")
    for reason, count in summary["ways_left_out"].items():
        print(f"  {count:7} {reason}")
    ignored, restrictions = summary["turn_restrictions_ignored"], summary["turn_restrictions"]
    print(f"turn restrictions ignored: {ignored} of {restrictions}")
    apart = summary["segments"] - summary["connected_segments"]
    print(f"segments from which a car cannot drive to all others and back: {apart}")
    for line in assumptions(found):
        print(line)


def _next_steps(name: str, net: Path, fleet: Path, out: Path) -> tuple[str, ...]:
    """Commands that work on the net as it is."""
    quoted, called = shlex.quote(str(net)), shlex.quote(name)
    return (
        f"slipstream check {shlex.quote(str(fleet))} --network {quoted}",
        f"slipstream world --scenario {called} --net {quoted}",
        f"slipstream evaluate --scenario {called} --net {quoted} --hours 1 --arms main "
        f"--out {shlex.quote(str(out / 'evaluation'))}",
    )


def _first_fleet(network: RoadNetwork) -> dict[str, Any]:
    """A fleet file of one vehicle and one stop, at the two ends of the network's longest segment
    that is not a loop; of those where vehicles may stop, if there are any."""
    from slipstream.roads.snapping import stopping_junctions

    segments = [s for s in network.segments.values() if s.start != s.end]
    quiet = {*stopping_junctions(network)}
    far = max(segments, key=lambda s: ({s.start, s.end} <= quiet, s.length_m))
    return {
        "depots": [{"id": "depot", "node": far.start}],
        "stops": [{"id": "stop-1", "node": far.end}],
        "vehicles": [{"id": "van-1", "depot": "depot"}],
    }
