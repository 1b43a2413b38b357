"""Tracking vehicles on the road plane: a Kalman filter in metres, association in two stages.

Each track has constant acceleration, state (x, y, vx, vy, ax, ay). Detections are assigned by the
Hungarian method on squared Mahalanobis distances: first those with a high score, then the others to
the remaining tracks (as in ByteTrack, Zhang et al., ECCV 2022). The states of all tracks are in one
array, so that a frame costs few array operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array
from edge_daemon.tracking.association import associate, overlap
from edge_daemon.tracking.measurement import RoadPoints
from edge_daemon.tracking.sightings import Indices, Sightings
from edge_daemon.tracking.timing import FrameTiming

HIGH_SCORE: Final = 0.5
"""Detections from this score on are assigned first and may start a track."""
_CONFIRM_HITS: Final = 3
_LOST_AFTER_S: Final = 1.2
_JERK_NOISE: Final = 1.0
"""Root of the spectral density of the jerk in the motion model, m/s^2.5."""
_MAX_SPEED_MPS: Final = 45.0
"""A new track's speed has half of it as its standard deviation."""
# In a jam the next vehicle is a few metres ahead: no track may jump there, however uncertain.
_MAX_JUMP_M = 3.0
_NEW_TRACK_HITS = 5
_MAX_CONFIRMED_STD_M = 2.0
# A track less certain than a few car lengths cannot be distinguished from the next vehicle.
_MAX_POSITION_STD_M = 4.0


@dataclass(frozen=True)
class Track:
    """The present state of one vehicle: x, y, vx, vy, ax, ay in m and s, media times of its first
    and last detection, the last one's box, px, and the class with most votes. Its id is unique
    while the daemon runs.
    """

    id: int
    state: Array
    first_seen_s: float
    last_seen_s: float
    box: npt.NDArray[np.float32]
    vehicle_class: int

    @property
    def speed_mps(self) -> float:
        """Present speed of the filter, m/s."""
        return float(np.hypot(self.state[2], self.state[3]))


@dataclass
class _Record:
    """What is known of a track besides its state."""

    id: int
    box: npt.NDArray[np.float32]
    first_seen_s: float
    last_seen_s: float
    hits: int = 1
    votes: dict[int, float] = field(default_factory=dict)
    early: list[Sightings] = field(default_factory=list)

    @property
    def vehicle_class(self) -> int:
        return max(self.votes, key=lambda c: self.votes[c])


