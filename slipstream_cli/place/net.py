"""`slipstream net`: segments and junctions by street, by id, or near a place."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from slipstream.config import DEMO_NETWORK
from slipstream.errors import InputError
from slipstream.service.logs import complain
from slipstream_cli.place.streets import matching, place_of, streets_of

if TYPE_CHECKING:
    from slipstream.roads import RoadNetwork, Segment

_MPS_TO_KMH: Final = 3.6
_KM_M: Final = 1000.0
_FAR_M: Final = 300.0
"""From the nearest segment: further away a place is perhaps not one of this net."""
_COMPASS: Final = (
    *("east", "north-east", "north", "north-west"),
    *("west", "south-west", "south", "south-east"),
)


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("net", help="segments and junctions by street, id or place")
    kinds = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    find = kinds.add_parser(
        "find",
        help="the segments and junctions of a street, of an id, or near a place",
        description="Lists segments with id, length, allowed speed, direction and junctions: those "
        "of a street, by a name that need not be exact; those that meet at a junction, by its id "
        "or as 'A Street & B Street'; those whose ids hold what is given; or those nearest to a "
        "place, with where a stop there is served.",
    )
    find.add_argument(
        "query",
        metavar="NAME|ID|LAT,LON",
        help="a street's name, two with & between; the id of a segment or junction, or a part of "
        "it; or latitude and longitude, where the net has no projection x and y in m; write -- "
        "before a place that begins with a minus",
    )
    find.add_argument("--limit", type=int, default=20, help="segments to list at most")
    find.set_defaults(run=run_find)
    show = kinds.add_parser("show", help="a short summary of the net")
    show.set_defaults(run=run_show)
    for action in (find, show):
        action.add_argument(
            "--net", default=DEMO_NETWORK, metavar="NET", help="a SUMO net, or 'demo'"
        )
        action.add_argument("--json", action="store_true", help="print one JSON object")


def run_find(options: argparse.Namespace) -> int:
    """Print what is found; bad input if nothing is."""
    from slipstream.roads.snapping import NO_CLASSES, lacks_classes
    from slipstream.roads.sumo_net import load_network

    if options.limit < 1:
        raise InputError("--limit", f"{options.limit} is too few", "give 1 or more")
    network = load_network(options.net)
    place = place_of(options.query, network)
    names: tuple[str, ...] = ()
    here: tuple[str, ...] = ()
    away_m, stop = None, None
    if place is not None:
        found = _near(network, place, options.limit)
        total = len(found)
        away_m = min((row["distance_m"] for row in found), default=None)
        stop = _stop(network, place)
    else:
        names, here, chosen = matching(options.query, network)
        found, total = [_facts(network, s) for s in chosen[: options.limit]], len(chosen)
    if far := away_m is not None and away_m > _FAR_M:
        away = _length(away_m or 0.0)
        complain(f"slipstream: {options.query}: {away} from the nearest segment of {options.net}")
    junctions = _junctions(network, here or _ends(found))
    if options.json:
        answer = {"query": options.query, "streets": list(names), "found": total}
        if place is not None:
            answer |= {"distance_m": away_m, "far": far, "stop": stop}
        print(json.dumps({**answer, "segments": found, "junctions": junctions}))
        return 0
    for row in found:
        away = f", {row['distance_m']:g} m away" if "distance_m" in row else ""
        print(
            f"{row['id']}: {row['street'] or 'no name'}, {row['direction']}, "
            f"{row['length_m']:g} m, "
            f"{row['speed_limit_kmh']:g} km/h, lanes: {row['lanes']}, "
            f"{row['road_class'] + ', ' if row['road_class'] else ''}"
            f"{row['start']} -> {row['end']}{away}"
        )
    if total > len(found):
        print(f"and {total - len(found)} more: --limit {total}")
    print("junctions: " + ", ".join(f"{j['id']} ({_at(j)})" for j in junctions))
    if place is not None:
        print("stop: " + _told(stop))
        if lacks_classes(network):
            print(f"stop: {NO_CLASSES}")
    return 0


def run_show(options: argparse.Namespace) -> int:
    """Print what the net has."""
    from slipstream.roads.sumo_net import load_network

    network = load_network(options.net)
    x_min, y_min, x_max, y_max = network.bounds_m()
    named = [name for name in streets_of(network) if name]
    summary: dict[str, Any] = {
        "net": options.net,
        "segments": len(network.segments),
        "km": round(sum(s.length_m for s in network.segments.values()) / 1000, 2),
        "junctions": len(network.junctions),
        "signals": len(network.signals),
        "streets": len(named),
        "width_m": round(x_max - x_min),
        "height_m": round(y_max - y_min),
        "projection": None if network.projection is None else network.projection.parameter,
    }
    if network.projection is not None:
        corners = network.projection.degrees([(x_min, y_min), (x_max, y_max)])
        summary["south_west"], summary["north_east"] = ([*map(_degrees, c)] for c in corners)
    if options.json:
        print(json.dumps(summary))
        return 0
    for key, value in summary.items():
        print(f"{key.replace('_', ' ')}: {'none' if value is None else value}")
    return 0


def _near(network: RoadNetwork, place: tuple[float, float], count: int) -> list[dict[str, Any]]:
    """The nearest segments of any kind, with their distances, m."""
    from slipstream.roads.snapping import Snapper
    from slipstream.vehicle_types import RoutingProfile

    snapper = Snapper(network, [RoutingProfile()], for_stops=False)
    return [
        _facts(network, network.segments[found.segment])
        | {"distance_m": round(found.distance_m, 1), "nearest_junction": found.node}
        for found in snapper.near(place, count)
    ]


def _stop(network: RoadNetwork, place: tuple[float, float]) -> dict[str, Any] | None:
    """Where a stop at a place is served; None: nowhere."""
    from slipstream.roads.snapping import MAX_SNAP_M, Snapper
    from slipstream.vehicle_types import RoutingProfile

    found = Snapper(network, [RoutingProfile()]).nearest(place)
    if found is None or found.distance_m > MAX_SNAP_M:
        return None
    return {
        "node": found.node,
        "distance_m": round(found.to_node_m, 1),
        "segment": found.segment,
        "to_segment_m": round(found.distance_m, 1),
    }


def _told(stop: dict[str, Any] | None) -> str:
    if stop is None:
        return "none is served here; no road near it is for stops"
    return (
        f"served at {stop['node']}, {stop['distance_m']:g} m away, an end of {stop['segment']}, "
        f"{stop['to_segment_m']:g} m from the place"
    )


def _facts(network: RoadNetwork, segment: Segment) -> dict[str, Any]:
    (x0, y0), (x1, y1) = segment.shape[0], segment.shape[-1]
    return {
        "id": segment.id,
        "street": segment.name,
        "road_class": segment.road_class,
        "length_m": round(segment.length_m, 1),
        "speed_limit_kmh": round(segment.speed_limit_mps * _MPS_TO_KMH, 1),
        "lanes": segment.lanes,
        "direction": compass(x1 - x0, y1 - y0),
        "start": segment.start,
        "end": segment.end,
    }


def _length(metres: float) -> str:
    return f"{metres:.0f} m" if metres < _KM_M else f"{metres / _KM_M:.1f} km"


def _ends(rows: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """The ends of segments, each once."""
    return tuple(dict.fromkeys(row[end] for row in rows for end in ("start", "end")))


def _junctions(network: RoadNetwork, names: Sequence[str]) -> list[dict[str, Any]]:
    """Junctions with their coordinates."""
    found = []
    for name in names:
        x, y = network.junctions[name]
        row = {"id": name, "x_m": round(x, 1), "y_m": round(y, 1)}
        if network.projection is not None:
            ((lat, lon),) = network.projection.degrees([(x, y)])
            row |= {"lat": _degrees(lat), "lon": _degrees(lon)}
        found.append(row)
    return found


def _at(junction: dict[str, Any]) -> str:
    names = ("lat", "lon") if "lat" in junction else ("x_m", "y_m")
    return ",".join(f"{junction[name]}" for name in names)


def _degrees(value: float) -> float:
    return round(value, 6)


def compass(dx: float, dy: float) -> str:
    """Direction of travel in words; x is east and y north."""
    return _COMPASS[round(math.atan2(dy, dx) / (math.pi / 4)) % len(_COMPASS)]
