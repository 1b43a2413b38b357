"""SUMO's route file of a day."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from heapq import merge
from operator import itemgetter
from pathlib import Path
from xml.sax.saxutils import quoteattr

from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.scenarios.demand.breakdowns import DrawnBreakdown
from slipstream_lab.simulation.scenarios.demand.routes import Routes
from slipstream_lab.simulation.scenarios.demand.trips import Trips, gateways
from slipstream_lab.simulation.sumo import TYPES


def write_routes(
    path: Path,
    trips: Trips,
    routes: Routes,
    network: RoadNetwork,
    breakdowns: Sequence[DrawnBreakdown] = (),
) -> None:
    """Write SUMO's route file of a day; byte for byte the same for the same arguments.

    Vehicles are named ``b0``, ``b1`` ... in the order of departure. They start and end in the
    middle of a block, at gateways at the segment's beginning and end. Those that break down are
    ``breakdown-`` and their name.
    """
    lines = "".join(f"{line}\n" for line in _lines(trips, routes, network, breakdowns))
    path.write_text(f"<routes>\n{lines}</routes>\n", encoding="utf-8")


def _lines(
    trips: Trips, routes: Routes, network: RoadNetwork, breakdowns: Sequence[DrawnBreakdown]
) -> Iterable[str]:
    for kind in TYPES.values():
        yield "    " + kind.xml()
    for number, way in enumerate(routes.ways):
        edges = " ".join(routes.segments[i] for i in way)
        yield f'    <route id="r{number}" edges={quoteattr(edges)}/>'
    # SUMO takes vehicles in the order of departure.
    standing = ((b.begin_s, _broken_down(b)) for b in breakdowns)
    driving = zip(trips.depart_s, _vehicles(trips, routes, network), strict=True)
    for _, line in merge(driving, standing, key=itemgetter(0)):
        yield line


def _broken_down(standing: DrawnBreakdown) -> str:
    lane = f"{standing.segment}_0"
    return (
        f'    <vehicle id={quoteattr("breakdown-" + standing.name)} type="car" '
        f'depart="{standing.begin_s:.1f}" departLane="0" departPos="base" departSpeed="max" '
        f'arrivalPos="max" speedFactor="1.000"><route edges={quoteattr(standing.segment)}/>'
        f'<stop lane={quoteattr(lane)} endPos="{standing.at_m:.1f}" '
        f'until="{standing.end_s:.1f}"/></vehicle>'
    )


def _vehicles(trips: Trips, routes: Routes, network: RoadNetwork) -> Iterable[str]:
    ends = gateways(network)
    lengths = {name: segment.length_m for name, segment in network.segments.items()}
    for i in range(len(trips)):
        way = routes.ways[routes.of_trip[i]]
        start, end = trips.place[i] * (
            lengths[routes.segments[way[0]]],
            lengths[routes.segments[way[-1]]],
        )
        if len(way) == 1 and end <= start + 1:
            start, end = min(start, end), max(start, end)
        at = "base" if trips.junctions[trips.origin[i]] in ends else f"{start:.1f}"
        to = "max" if trips.junctions[trips.destination[i]] in ends else f"{end:.1f}"
        yield (
            f'    <vehicle id="b{i}" type="{trips.types[trips.kind[i]]}" '
            f'route="r{routes.of_trip[i]}" depart="{trips.depart_s[i]:.1f}" departLane="best" '
            f'departPos="{at}" departSpeed="max" arrivalPos="{to}" '
            f'speedFactor="{trips.speed_factor[i]:.3f}"/>'
        )
