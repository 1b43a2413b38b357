"""Vehicles of the scenarios, and SUMO's route files.

All follow the IDM without noise: a noisy car-following model would make any smoother driving look
like a saving.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

from simulation.scenarios.demand import Trips, gateways
from simulation.scenarios.routes import Routes
from slipstream.roads import RoadNetwork


@dataclass(frozen=True)
class VehicleType:
    """A type of vehicle.

    Attributes:
        id: its name in route files.
        vclass: SUMO's class.
        length_m: of the vehicle.
        max_speed_mps: of the vehicle, whatever the limit.
        acceleration_mps2: largest one of the IDM.
        deceleration_mps2: comfortable one of the IDM.
        headway_s: time gap of the IDM.
        min_gap_m: standing gap.
    """

    id: str
    vclass: str
    length_m: float
    max_speed_mps: float
    acceleration_mps2: float
    deceleration_mps2: float
    headway_s: float
    min_gap_m: float = 2.5

    def xml(self) -> str:
        """As SUMO reads it. Speed factors are each vehicle's own, none is drawn.

        Drivers choose their lane early (lcStrategic), else some never reach it in a queue.
        """
        return (
            f'<vType id={quoteattr(self.id)} vClass="{self.vclass}" carFollowModel="IDM" '
            f'length="{self.length_m:g}" minGap="{self.min_gap_m:g}" '
            f'maxSpeed="{self.max_speed_mps:g}" accel="{self.acceleration_mps2:g}" '
            f'decel="{self.deceleration_mps2:g}" emergencyDecel="9" tau="{self.headway_s:g}" '
            f'lcStrategic="3" speedFactor="1" speedDev="0"/>'
        )


TYPES: Final = {
    kind.id: kind
    for kind in (
        VehicleType("car", "passenger", 4.6, 55.0, 1.8, 2.5, 1.2),
        VehicleType("van", "delivery", 5.9, 40.0, 1.5, 2.5, 1.3),
        VehicleType("truck", "truck", 10.0, 25.0, 0.9, 2.0, 1.6),
        VehicleType("cav", "passenger", 4.6, 55.0, 1.8, 2.5, 1.2),
    )
}
"""The background's cars, vans and trucks, and the fleet's: a car like the others where it drives
alone."""


def write_routes(path: Path, trips: Trips, routes: Routes, network: RoadNetwork) -> None:
    """Write SUMO's route file of a day; byte for byte the same for the same arguments.

    Vehicles are named ``b0``, ``b1`` ... in the order of departure. They start and end in the
    middle of a block, at gateways at the segment's beginning and end.
    """
    lines = "".join(f"{line}\n" for line in _lines(trips, routes, network))
    path.write_text(f"<routes>\n{lines}</routes>\n", encoding="utf-8")


def _lines(trips: Trips, routes: Routes, network: RoadNetwork) -> Iterable[str]:
    for name in trips.types:
        yield "    " + TYPES[name].xml()
    for number, way in enumerate(routes.ways):
        edges = " ".join(routes.segments[i] for i in way)
        yield f'    <route id="r{number}" edges={quoteattr(edges)}/>'
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
