"""A scenario's roads: a net read and found fit, cut down to the part in which a car can reach every
place from every other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from slipstream.osm import largest_part
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from slipstream.vehicle_types import RoutingProfile
from slipstream_lab.simulation.sumo import check_files

_CAR: Final = RoutingProfile()


@dataclass(frozen=True)
class LeftOut:
    """Segments of a net that a scenario does not use: the fleet neither drives nor delivers there.
    `unconnected`: that cannot be reached from the largest part, or from which it cannot be.
    """

    closed: int
    unconnected: int
    of: int

    def __str__(self) -> str:
        return (
            f"{self.closed + self.unconnected} of {self.of} edges are left out: "
            f"{self.unconnected} from which a car cannot drive to all others and back, "
            f"{self.closed} closed to cars; the net's own traffic uses them"
        )


def scenario_network(path: Path) -> RoadNetwork:
    """Read a net and keep its largest part; see `cut_network`. Raises InputError: no SUMO net, or
    no two segments lead to each other.
    """
    return cut_network(path)[0]


def cut_network(path: Path) -> tuple[RoadNetwork, LeftOut | None]:
    """Read a net and keep its largest part; and what that leaves out, None: nothing. Raises
    InputError: no SUMO net, or no two segments lead to each other.
    """
    check_files(path, ())
    whole = load_network(path)
    network = largest_part(whole, path)
    if len(network.segments) == len(whole.segments):
        return network, None
    closed = sum(not whole.admits(name, _CAR) for name in whole.segments)
    unconnected = len(whole.segments) - len(network.segments) - closed
    return network, LeftOut(closed, unconnected, len(whole.segments))
