"""Following vehicles on the road plane: a filter in metres, association in two stages.

Each track is a Kalman filter with constant acceleration, state (x, y, vx, vy, ax, ay). Detections
are assigned by the Hungarian method on squared Mahalanobis distances: first the sure ones, then the
unsure ones to tracks that are left over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.optimize import linear_sum_assignment

from edge_daemon.camera import Array
from edge_daemon.measurement import RoadPoints
from slipstream.config import Settings

_GATE = 13.8  # 99.9 % of χ² with two degrees of freedom
_FORBIDDEN = 1e6


class TrackerSettings(Settings):
    """How vehicles are followed."""

    sure_score: Annotated[float, Field(gt=0, lt=1)] = Field(
        default=0.4, description="Detections from here up may start a track."
    )
    confirm_hits: Annotated[int, Field(ge=1)] = Field(
        default=3, description="Detections that a new track needs before it counts."
    )
    lost_after_s: Annotated[float, Field(gt=0)] = Field(
        default=1.0, description="A track without a detection for so long ends."
    )
    jerk_noise: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(
        default=1.0,
        description="Root of the spectral density of the jerk that the filter allows for, m/s^2.5.",
    )
    max_speed_mps: Annotated[float, Field(gt=0)] = Field(
        default=45.0, description="Spread of the speed of a vehicle just found is half of it."
    )


@dataclass
class Track:
    """One vehicle.

    Attributes:
        id: number, unique while the daemon runs.
        state: x, y, vx, vy, ax, ay in m and s.
        covariance: of the state, shape (6, 6).
        last_seen_s: media time of its last detection.
        hits: detections so far.
        box: last detection's box, px.
        votes: summed scores by vehicle class.
    """

    id: int
    state: Array
    covariance: Array
    last_seen_s: float
    box: npt.NDArray[np.float32]
    hits: int = 1
    votes: dict[int, float] = field(default_factory=dict)

    @property
    def speed_mps(self) -> float:
        """Present speed of the filter, m/s."""
        return float(np.hypot(self.state[2], self.state[3]))

    @property
    def vehicle_class(self) -> int:
        """The class with most votes."""
        return max(self.votes, key=lambda c: self.votes[c])


@dataclass(frozen=True)
class Sighting:
    """One detection of a confirmed track: what kinematics is made from.

    Attributes:
        track: the track's id.
        time_s: media time.
        point_m: measured point on the road, m, shape (2,).
        covariance_m2: of the point, shape (2, 2).
        vehicle_class: index into VEHICLE_CLASSES.
    """

    track: int
    time_s: float
    point_m: Array
    covariance_m2: Array
    vehicle_class: int


class Tracker:
    """Follows the vehicles of one camera."""

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        self._tracks: list[Track] = []
        self._next_id = 1
        self._time_s: float | None = None
        self._early: dict[int, list[Sighting]] = {}

    @property
    def tracks(self) -> tuple[Track, ...]:
        """Confirmed tracks, seen in the last frame or coasting."""
        return tuple(t for t in self._tracks if t.hits >= self._settings.confirm_hits)

    def reset(self) -> None:
        """Forget all tracks: the scene has changed."""
        self._tracks.clear()
        self._early.clear()
        self._time_s = None

    def update(self, time_s: float, found: RoadPoints) -> list[Sighting]:
        """Take one frame's detections in.

        Args:
            time_s: media time, later than the last one.
            found: the detections on the road.

        Returns:
            New sightings of confirmed tracks; those from before a track was confirmed come with
            the detection that confirms it.
        """
        # First, lest a pause of the source hand a lost track's identity to another vehicle.
        self._drop_lost(time_s)
        if self._time_s is not None:
            self._predict(max(time_s - self._time_s, 1e-4))
        self._time_s = time_s
        sure = found.scores >= self._settings.sure_score
        everyone = list(range(len(self._tracks)))
        matched = dict(self._assign(everyone, np.flatnonzero(sure), found))
        left = [i for i in everyone if i not in matched]
        matched |= dict(self._assign(left, np.flatnonzero(~sure), found))
        sightings: list[Sighting] = []
        for index, detection in matched.items():
            track = self._tracks[index]
            self._correct(track, found.points_m[detection], found.covariances_m2[detection])
            sightings += self._seen(track, time_s, found, detection)
        taken = set(matched.values())
        for new in sorted(set(np.flatnonzero(sure).tolist()) - taken):
            self._start(time_s, found, new)
        return sightings

    def _seen(
        self, track: Track, time_s: float, found: RoadPoints, detection: int
    ) -> list[Sighting]:
        kind = int(found.classes[detection])
        track.last_seen_s = time_s
        track.hits += 1
        track.box = found.boxes[detection]
        track.votes[kind] = track.votes.get(kind, 0.0) + float(found.scores[detection])
        sighting = Sighting(
            track.id,
            time_s,
            found.points_m[detection],
            found.covariances_m2[detection],
            track.vehicle_class,
        )
        if track.hits < self._settings.confirm_hits:
            self._early[track.id].append(sighting)
            return []
        return [*self._early.pop(track.id, []), sighting]

    def _start(self, time_s: float, found: RoadPoints, detection: int) -> None:
        point, noise = found.points_m[detection], found.covariances_m2[detection]
        state = np.concatenate([point, np.zeros(4)])
        covariance = np.zeros((6, 6))
        covariance[:2, :2] = noise
        covariance[2:4, 2:4] = np.eye(2) * (self._settings.max_speed_mps / 2) ** 2
        covariance[4:, 4:] = np.eye(2) * 2.0**2
        kind = int(found.classes[detection])
        track = Track(self._next_id, state, covariance, time_s, found.boxes[detection])
        track.votes[kind] = float(found.scores[detection])
        self._early[track.id] = [Sighting(track.id, time_s, point, noise, kind)]
        self._next_id += 1
        self._tracks.append(track)

    def _drop_lost(self, time_s: float) -> None:
        kept = []
        for track in self._tracks:
            patience = self._settings.lost_after_s
            if track.hits < self._settings.confirm_hits:
                patience /= 4  # a single false detection shall not linger
            if time_s - track.last_seen_s <= patience:
                kept.append(track)
            else:
                self._early.pop(track.id, None)
        self._tracks = kept

    def _predict(self, dt: float) -> None:
        if not self._tracks:
            return
        move, noise = _motion(dt, self._settings.jerk_noise)
        states = np.stack([t.state for t in self._tracks]) @ move.T
        covariances = move @ np.stack([t.covariance for t in self._tracks]) @ move.T + noise
        for track, state, covariance in zip(self._tracks, states, covariances, strict=True):
            track.state, track.covariance = state, covariance

    def _assign(
        self, tracks: list[int], detections: npt.NDArray[np.intp], found: RoadPoints
    ) -> Iterator[tuple[int, int]]:
        if not tracks or not len(detections):
            return
        states = np.stack([self._tracks[i].state[:2] for i in tracks])
        spread = np.stack([self._tracks[i].covariance[:2, :2] for i in tracks])
        inverse = spread[:, None] + found.covariances_m2[detections][None]
        gap = found.points_m[detections][None] - states[:, None]
        distance = np.einsum("tdi,tdij,tdj->td", gap, np.linalg.inv(inverse), gap)
        # The log-determinant keeps a track that knows little from taking a sure one's detection.
        cost = distance + np.log(np.linalg.det(inverse))
        cost[distance > _GATE] = _FORBIDDEN
        for row, column in zip(*linear_sum_assignment(cost), strict=True):
            if cost[row, column] < _FORBIDDEN:
                yield tracks[row], int(detections[column])

    @staticmethod
    def _correct(track: Track, point: Array, noise: Array) -> None:
        spread = track.covariance[:2, :2] + noise
        gain = np.linalg.solve(spread, track.covariance[:2]).T
        track.state = track.state + gain @ (point - track.state[:2])
        covariance = track.covariance - gain @ track.covariance[:2]
        track.covariance = (covariance + covariance.T) / 2


def _motion(dt: float, jerk_noise: float) -> tuple[Array, Array]:
    """Transition and process noise of constant acceleration under white jerk, both (6, 6)."""
    one: Array = np.array([[1.0, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    noise: Array = jerk_noise**2 * np.array(
        [
            [dt**5 / 20, dt**4 / 8, dt**3 / 6],
            [dt**4 / 8, dt**3 / 3, dt**2 / 2],
            [dt**3 / 6, dt**2 / 2, dt],
        ]
    )
    both = np.eye(2)
    return np.kron(one, both).astype(np.float64), np.kron(noise, both).astype(np.float64)
