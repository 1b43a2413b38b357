"""A scenario's roads: a net read and found fit, cut down to the part in which every place can be
reached from every other."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from simulation.sumo import check_files, check_vehicle_files, elements
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork, build_network
from slipstream.sumo_net import load_network

_MIN_SHARE: Final = 0.8
"""Smallest share of the road length in the largest part."""


def scenario_network(path: Path) -> RoadNetwork:
    """Read a net and keep its largest strongly connected part.

    Raises:
        InputError: no SUMO net, no signals in it, or a net in pieces.
    """
    check_files(path, ())
    network = largest_part(load_network(path), path)
    if not network.signals:
        raise InputError(
            path, "no junction has signals", "build it with signals (netconvert --tls.guess)"
        )
    return network


def largest_part(network: RoadNetwork, source: str | Path) -> RoadNetwork:
    """The largest part in which each segment leads to each other one, by allowed turns.

    Raises:
        InputError: it holds less than four fifths of the road length.
    """
    names = tuple(network.segments)
    index = {name: i for i, name in enumerate(names)}
    turns = [(index[a], index[b]) for a in names for b in network.follows.get(a, ())]
    before, after = np.array(turns, dtype=np.int64).reshape(-1, 2).T
    graph = csr_array((np.ones(len(turns)), (before, after)), shape=(len(names), len(names)))
    count, part = connected_components(graph, connection="strong")
    length_m = np.array([network.segments[name].length_m for name in names])
    sizes = np.bincount(part, weights=length_m, minlength=count)
    largest = int(sizes.argmax())
    share = sizes[largest] / sizes.sum()
    if share < _MIN_SHARE:
        raise InputError(
            source,
            f"a net in pieces: the largest part has {share:.0%} of its road length",
            "connect it, or keep one part (netconvert --keep-edges.components 1)",
        )
    if count == 1:
        return network
    kept = {name for name in names if part[index[name]] == largest}
    segments = [network.segments[name] for name in names if name in kept]
    ends = {end for segment in segments for end in (segment.start, segment.end)}
    return build_network(
        network.name,
        segments,
        {name: place for name, place in network.junctions.items() if name in ends},
        {name: tuple(b for b in network.follows.get(name, ()) if b in kept) for name in kept},
        signals=network.signals & ends,
        crossings=network.crossings,
        source=str(source),
    )


def check_routes(path: Path, segments: Iterable[str]) -> None:
    """Check that a route file belongs to a net: every edge that its routes name is a segment.

    Raises:
        InputError: it cannot be read, has no vehicle, or names another net's edge.
    """
    check_vehicle_files((path,))
    known, vehicles = set(segments), 0
    for element in elements(path):
        edges = element.get("edges", "").split() if element.tag == "route" else []
        for end in ("from", "to"):
            edges += [element.get(end, "")] if element.tag in ("trip", "flow") else []
        strange = next((edge for edge in edges if edge and edge not in known), None)
        if strange is not None:
            raise InputError(
                path,
                f"a route over {strange!r}, which the net has not",
                "give the route file of this net",
                key=element.get("id"),
            )
        if element.tag in ("vehicle", "trip", "flow"):
            vehicles += 1
            element.clear()
    if not vehicles:
        raise InputError(path, "no vehicle in it", "give a route file")
