"""Vehicles that stand on a segment: each an event of its own, whatever the flag says, known by its
place and not by its track. See docs/perception.md, "Vehicles that stand".
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.features.trajectories import NOMINAL_LENGTH_M
from edge_daemon.tracking import Sightings

STANDS_S: Final = 5.0
MAX_SPEED_MPS: Final = 0.5
GONE_S: Final = 15.0
_END_S: Final = 1.0
"""Places are medians over so long: a box of a vehicle that stands jumps too."""
MEMORY_S: Final = STANDS_S + 1.5 * _END_S
"""Sightings are needed for so long."""
_PRESENT_S: Final = 1.5
_ARRIVED_M: Final = 1.0
"""From where it came to stand it has not been farther away since."""
_SAME_ALONG_M: Final = 4.0
_SAME_ACROSS_M: Final = 1.5
_LEFT_M: Final = 5.0


@dataclass(frozen=True)
class Standing:
    """A vehicle that stands.

    Attributes:
        along_m: place of its middle from the segment's upstream end.
        across_m: and from its right edge.
        since_s: media time at which it came to stand, or was first seen.
        track: its latest track.
    """

    lane: int
    along_m: float
    across_m: float
    since_s: float
    seen_s: float
    track: int


class StoppedVehicleJudge:
    """The vehicles that stand on one segment, from one state to the next: `standing`, the longest
    first.
    """

    def __init__(self, segment: WatchedSegment) -> None:
        self._segment = segment
        self._from_s = -math.inf
        self.standing: tuple[Standing, ...] = ()

    def reset(self, from_s: float = -math.inf) -> None:
        """Forget all: the scene has changed; what was seen before a media time counts no more."""
        self.standing = ()
        self._from_s = max(self._from_s, from_s)

    def update(self, now_s: float, sightings: Sightings | None) -> None:
        """Take in the sightings of the last ten seconds or so, in order of time, at a media time
        later than the last one.
        """
        paths = dict(self._paths(sightings))
        known_tracks = {known.track for known in self.standing}
        found: list[Standing] = []
        for track, path in paths.items():
            place = self._stands(path, track) if now_s - path[-1, 0] <= _PRESENT_S else None
            if place is not None:
                found.append(place)
        kept = []
        for known in self.standing:
            here = next(
                (place for place in found if _same(place.along_m, place.across_m, known)), None
            )
            if here is not None:
                found.remove(here)
                kept.append(replace(here, since_s=min(known.since_s, here.since_s)))
                continue
            own = paths.get(known.track)
            if own is not None and own[-1, 0] > known.seen_s:
                if abs(own[-1, 1] - known.along_m) > _LEFT_M:
                    continue  # it has moved on
                known = replace(known, seen_s=float(own[-1, 0]))
            if now_s - known.seen_s > _PRESENT_S:
                known = _seen_again(known, paths, known_tracks)
                known_tracks.add(known.track)
            if now_s - known.seen_s <= GONE_S:
                kept.append(known)
        self.standing = tuple(sorted([*kept, *found], key=lambda place: place.since_s))

    def _paths(self, sightings: Sightings | None) -> list[tuple[int, Array]]:
        """Of each track: time, place along and across, and whether inside, shape (n, 4)."""
        if sightings is None:
            return []
        sightings = sightings.take(sightings.time_s >= self._from_s)
        if not len(sightings):
            return []
        segment = self._segment
        half = np.array(NOMINAL_LENGTH_M)[sightings.vehicle_class] / 2
        middle = sightings.point_m + sightings.away * half[:, None]
        table = np.column_stack(
            [
                sightings.time_s,
                segment.along(middle) - segment.begin_m,
                middle @ segment.left - segment.right_edge_m,
                segment.contains(middle),
            ]
        )
        order = np.lexsort((sightings.time_s, sightings.track))
        tracks, begins = np.unique(sightings.track[order], return_index=True)
        return list(zip(tracks.tolist(), np.split(table[order], begins[1:]), strict=True))

    def _stands(self, path: Array, track: int) -> Standing | None:
        """Where a track stands; None if it moves, or has been followed for too short a time."""
        end_s = float(path[-1, 0])
        last = np.median(path[path[:, 0] > end_s - _END_S], axis=0)
        before = path[(path[:, 0] > end_s - STANDS_S - _END_S) & (path[:, 0] <= end_s - STANDS_S)]
        if not len(before) or not last[3]:
            return None
        first = np.median(before, axis=0)
        moved_m = float(np.hypot(*(last - first)[1:3]))
        if moved_m > MAX_SPEED_MPS * float(last[0] - first[0]):
            return None
        away = np.hypot(*(path[:, 1:3] - last[1:3]).T) > _ARRIVED_M
        # For the last seconds it stands, whatever single boxes say.
        away &= path[:, 0] <= end_s - STANDS_S
        since_s = float(path[away.nonzero()[0][-1] + 1, 0]) if away.any() else float(path[0, 0])
        lane = int(np.clip(last[2] // self._segment.lane_width_m, 0, self._segment.lanes - 1))
        return Standing(
            lane, max(0.0, float(last[1])), float(last[2]), min(since_s, end_s), end_s, track
        )


def _seen_again(known: Standing, paths: dict[int, Array], but: set[int]) -> Standing:
    """It with the latest other track that is slow at its place, however short; else as it was."""
    for track, path in sorted(paths.items(), key=lambda each: -float(each[1][-1, 0])):
        end_s = float(path[-1, 0])
        if track in but or end_s <= known.seen_s:
            continue
        last = path[path[:, 0] > end_s - _END_S]
        before = path[(path[:, 0] > end_s - 2 * _END_S) & (path[:, 0] <= end_s - _END_S)]
        if not len(before):
            continue
        here, there = np.median(last, axis=0), np.median(before, axis=0)
        slow = np.hypot(*(here - there)[1:3]) <= MAX_SPEED_MPS * (here[0] - there[0])
        if slow and _same(float(here[1]), float(here[2]), known):
            return replace(known, seen_s=end_s, track=track)
    return known


def _same(along_m: float, across_m: float, known: Standing) -> bool:
    return (
        abs(along_m - known.along_m) <= _SAME_ALONG_M
        and abs(across_m - known.across_m) <= _SAME_ACROSS_M
    )
