"""What a signal's own detectors see: the lanes before it, how many stand there, how many come."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property

import libsumo


class Detectors:
    """The lanes before one intersection of the running simulation."""

    def __init__(self, intersection: str) -> None:
        self._intersection = intersection

    @cached_property
    def lanes(self) -> Mapping[int, tuple[str, ...]]:
        """By signal group, the lanes that it lets go."""
        found: dict[int, list[str]] = {}
        links = libsumo.trafficlight.getControlledLinks(self._intersection)
        for group, connections in enumerate(links):
            for before, _, _ in connections:
                # Lanes inside a junction belong to pedestrians.
                if not before.startswith(":"):
                    found.setdefault(group, []).append(before)
        return {group: tuple(lanes) for group, lanes in found.items()}

    def queue(self, group: int) -> float:
        """Vehicles that stand before a group's stop line, on one lane on average."""
        segment = self.lanes[group][0].rpartition("_")[0]
        standing: int = libsumo.edge.getLastStepHaltingNumber(segment)
        lanes: int = libsumo.edge.getLaneNumber(segment)
        return standing / max(1, lanes)

    def count(self, groups: Iterable[int]) -> int:
        """Vehicles on the lanes of some groups."""
        lanes = {lane for group in groups for lane in self.lanes.get(group, ())}
        return sum(int(libsumo.lane.getLastStepVehicleNumber(lane)) for lane in sorted(lanes))
