"""The way that two vehicles still have in common, and where on it platoons may be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from simulation.closed_loop.vehicle import LegOrder, VehicleState


@dataclass(frozen=True)
class SharedWay:
    """Segments that the rear vehicle will drive behind the front one.

    Attributes:
        between_m: from the rear one's front to the front one's front, along their way.
        parts: segments from the rear one's on to the last common one, each with the distance from
            the rear one's front to its end, m.
    """

    between_m: float
    parts: tuple[tuple[str, float], ...]

    def open_run_m(self, is_open: Callable[[str], bool]) -> float:
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


def place_m(state: VehicleState, lengths: Mapping[str, float]) -> float:
    """Of a front along its segment; in the junction behind it, beyond the segment's end."""
    return state.front_m + (lengths[state.segment] if state.crossing else 0.0)


def shared_way(
    rear: tuple[LegOrder, VehicleState],
    front: tuple[LegOrder, VehicleState],
    lengths: Mapping[str, float],
    farthest_m: float,
) -> SharedWay | None:
    """What a vehicle has in common with one ahead of it; None if it is not ahead or too far.

    Lengths of junctions are left out.
    """
    rear_path, front_path = rear[0].path, front[0].path
    start = rear[1].number
    meets = _find(rear_path, start, front[1].segment)
    if meets is None:
        return None
    end_m = -place_m(rear[1], lengths)
    parts = []
    for segment in rear_path[start:meets]:
        end_m += lengths[segment]
        parts.append((segment, end_m))
    between_m = end_m + place_m(front[1], lengths)
    if not 0 < between_m <= farthest_m:
        return None
    for mine, other in zip(rear_path[meets:], front_path[front[1].number :], strict=False):
        if mine != other:
            break
        end_m += lengths[mine]
        parts.append((mine, end_m))
    return SharedWay(between_m, tuple(parts))


def _find(path: Sequence[str], start: int, segment: str) -> int | None:
    return next((i for i in range(start, len(path)) if path[i] == segment), None)
