"""Sightings → trajectories of vehicles along a segment: binned positions, ready for smoothing.

All vehicles are handled at once, in arrays of one row a sighting.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, WatchedSegment
from edge_daemon.camera.pose import CameraPose
from edge_daemon.features.centreline import Centreline
from edge_daemon.features.smoother import Positions, bin_positions
from edge_daemon.tracking import Indices, Sightings

MIN_TRACKED_S: Final = 1.0
MIN_SIGHTINGS: Final = 8
_SEARCH_MARGIN_M: Final = 25.0
_PLACES: Final = 8
_MAX_PAUSE_S: Final = 1.0
_ONCOMING_M: Final = 5.0
_WRONG_WAY_M: Final = 15.0
_WRONG_WAY_MPS: Final = 3.0
_INSIDE_M: Final = 0.5
MARGIN_M: Final = 15.0
"""So far before and behind the segment positions still help to smooth those within."""
NOMINAL_LENGTH_M: Final = (4.5, 8.5, 12.0, 2.2)
"""Length by vehicle class, m: turns distances between vehicles into gaps."""
NOMINAL_SIZE_M: Final = ((1.8, 1.5), (2.4, 3.0), (2.5, 3.1), (0.8, 1.6))
"""Width and height by vehicle class, m: what makes a box's lower edge differ from the middle."""

VehicleKey = tuple[int, float, float, int]


@dataclass(frozen=True)
class Trajectory:
    """One vehicle's trajectory along a segment: binned positions of its centre, three at least, and
    when it was first and last seen near the segment.
    """

    track: int
    positions: Positions
    first_s: float
    last_s: float
    lane: int
    length_m: float


@dataclass(frozen=True)
class GroupedSightings:
    """The rows (n,) of a table of sightings that are of some vehicles, one vehicle after the other,
    each in order of time, and each row's vehicle, numbered from 0 without gaps.
    """

    sightings: Sightings
    rows: Indices
    vehicle: Indices

    def keys(self) -> list[VehicleKey]:
        """A key for each vehicle that changes with its sightings."""
        first, last = _ends(self.vehicle)
        track, time = self.sightings.track, self.sightings.time_s
        begin, end = self.rows[first], self.rows[last]
        columns = track[begin], time[begin], time[end], last - first + 1
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def take(self, vehicles: npt.NDArray[np.bool_]) -> GroupedSightings:
        """Some of the vehicles, given by a mask (v,), renumbered from 0."""
        kept = np.flatnonzero(vehicles[self.vehicle])
        number = np.cumsum(vehicles) - 1
        return GroupedSightings(self.sightings, self.rows[kept], number[self.vehicle[kept]])


def group_by_vehicle(sightings: Sightings, segment: WatchedSegment) -> GroupedSightings:
    """The sightings of each vehicle that was in the segment; the sightings come in any order."""
    near = segment.along(sightings.point_m)
    low, high = (
        segment.begin_m - _SEARCH_MARGIN_M,
        segment.begin_m + segment.length_m + _SEARCH_MARGIN_M,
    )
    rows = np.flatnonzero((near >= low) & (near <= high))
    rows = rows[np.lexsort((sightings.time_s[rows], sightings.track[rows]))]
    # After a longer gap the vehicle was elsewhere, or the track is another vehicle's.
    paused = np.diff(sightings.time_s[rows], prepend=0.0) > _MAX_PAUSE_S
    begins = (np.diff(sightings.track[rows], prepend=-1) != 0) | paused
    vehicle = np.cumsum(begins) - 1
    inside = segment.contains(sightings.point_m.take(rows, axis=0) + _half_length(sightings, rows))
    often = np.bincount(vehicle) >= MIN_SIGHTINGS
    return GroupedSightings(sightings, rows, vehicle).take(
        often & (np.bincount(vehicle, inside) >= 2)
    )


def find_trajectories(
    grouped: GroupedSightings,
    segment: WatchedSegment,
    pose: CameraPose | None,
    centreline: Centreline,
) -> list[Trajectory | None]:
    """Each vehicle's trajectory; None for one that is not of this segment or seen too little.
    Without a pose, vehicles' middles are guessed from their lengths.
    """
    rows, vehicle = grouped.rows, grouped.vehicle
    if not len(rows):
        return []
    seen = grouped.sightings
    middle = seen.point_m.take(rows, axis=0) + to_centre(grouped, segment, pose)
    along = segment.along(middle)
    low, high = segment.begin_m - MARGIN_M, segment.begin_m + segment.length_m + MARGIN_M
    near = (along >= low) & (along <= high)
    inside = segment.contains(middle)
    enough = (np.bincount(vehicle, near) >= MIN_SIGHTINGS) & (np.bincount(vehicle, inside) >= 2)
    lanes = _medians(vehicle, segment.lane(middle), inside & enough[vehicle])
    near &= enough[vehicle]
    rows, vehicle, along = rows[near], vehicle[near], along[near]
    time = seen.time_s[rows]
    variance = (seen.covariance_m2.take(rows, axis=0) @ segment.direction) @ segment.direction
    positions = bin_positions(vehicle, time, centreline.arc_length(along), variance)
    first, last = _ends(vehicle)
    long = time[last] - time[first] >= MIN_TRACKED_S
    oncoming = along[last] < along[first] - 1.0  # traffic of the other direction
    trajectories: list[Trajectory | None] = [None] * len(enough)
    for i in np.flatnonzero(long & ~oncoming):
        if len(positions[i]) >= 3:
            trajectories[vehicle[first[i]]] = Trajectory(
                int(seen.track[rows[last[i]]]),
                positions[i],
                float(time[first[i]]),
                float(time[last[i]]),
                int(lanes[i]),
                NOMINAL_LENGTH_M[int(seen.vehicle_class[rows[last[i]]])],
            )
    return trajectories


