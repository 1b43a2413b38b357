"""Where roadside units stand: which stretches of which segments each one watches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from math import hypot
from pathlib import Path
from typing import Annotated

from pydantic import Field

from slipstream.config import Settings, load
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream.roads import RoadNetwork


class Stretch(Settings):
    """A watched part of a segment; distances from its beginning."""

    segment: Identifier
    from_m: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    to_m: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    from_lane: Annotated[int, Field(ge=0)] = Field(
        default=0,
        description="Rightmost lane that is watched, 0 is the road's; so lanes for leaving and "
        "joining a motorway can be left out.",
    )

    def holds(self, middle_m: float, lane: int) -> bool:
        """Whether a vehicle whose middle is there is watched."""
        return lane >= self.from_lane and self.from_m <= middle_m < self.to_m


class Rsu(Settings):
    """One roadside unit."""

    id: Identifier
    watch: Annotated[tuple[Stretch, ...], Field(min_length=1)]
    keep_s: Annotated[float, Field(ge=0, le=3600)] = Field(
        default=0.0, description="As `stability.keep_s` of its edge daemon."
    )


class RsuFile(Settings):
    """The content of an RSU file."""

    rsus: Annotated[tuple[Rsu, ...], Field(min_length=1)]


def load_rsus(path: Path, network: RoadNetwork) -> tuple[Rsu, ...]:
    """Read the RSUs of a scenario and check them against its network.

    Raises:
        InputError: the file is malformed, an id twice, a segment that the network has not, or a
            stretch or a lane that does not lie on it.
    """
    rsus = load(path, RsuFile).rsus
    twice = next((name for name, n in Counter(rsu.id for rsu in rsus).items() if n > 1), None)
    if twice is not None:
        raise InputError(path, "two RSUs with this id", "rename one", key=twice)
    for rsu in rsus:
        for stretch in rsu.watch:
            segment = network.segments.get(stretch.segment)
            key = f"{rsu.id}.watch.{stretch.segment}"
            if segment is None:
                problem = f"no segment {stretch.segment!r} in net {network.name!r}"
                raise InputError(path, problem, "name one of the net", key=key)
            if not stretch.from_m < stretch.to_m <= segment.length_m:
                raise InputError(
                    path,
                    f"{stretch.from_m:g} to {stretch.to_m:g} m of a segment of "
                    f"{segment.length_m:.0f} m",
                    "mend from_m and to_m",
                    key=key,
                )
            if stretch.from_lane >= segment.lanes:
                problem = f"lane {stretch.from_lane} of a segment of {segment.lanes}"
                raise InputError(path, problem, "lanes count from 0 at the right", key=key)
    return rsus


def place_rsus(
    network: RoadNetwork,
    passages: Mapping[str, int],
    count: int = 12,
    *,
    min_m: float = 150.0,
    max_m: float = 300.0,
    setback_m: float = 60.0,
    min_spacing_m: float = 600.0,
) -> tuple[Rsu, ...]:
    """RSUs on the busiest approaches that are long enough and not too near each other.

    Args:
        passages: vehicles a day over each segment.
        min_m: shortest stretch worth watching.
        max_m: longest that a unit can watch, with two cameras back to back.
        setback_m: between the stretch and the junction: what lies nearer is a queue most of the
            time, whatever the traffic does.
        min_spacing_m: least distance of the junctions that RSUs stand at.

    Returns:
        Fewer than ``count`` where there are no more.
    """
    chosen: list[Rsu] = []
    taken: list[tuple[float, float]] = []
    for name in sorted(passages, key=lambda name: (-passages[name], name)):
        segment = network.segments[name]
        place = network.junctions[segment.end]
        near = any(hypot(place[0] - x, place[1] - y) < min_spacing_m for x, y in taken)
        if len(chosen) == count or segment.length_m < min_m + setback_m or near:
            continue
        end_m = round(segment.length_m - setback_m, 1)
        begin_m = max(0.0, round(end_m - max_m, 1))
        stretch = Stretch(segment=name, from_m=begin_m, to_m=end_m)
        chosen.append(Rsu(id=f"rsu-{len(chosen) + 1:02}", watch=(stretch,)))
        taken.append(place)
    return tuple(chosen)
