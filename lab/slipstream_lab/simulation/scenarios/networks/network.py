"""A scenario's roads: a net read and found fit, cut down to the part in which a car can reach every
place from every other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from slipstream.errors import InputError
from slipstream.roads import RoadNetwork, build_network
from slipstream.sumo_net import load_network
from slipstream.vehicle_types import RoutingProfile
from slipstream_lab.simulation.sumo import check_files

_CAR: Final = RoutingProfile()
_MIN_SEGMENTS: Final = 2


@dataclass(frozen=True)
class LeftOut:
    """Segments of a net that a scenario does not use: the fleet neither drives nor delivers there.

    Attributes:
        closed: that a car may not use.
        unconnected: that cannot be reached from the largest part, or from which it cannot be.
        of: segments of the whole net.
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
    """Read a net and keep its largest part; see `cut_network`.

    Raises:
        InputError: no SUMO net, or no two segments lead to each other.
    """
    return cut_network(path)[0]


def cut_network(path: Path) -> tuple[RoadNetwork, LeftOut | None]:
    """Read a net and keep its largest part; and what that leaves out, None: nothing.

    Raises:
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


def largest_part(network: RoadNetwork, source: str | Path) -> RoadNetwork:
    """The largest part, by length, in which a car can drive from each segment to each other one;
    turns that a car may not take are none of its turns.

    Raises:
        InputError: no two segments lead to each other.
    """
    names = tuple(name for name in network.segments if network.admits(name, _CAR))
    apart = InputError(
        source,
        "a net in pieces: no two segments lead to each other by car",
        "connect them (junctions, turns, permissions of lanes)",
    )
    if not names:
        raise apart
    index = {name: i for i, name in enumerate(names)}
    follows = {
        a: tuple(
            b for b in network.follows.get(a, ()) if b in index and network.admits_turn(a, b, _CAR)
        )
        for a in names
    }
    turns = [(index[a], index[b]) for a in names for b in follows[a]]
    before, after = np.array(turns, dtype=np.int64).reshape(-1, 2).T
    graph = csr_array((np.ones(len(turns)), (before, after)), shape=(len(names), len(names)))
    count, part = connected_components(graph, connection="strong")
    length_m = np.array([network.segments[name].length_m for name in names])
    sizes = np.bincount(part, weights=length_m, minlength=count)
    # One segment alone is no part to drive rounds in, however long it is.
    sizes[np.bincount(part, minlength=count) < _MIN_SEGMENTS] = 0.0
    if sizes.max() <= 0:
        raise apart
    kept = {name for name in names if part[index[name]] == int(sizes.argmax())}
    follows = {a: tuple(b for b in follows[a] if b in kept) for a in names if a in kept}
    if all(follows.get(name) == network.follows.get(name, ()) for name in network.segments):
        return network
    segments = [network.segments[name] for name in names if name in kept]
    ends = {end for segment in segments for end in (segment.start, segment.end)}
    return build_network(
        network.name,
        segments,
        {name: place for name, place in network.junctions.items() if name in ends},
        follows,
        signals=network.signals & ends,
        crossings=network.crossings,
        turn_classes={
            (a, b): classes
            for (a, b), classes in network.turn_classes.items()
            if b in follows.get(a, ())
        },
        projection=network.projection,
        left_hand=network.left_hand,
        source=str(source),
    )