def count_oncoming(grouped: GroupedSightings, segment: WatchedSegment) -> int:
    """How many vehicles drive against the segment's direction."""
    first, last = _ends(grouped.vehicle)
    rows, seen = grouped.rows, grouped.sightings
    begin, end = (segment.along(seen.point_m.take(rows[each], axis=0)) for each in (first, last))
    return int((end < begin - _ONCOMING_M).sum())


def count_wrong_way(grouped: GroupedSightings, segment: WatchedSegment) -> int:
    """How many vehicles certainly drive against the direction of a segment that runs along it.

    A vehicle counts by the sightings that lie within the outline by a margin, so that those of a
    carriageway beside it do not. They have to go back by `_WRONG_WAY_M` at `_WRONG_WAY_MPS` and
    more, in both halves of the time, as a track that jumps to the next vehicle does not.
    """
    seen, found = grouped.sightings, 0
    for rows in np.split(grouped.rows, np.flatnonzero(np.diff(grouped.vehicle)) + 1):
        if len(rows) < MIN_SIGHTINGS:
            continue
        middle = seen.point_m[rows] + _half_length(seen, rows)
        across_m = np.sqrt(
            np.einsum("i,nij,j->n", segment.left, seen.covariance_m2[rows], segment.left)
        )
        off = (_INSIDE_M + 2 * across_m)[:, None] * segment.left
        within = segment.contains(middle + off) & segment.contains(middle - off)
        time, along = seen.time_s[rows][within], segment.along(middle[within])
        if len(time) < MIN_SIGHTINGS or time[-1] - time[0] < MIN_TRACKED_S:
            continue
        middle_s = (time[0] + time[-1]) / 2
        back = along[0] - along[-1]
        halves = [along[time <= middle_s], along[time >= middle_s]]
        found += bool(
            back >= max(_WRONG_WAY_M, _WRONG_WAY_MPS * (time[-1] - time[0]))
            and all(len(half) and half[0] - half[-1] >= back / 4 for half in halves)
        )
    return found


def _ends(vehicle: Indices) -> tuple[Indices, Indices]:
    """First and last row of each vehicle's rows, which stand together."""
    return np.flatnonzero(np.diff(vehicle, prepend=-1)), np.flatnonzero(np.diff(vehicle, append=-1))


def _medians(
    vehicle: Indices, lane: npt.NDArray[np.int_], counts: npt.NDArray[np.bool_]
) -> Indices:
    """The median of each vehicle's lanes, rounded down, over the rows that count."""
    vehicle, lane = vehicle[counts], lane[counts]
    first, last = _ends(vehicle)
    ranked = lane[np.lexsort((lane, vehicle))]
    return np.asarray((ranked[(first + last) // 2] + ranked[(first + last + 1) // 2]) // 2)


def _half_length(seen: Sightings, rows: Indices) -> Array:
    """Roughly from a box's lower edge to its vehicle's middle, m, by row, shape (n, 2)."""
    half = np.array(NOMINAL_LENGTH_M)[seen.vehicle_class[rows]] / 2
    return np.asarray(seen.away.take(rows, axis=0) * half[:, None])


def to_centre(grouped: GroupedSightings, segment: WatchedSegment, pose: CameraPose | None) -> Array:
    """From each box's lower edge to its vehicle's middle, m, shape (n, 2)."""
    seen = grouped.sightings
    guessed = _half_length(seen, grouped.rows)
    if pose is None:
        return guessed
    # It varies slowly along the road: interpolated between a few places of each vehicle.
    first, last = _ends(grouped.vehicle)
    places = first[:, None] + np.linspace(0, last - first, _PLACES, axis=1).astype(np.intp)
    kind = seen.vehicle_class[grouped.rows[last]]
    sizes = np.column_stack([NOMINAL_LENGTH_M, NOMINAL_SIZE_M])[kind]
    offsets = pose.centre_offset(
        seen.point_m[grouped.rows[places.ravel()]],
        np.tile(segment.direction, (places.size, 1)),
        np.repeat(sizes, _PLACES, axis=0),
    ).reshape(*places.shape, 2)
    good = np.asarray(np.isfinite(offsets).all(axis=2))
    for vehicle in np.flatnonzero(good.any(axis=1) & ~good.all(axis=1)):
        known = good[vehicle]
        for column in offsets[vehicle].T:
            column[:] = np.interp(places[vehicle], places[vehicle, known], column[known])
    every = np.arange(len(grouped.rows))
    columns = [np.interp(every, places.ravel(), column) for column in offsets.reshape(-1, 2).T]
    offset = np.column_stack(columns)
    return np.where(np.isfinite(offset), offset, guessed)