class Tracker:
    """Tracks the vehicles of one camera. `timing`, how wrong the frames' times are, outlasts
    `reset`.
    """

    def __init__(self) -> None:
        self._next_id = 1
        self.timing = FrameTiming()
        self.reset()

    def reset(self) -> None:
        """Drop all tracks: the scene has changed."""
        self._records: list[_Record] = []
        self._states: Array = np.zeros((0, 6))
        self._covariances: Array = np.zeros((0, 6, 6))
        self._reach_m: Array = np.zeros(0)
        self._time_s: float | None = None

    @property
    def tracks(self) -> tuple[Track, ...]:
        """Confirmed tracks, seen in the last frame or coasting."""
        return tuple(
            Track(
                record.id,
                state,
                record.first_seen_s,
                record.last_seen_s,
                record.box,
                record.vehicle_class,
            )
            for record, state in zip(self._records, self._states, strict=True)
            if record.hits >= _CONFIRM_HITS
        )

    def update(self, time_s: float, found: RoadPoints) -> Sightings:
        """Process one frame's detections, at a media time later than the last one.

        Returns new sightings of confirmed tracks; those from before a track was confirmed come with
        the detection that confirms it.
        """
        # First: after a pause of the source, a lost track must not continue on another vehicle.
        self._drop_lost(time_s)
        step_s = 0.0 if self._time_s is None else max(time_s - self._time_s, 1e-4)
        if step_s > 0 and len(self._states):
            move, noise = _motion(step_s)
            self._states = self._states @ move.T
            self._covariances = move @ self._covariances @ move.T + noise
        self._time_s = time_s
        # Of a vehicle just found the speed is unknown yet.
        young = np.array(
            [record.hits < _NEW_TRACK_HITS for record in self._records], dtype=np.bool_
        )
        self._reach_m = np.where(young, _MAX_JUMP_M + _MAX_SPEED_MPS * step_s, _MAX_JUMP_M)
        tracks, detections = self._assign_in_two_stages(found)
        known = ~young[tracks]
        self._learn_timing(step_s, tracks[known], detections[known], found)
        self._correct(
            tracks,
            found.points_m[detections],
            found.covariances_m2[detections] + self._late(tracks),
        )
        sightings = self._seen(tracks, detections, time_s, found)
        new = found.scores >= HIGH_SCORE
        new[detections] = False
        self._merge(tracks, found.away[detections])
        new[new] = ~self._occupied(found.points_m[new], found.away[new])
        self._start(time_s, found, np.flatnonzero(new))
        return sightings

    def _learn_timing(
        self, step_s: float, tracks: Indices, detections: Indices, found: RoadPoints
    ) -> None:
        """Take from all vehicles together how far a frame's time was wrong."""
        self.timing.learn(
            step_s,
            found.points_m[detections] - self._states[tracks, :2],
            self._states[tracks, 2:4],
            self._covariances[tracks, :2, :2] + found.covariances_m2[detections],
        )

    def _late(self, tracks: Indices) -> Array:
        """Covariances of positions from the error of the frame's time, σ²E[v vᵀ], m², (n, 2, 2)."""
        velocity = self._states[tracks, 2:4]
        squares = velocity[:, :, None] * velocity[:, None] + self._covariances[tracks, 2:4, 2:4]
        return np.asarray(self.timing.variance_s2 * squares)

    def _assign_in_two_stages(self, found: RoadPoints) -> tuple[Indices, Indices]:
        sure = found.scores >= HIGH_SCORE
        everyone = np.arange(len(self._states))
        first = self._assign(everyone, np.flatnonzero(sure), found)
        second = self._assign(np.setdiff1d(everyone, first[0]), np.flatnonzero(~sure), found)
        return np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])

    def _assign(
        self, tracks: Indices, detections: Indices, found: RoadPoints
    ) -> tuple[Indices, Indices]:
        if not len(tracks) or not len(detections):
            return tracks[:0], detections[:0]
        gap = found.points_m[detections][None] - self._states[tracks, None, :2]
        spread = (self._covariances[tracks, :2, :2] + self._late(tracks))[:, None]
        spread = spread + found.covariances_m2[detections][None]
        rows, columns = associate(gap, spread, self._reach_m[tracks])
        return tracks[rows], detections[columns]

    def _correct(self, tracks: Indices, points: Array, noise: Array) -> None:
        if not len(tracks):
            return
        covariance = self._covariances[tracks]
        spread = covariance[:, :2, :2] + noise
        gain = np.linalg.solve(spread, covariance[:, :2]).transpose(0, 2, 1)
        gap = points - self._states[tracks, :2]
        self._states[tracks] += np.einsum("nij,nj->ni", gain, gap)
        covariance = covariance - gain @ covariance[:, :2]
        self._covariances[tracks] = (covariance + covariance.transpose(0, 2, 1)) / 2

    def _occupied(self, points: Array, away: Array) -> npt.NDArray[np.bool_]:
        """Which points lie on a tracked vehicle: a second box on it is no second vehicle."""
        confirmed = np.array([record.hits >= _CONFIRM_HITS for record in self._records])
        if not confirmed.any():
            return np.zeros(len(points), dtype=np.bool_)
        sure = confirmed & (
            self._covariances[:, 0, 0] + self._covariances[:, 1, 1] < _MAX_CONFIRMED_STD_M**2
        )
        return np.asarray(overlap(points, self._states[sure, :2], away).any(axis=1))

    def _merge(self, tracks: Indices, away: Array) -> None:
        """Drop the younger of two tracks that have come to lie on one vehicle."""
        points = self._states[tracks, :2]
        same = overlap(points, self._states[:, :2], away)
        same[np.arange(len(tracks)), tracks] = False
        if not same.any():
            return
        hits = np.array([record.hits for record in self._records])
        drop = np.zeros(len(hits), dtype=np.bool_)
        for row, other in zip(*np.nonzero(same), strict=True):
            track = tracks[row]
            if not drop[track] and not drop[other]:
                drop[track if hits[track] < hits[other] else other] = True
        kept = np.flatnonzero(~drop)
        self._records = [self._records[i] for i in kept]
        self._states, self._covariances = self._states[kept], self._covariances[kept]

    def _seen(
        self, tracks: Indices, detections: Indices, time_s: float, found: RoadPoints
    ) -> Sightings:
        """Update the records of detected tracks; sightings of those that are confirmed."""
        chosen = [self._records[track] for track in tracks]
        for record, detection in zip(chosen, detections.tolist(), strict=True):
            kind = int(found.classes[detection])
            record.last_seen_s = time_s
            record.hits += 1
            record.box = found.boxes[detection]
            record.votes[kind] = record.votes.get(kind, 0.0) + float(found.scores[detection])
        seen = _sightings(chosen, time_s, found, detections)
        parts = [seen.take(slice(0, 0))]
        sure = np.array([record.hits >= _CONFIRM_HITS for record in chosen], dtype=np.bool_)
        for row, record in enumerate(chosen):
            if not sure[row]:
                record.early.append(seen.take(slice(row, row + 1)))
            elif record.early:
                parts += record.early
                record.early = []
        return Sightings.join([*parts, seen.take(sure)])

    def _start(self, time_s: float, found: RoadPoints, detections: Indices) -> None:
        if not len(detections):
            return
        states = np.zeros((len(detections), 6))
        states[:, :2] = found.points_m[detections]
        covariances = np.zeros((len(detections), 6, 6))
        covariances[:, :2, :2] = found.covariances_m2[detections]
        covariances[:, 2:4, 2:4] = np.eye(2) * (_MAX_SPEED_MPS / 2) ** 2
        covariances[:, 4:, 4:] = np.eye(2) * 2.0**2
        self._states = np.concatenate([self._states, states])
        self._covariances = np.concatenate([self._covariances, covariances])
        for detection in detections.tolist():
            record = _Record(self._next_id, found.boxes[detection], time_s, time_s)
            record.votes[int(found.classes[detection])] = float(found.scores[detection])
            record.early.append(_sightings([record], time_s, found, np.array([detection])))
            self._records.append(record)
            self._next_id += 1

    def _drop_lost(self, time_s: float) -> None:
        spread = self._covariances[:, 0, 0] + self._covariances[:, 1, 1]
        kept = [
            i
            for i, record in enumerate(self._records)
            if self._is_followed(record, time_s) and spread[i] < _MAX_POSITION_STD_M**2
        ]
        if len(kept) < len(self._records):
            self._records = [self._records[i] for i in kept]
            self._states, self._covariances = self._states[kept], self._covariances[kept]

    def _is_followed(self, record: _Record, time_s: float) -> bool:
        limit_s = _LOST_AFTER_S
        if record.hits < _CONFIRM_HITS:
            limit_s /= 4  # a single false detection ends soon
        return time_s - record.last_seen_s <= limit_s


def _sightings(
    records: Sequence[_Record], time_s: float, found: RoadPoints, detections: Indices
) -> Sightings:
    return Sightings(
        np.array([record.id for record in records], dtype=np.int64),
        np.full(len(records), time_s),
        found.points_m[detections],
        found.covariances_m2[detections],
        found.away[detections],
        np.array([record.vehicle_class for record in records], dtype=np.int64),
        found.boxes[detections],
    )


def _motion(dt: float) -> tuple[Array, Array]:
    """Transition and process noise of constant acceleration under white jerk, both (6, 6)."""
    one: Array = np.array([[1.0, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    noise: Array = _JERK_NOISE**2 * np.array(
        [
            [dt**5 / 20, dt**4 / 8, dt**3 / 6],
            [dt**4 / 8, dt**3 / 3, dt**2 / 2],
            [dt**3 / 6, dt**2 / 2, dt],
        ]
    )
    both = np.eye(2)
    return np.kron(one, both).astype(np.float64), np.kron(noise, both).astype(np.float64)
