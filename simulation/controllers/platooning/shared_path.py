"""The path that two vehicles share, and where on it the gates are open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simulation.controllers.vehicle import VehicleState


@dataclass(frozen=True)
class PathPosition:
    """Position of a vehicle on its path.

    Attributes:
        path: its segments.
        numbers: of the segments in the path, the last one of those that it drives twice.
        state: of the vehicle.
    """

    path: tuple[str, ...]
    numbers: Mapping[str, int]
    state: VehicleState

    def along_m(self, lengths: Mapping[str, float]) -> float:
        """Of its front along the segment; in the junction behind it, beyond the segment's end."""
        state = self.state
        return state.front_m + (lengths[state.segment] if state.crossing else 0.0)


@dataclass(frozen=True)
class SharedPath:
    """Segments that the rear vehicle will drive behind the front one.

    Attributes:
        spacing_m: between both fronts along the path.
        parts: segments from the rear one's on to the last common one, each with the distance from
            the rear one's front to its end, m.
    """

    spacing_m: float
    parts: tuple[tuple[str, float], ...]

    def open_distance_m(self, is_open: Callable[[str], bool]) -> float:
        """From the rear one's front to where the gates stop being open, m; 0 where they are not."""
        run = 0.0
        for segment, end_m in self.parts:
            if not is_open(segment):
                break
            run = end_m
        return run

    def open_beyond_m(self, begin_m: float, is_open: Callable[[str], bool]) -> float:
        """Metres with open gates from a distance ahead of the rear one on."""
        total, last = 0.0, 0.0
        for segment, end_m in self.parts:
            if end_m > begin_m and is_open(segment):
                total += end_m - max(begin_m, last)
            last = end_m
        return total


def find_shared_path(
    rear: PathPosition, front: PathPosition, lengths: Mapping[str, float], max_distance_m: float
) -> SharedPath | None:
    """What a vehicle has in common with one ahead of it; None if it is not ahead or too far.

    Lengths of junctions are left out.
    """
    meets = rear.numbers.get(front.state.segment, -1)
    start = rear.state.number
    if meets < start:
        return None
    end_m = -rear.along_m(lengths)
    parts = []
    for segment in rear.path[start:meets]:
        end_m += lengths[segment]
        parts.append((segment, end_m))
        if end_m > max_distance_m:
            return None
    spacing_m = end_m + front.along_m(lengths)
    if meets > start:
        # The rear one may have come farther into the junction between than the front one beyond it.
        spacing_m = max(spacing_m, 0.0)
    elif spacing_m <= 0:
        return None
    if spacing_m > max_distance_m:
        return None
    for mine, other in zip(rear.path[meets:], front.path[front.state.number :], strict=False):
        if mine != other:
            break
        end_m += lengths[mine]
        parts.append((mine, end_m))
    return SharedPath(spacing_m, tuple(parts))
