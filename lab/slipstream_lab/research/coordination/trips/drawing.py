"""What the laws of freight have in common: pairs of places by weight, windows around a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from slipstream_lab.research.coordination.trips.freight import MS, Freight, FreightSegment, Trip

Array = npt.NDArray[np.float64]
Pairs = Mapping[tuple[str, str], tuple[str, ...]]
"""Ways by (origin, destination)."""


def draw_pairs(
    ways: Pairs, weights: Mapping[str, float], count: int, rng: np.random.Generator
) -> list[tuple[str, str]]:
    """(Origin, destination) of trips: a pair is drawn with the product of its places' weights."""
    pairs = sorted(ways)
    shares = np.array([weights[a] * weights[b] for a, b in pairs])
    drawn = rng.choice(len(pairs), size=count, p=shares / shares.sum())
    return [pairs[k] for k in drawn]


def drawn_freight(
    name: str,
    segments: Mapping[str, FreightSegment],
    paths: Sequence[tuple[str, ...]],
    preferred_s: Array,
    window_min: float,
    carriers: Sequence[str],
) -> Freight:
    """Trips that may arrive up to ``window_min`` before and after they would if they left at
    ``preferred_s``; they are ready for the earliest of that.
    """
    window_ms = round(60 * MS * window_min)
    trips: list[Trip] = []
    for path, at_s, carrier in zip(paths, preferred_s.tolist(), carriers, strict=True):
        preferred_ms = round(MS * at_s)
        arrival_ms = preferred_ms + sum(segments[part].duration_ms for part in path)
        ready_ms, latest_ms = preferred_ms - window_ms, arrival_ms + window_ms
        trips.append(Trip(f"t{len(trips) + 1}", carrier, path, ready_ms, latest_ms))
    return Freight(name, segments, tuple(trips))
