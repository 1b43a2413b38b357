"""Vehicles that pass the cross-section in the middle of a watched segment, each once: a pure
counter of one segment. See docs/perception.md, "Counts".

A track whose vehicle was upstream of the cross-section and is downstream of it has passed. Tracks
break, so a new track goes on with an older one that ended where its vehicle can have come from; and
one that begins downstream, moves on and has no such predecessor passed before it was seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Final, Literal

import numpy as np

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.camera.pose import CameraPose
from edge_daemon.features.kinematics import VehicleMotion
from edge_daemon.features.trajectories import NOMINAL_LENGTH_M, GroupedSightings, to_centre
from edge_daemon.tracking import Sightings

Found = Literal["seen", "joined", "inferred"]
"""How a passage is known: one track was seen on both sides, two were joined, or a track began
downstream of the cross-section."""

_CLEAR_M: Final = 1.5
"""A vehicle has passed once its middle is so far downstream: one that stands on the cross-section
has not, whatever single boxes say."""
_MOVED_M: Final = 4.0
"""A track that begins downstream has come from upstream if it moves on by so much."""
_NEAR_M: Final = 15.0
"""Whether a vehicle is on this segment is judged so near to the cross-section."""
_MARGIN_M: Final = 25.0
_BESIDE_M: Final = 6.0
"""Vehicles that are seen further before, behind or beside the segment are none of its."""
_BLOCK: Final = 3
"""Places are medians of so many sightings: one box may jump."""
_TAIL_S: Final = 1.0
_MIN_SPEED_S: Final = 0.2
_ENDED_S: Final = 5.0
_STOOD_S: Final = 120.0
"""A vehicle whose track has ended is looked for so long; one that was slow longer: it waits, hidden
by others."""
_SLOW_MPS: Final = 2.0
_ACROSS_M: Final = 1.8
_ALONG_M: Final = 3.5
_SPEED_LAG_S: Final = 1.5
"""A speed is smoothed with what is seen for so long after the passage."""
_MOST_PATHS: Final = 2000


@dataclass(frozen=True)
class Passage:
    """A vehicle that has passed.

    Attributes:
        time_s: media time at which its middle passed.
        vehicle_class: index into VEHICLE_CLASSES.
        speed_mps: at the passage, with its standard error; None where its motion is not known.
    """

    time_s: float
    vehicle_class: int
    found: Found
    speed_mps: float | None = None
    speed_std_mps: float | None = None


@dataclass(eq=False)
class _Path:
    """What is known of one vehicle, whose tracks may be several.

    Attributes:
        begin: time and place at which it was seen first.
        tail: times and places of the last second, shape (n, 2).
        place_m: where it was seen last.
        speed_mps: along the segment over that second; None: it was seen for too short a time.
        low_m: the least of its places.
        below: the last sighting upstream of the cross-section, and the one after it.
        inside: sightings near the cross-section, and those of them on the segment; then of all.
        passed: whether it has passed, counted or before anybody looked.
    """

    tracks: set[int]
    begin: tuple[float, float]
    across_m: float
    vehicle_class: int
    tail: Array
    place_m: float = math.nan
    speed_mps: float | None = None
    low_m: float = math.inf
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None
    inside: Array = field(default_factory=lambda: np.zeros(4))
    joined: bool = False
    passed: bool = False

    @property
    def seen_s(self) -> float:
        return float(self.tail[-1, 0])

    @property
    def is_on_segment(self) -> bool:
        near, near_on, every, on = self.inside
        return bool(2 * near_on >= near if near else 2 * on >= every)

    def remember(self, tail: Array) -> None:
        """Keep the sightings of the last second, and what they say of place and speed."""
        self.tail = tail[tail[:, 0] >= tail[-1, 0] - _TAIL_S]
        first, last = self.tail[:_BLOCK].tolist(), self.tail[-_BLOCK:].tolist()
        begin_s, begin_m, end_s, end_m = (
            median(one[column] for one in block) for block in (first, last) for column in (0, 1)
        )
        self.place_m = end_m
        time_s = end_s - begin_s
        self.speed_mps = (end_m - begin_m) / time_s if time_s >= _MIN_SPEED_S else None


class PassageCounter:
    """Counts one segment's vehicles, from one call to the next.

    Attributes:
        place_m: of the cross-section, as the segment's `along` counts.
    """

    def __init__(self, segment: WatchedSegment, pose: CameraPose | None) -> None:
        self._segment, self._pose = segment, pose
        self.place_m = segment.begin_m + segment.length_m / 2
        across = segment.polygon_m @ segment.left
        self._edges_m = float(across.min()), float(across.max())
        self._paths: dict[int, _Path] = {}
        self._pending: list[tuple[Passage, _Path]] = []
        self._from_s = -math.inf
        self._lost = 0

    def begin(self, from_s: float, *, cut: bool = False) -> None:
        """Watching begins at a media time, or goes on after a pause; cut: with another scene."""
        self._from_s = from_s
        if cut:
            self._paths.clear()

    def reset(self) -> None:
        """Forget all that was not taken: it is not to be trusted."""
        self._paths.clear()
        self._pending.clear()

    def update(self, now_s: float, fresh: Sightings | None) -> None:
        """Take in the sightings since the last call, in order of their frames."""
        for track, rows, kind in self._by_track(fresh):
            path = self._paths.get(track)
            if path is None:
                path = self._paths[track] = self._follow_on(track, rows, kind)
            self._extend(path, rows, kind)
        self._decide_all(_CLEAR_M)
        self._forget(now_s)

    def finish(self) -> None:
        """No sighting comes any more: who is downstream now has passed, however near."""
        self._decide_all(0.0)

    def take(self, now_s: float, vehicles: Sequence[VehicleMotion]) -> list[Passage]:
        """The passages that are as well known as they will be, with speeds from motions that were
        smoothed up to a media time.
        """
        taken, kept = [], []
        motions = {vehicle.track: vehicle for vehicle in vehicles}
        for passage, path in self._pending:
            if now_s - passage.time_s < _SPEED_LAG_S:
                kept.append((passage, path))
                continue
            speed, deviation = _speed(passage.time_s, path, motions)
            taken.append(
                Passage(passage.time_s, path.vehicle_class, passage.found, speed, deviation)
            )
        self._pending = kept
        return taken

    def lost(self) -> int:
        """Vehicles since the last call whose tracks ended upstream while they drove and that were
        not found again: whether they passed is not known.
        """
        lost, self._lost = self._lost, 0
        return lost

    def _by_track(self, fresh: Sightings | None) -> list[tuple[int, Array, int]]:
        """Track, sightings and class of each vehicle near the segment, the first one first.

        A sighting: time, place along and across, whether on the segment; shape (n, 4).
        """
        if fresh is None:
            return []
        segment = self._segment
        along, across = segment.along(fresh.point_m), fresh.point_m @ segment.left
        low, high = segment.begin_m - _MARGIN_M, segment.end_m + _MARGIN_M
        right, left = self._edges_m
        beside = (across < right - _BESIDE_M) | (across > left + _BESIDE_M)
        rows = np.flatnonzero((along >= low) & (along <= high) & ~beside)
        if not len(rows):
            return []
        rows = rows[np.lexsort((fresh.time_s[rows], fresh.track[rows]))]
        begins = np.flatnonzero(np.diff(fresh.track[rows], prepend=-1))
        vehicle = np.repeat(np.arange(len(begins)), np.diff([*begins, len(rows)]))
        middle = fresh.point_m[rows] + to_centre(
            GroupedSightings(fresh, rows, vehicle), segment, self._pose
        )
        table = np.column_stack(
            [
                fresh.time_s[rows],
                segment.along(middle),
                middle @ segment.left,
                segment.contains(middle),
            ]
        )
        found = [
            (
                int(fresh.track[rows[first]]),
                part,
                int(fresh.vehicle_class[rows[first + len(part) - 1]]),
            )
            for first, part in zip(begins, np.split(table, begins[1:]), strict=True)
        ]
        return sorted(found, key=lambda each: float(each[1][0, 0]))

    def _follow_on(self, track: int, rows: Array, kind: int) -> _Path:
        """The path of a track that begins: that of a vehicle which is known, or its own."""
        time_s, along_m = rows[0, :2].tolist()
        across_m = float(np.median(rows[:_BLOCK, 2]))
        best, least = None, 1.0
        for path in {id(path): path for path in self._paths.values()}.values():
            came_back = path.passed and along_m < self.place_m - _CLEAR_M
            if abs(path.across_m - across_m) > _ACROSS_M or came_back:
                continue
            off = _misfit(path, time_s, along_m)
            if off < least:
                best, least = path, off
        if best is None:
            return _Path({track}, (time_s, along_m), across_m, kind, rows[:0, :2])
        best.joined |= best.seen_s < time_s
        best.tracks.add(track)
        return best

    def _extend(self, path: _Path, rows: Array, kind: int) -> None:
        places = rows[:, :2]
        joined = np.concatenate([path.tail[-1:], places])
        below = np.flatnonzero(joined[:, 1] <= self.place_m)
        if len(below):
            last = int(below[-1])
            path.below, path.above = (float(joined[last, 0]), float(joined[last, 1])), None
            if last + 1 < len(joined):
                path.above = float(joined[last + 1, 0]), float(joined[last + 1, 1])
        path.low_m = min(path.low_m, _lowest(places[:, 1]))
        near, on = np.abs(places[:, 1] - self.place_m) <= _NEAR_M, rows[:, 3] > 0
        path.inside += (near.sum(), (near & on).sum(), len(on), on.sum())
        tail = np.concatenate([path.tail, places])
        path.remember(tail[np.argsort(tail[:, 0], kind="stable")])
        path.across_m = float(np.median(rows[-_BLOCK:, 2]))
        path.vehicle_class = kind

    def _decide_all(self, clear_m: float) -> None:
        for path in {id(path): path for path in self._paths.values()}.values():
            if not path.passed and path.is_on_segment:
                place_m = path.place_m if clear_m else float(path.tail[-1, 1])
                if place_m >= self.place_m + clear_m:
                    self._decide(path, place_m)

    def _decide(self, path: _Path, place_m: float) -> None:
        """Whether one that is downstream has come from upstream."""
        if path.low_m <= self.place_m and path.below is not None:
            found: Found = "joined" if path.joined else "seen"
            (begin_s, begin_m), (end_s, end_m) = path.below, path.above or path.below
            share = (self.place_m - begin_m) / max(end_m - begin_m, 1e-6)
            self._pass(path, begin_s + min(1.0, share) * (end_s - begin_s), found)
            return
        begin_s, begin_m = path.begin
        if place_m - begin_m < _MOVED_M:
            return
        speed = (place_m - begin_m) / max(path.seen_s - begin_s, 1e-3)
        self._pass(path, begin_s - (begin_m - self.place_m) / speed, "inferred")

    def _pass(self, path: _Path, time_s: float, found: Found) -> None:
        path.passed = True
        if time_s >= self._from_s or found != "inferred":
            self._pending.append((Passage(time_s, path.vehicle_class, found), path))

    def _forget(self, now_s: float) -> None:
        gone = []
        for track, path in self._paths.items():
            speed = path.speed_mps or 0.0
            if now_s - path.seen_s > (_ENDED_S if speed > _SLOW_MPS else _STOOD_S):
                gone.append(track)
                begin_m, end_m = self._segment.begin_m, self.place_m
                is_upstream = begin_m < path.place_m < end_m and not path.passed
                if speed > _SLOW_MPS and is_upstream and path.is_on_segment:
                    self._lost += track == min(path.tracks)
        for track in gone:
            del self._paths[track]
        for track in list(self._paths)[: max(0, len(self._paths) - _MOST_PATHS)]:
            del self._paths[track]


def _lowest(places_m: Array) -> float:
    """The least of the medians of blocks."""
    whole = len(places_m) // _BLOCK * _BLOCK
    if not whole:
        return float(median(places_m.tolist()))
    middle = np.sort(places_m[:whole].reshape(-1, _BLOCK), axis=1)[:, _BLOCK // 2]
    return float(middle.min())


def _misfit(path: _Path, time_s: float, along_m: float) -> float:
    """How badly a track that begins at a time and place goes on with a path; above 1: it does not.

    A path that is seen still is the same vehicle where the other begins on its body.
    """
    gone_s = time_s - path.seen_s
    speed = path.speed_mps
    if gone_s <= 0:
        before = path.tail[path.tail[:, 0] <= time_s]
        place_m = float(before[-1, 1]) if len(before) else path.place_m
        return abs(along_m - place_m) / (NOMINAL_LENGTH_M[path.vehicle_class] / 2 + 0.5)
    moved_m = along_m - path.place_m
    if speed is None:
        return abs(moved_m - 10.0 * gone_s) / (_ALONG_M + 10.0 * gone_s) if gone_s < 1.0 else 2.0
    if gone_s > _ENDED_S:
        return 2.0 if speed > _SLOW_MPS else abs(moved_m) / (2 * _ALONG_M)
    free_m = _ALONG_M + 0.2 * abs(speed) * gone_s + gone_s**2 / 2
    return abs(moved_m - speed * gone_s) / free_m


def _speed(
    time_s: float, path: _Path, motions: dict[int, VehicleMotion]
) -> tuple[float | None, float | None]:
    """Speed at a passage and its standard error, m/s, from the smoothed motion of that time."""
    for track in path.tracks:
        vehicle = motions.get(track)
        if vehicle is None:
            continue
        times = vehicle.motion.time_s
        if times[0] <= time_s <= times[-1]:
            return (
                float(np.interp(time_s, times, vehicle.motion.speed_mps)),
                float(np.interp(time_s, times, vehicle.speed_std_mps)),
            )
    return None, None
