"""True windows of the traffic in view of the RSUs' cameras in a running simulation."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from edge_daemon.camera import WatchedSegment
from edge_daemon.settings import StabilitySettings
from slipstream_lab.simulation.ground_truth import TrueWindow, Truth, true_window
from slipstream_lab.simulation.rsus import Rsu, WatchedStretch

_LANE_M: Final = 3.2
_NOBODY: Final = -1e6
_MAX_VEHICLE_M: Final = 100.0
"""Of any vehicle."""


@dataclass(frozen=True)
class Observation:
    """One window of one watched segment as a perfect observer would report it. `truth`: features
    over the window; None where no vehicle came by.
    """

    time_s: float
    rsu: str
    segment: str
    truth: TrueWindow | None


@dataclass(frozen=True)
class ObservedVehicle:
    """A vehicle on a watched segment at one step: SUMO's id, its front's place, and its motion."""

    name: str
    front_m: float
    lane: int
    speed_mps: float
    acceleration_mps2: float
    length_m: float


class Observer:
    """Keeps the vehicles of the last window before each RSU's camera.

    It must look at every step of a window: `sample` after each. Accelerations are those of whole
    steps, so that at a step of 1 s they vary a little less than a camera's.
    """

    def __init__(
        self, rsus: Sequence[Rsu], step_s: float, rule: StabilitySettings, window_s: float = 10.0
    ) -> None:
        self._rule = rule
        self._window_s = window_s
        self._frames = round(window_s / step_s)
        self._step_s = step_s
        self._watched = [(rsu.id, stretch) for rsu in rsus for stretch in rsu.watch]
        self._seen: list[deque[list[ObservedVehicle]]] = [
            deque(maxlen=self._frames) for _ in self._watched
        ]

    def sample(self) -> None:
        """Take in the running simulation's present step."""
        for (_, stretch), seen in zip(self._watched, self._seen, strict=True):
            seen.append(observed_vehicles(stretch))

    def forget(self) -> None:
        """Start a new window: the next look does not follow the last one by one step."""
        for seen in self._seen:
            seen.clear()

    def observe(self, time_s: float) -> tuple[Observation, ...]:
        """The windows that end now. Raises ValueError: fewer looks than a window has steps."""
        if any(len(seen) < self._frames for seen in self._seen):
            raise ValueError("a window needs a look at each of its steps")
        return tuple(
            Observation(time_s, rsu, stretch.segment, self._window(stretch, list(seen)))
            for (rsu, stretch), seen in zip(self._watched, self._seen, strict=True)
        )

    def _window(
        self, stretch: WatchedStretch, seen: list[list[ObservedVehicle]]
    ) -> TrueWindow | None:
        return window_of(stretch, seen, self._step_s, self._rule)


def observed_vehicles(stretch: WatchedStretch) -> list[ObservedVehicle]:
    """The vehicles on a stretch in the running simulation."""
    import libsumo

    vehicle = libsumo.vehicle
    found = []
    for name in libsumo.edge.getLastStepVehicleIDs(stretch.segment):
        front_m = vehicle.getLanePosition(name)
        # Most vehicles of a long segment are not on the stretch: they cost one question, not three.
        if not stretch.from_m <= front_m < stretch.to_m + _MAX_VEHICLE_M:
            continue
        length_m, lane = vehicle.getLength(name), vehicle.getLaneIndex(name)
        if stretch.holds(front_m - length_m / 2, lane):
            speed_mps, mps2 = vehicle.getSpeed(name), vehicle.getAcceleration(name)
            found.append(ObservedVehicle(name, front_m, lane, speed_mps, mps2, length_m))
    return found


def window_of(
    stretch: WatchedStretch,
    seen: Sequence[Sequence[ObservedVehicle]],
    step_s: float,
    rule: StabilitySettings,
) -> TrueWindow | None:
    """Features over the steps of a window by the edge's own definitions."""
    rows = [
        (frame, p.front_m - p.length_m / 2, p)
        for frame, step in enumerate(seen)
        for p in step
        if stretch.holds(p.front_m - p.length_m / 2, p.lane)
    ]
    if not rows:
        return None
    first = stretch.from_lane
    lanes = 1 + max(p.lane for _, _, p in rows) - first
    numbers = {name: i for i, name in enumerate(sorted({p.name for _, _, p in rows}))}
    n, steps = len(rows), len(seen)
    # A vehicle far outside in each step: empty steps count for the density too.
    frame = np.array([f for f, _, _ in rows] + list(range(steps)))
    order = np.argsort(frame, kind="stable")
    nothing = np.zeros(steps)

    def column(values: list[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.concatenate([np.array(values, dtype=np.float64), nothing])

    place = np.column_stack(
        [
            np.append([along for _, along, _ in rows], np.full(steps, _NOBODY)),
            np.append([(p.lane - first + 0.5) * _LANE_M for _, _, p in rows], nothing),
        ]
    )
    truth = Truth(
        frame,
        frame * step_s,
        np.append([numbers[p.name] for _, _, p in rows], np.full(steps, -1)),
        place,
        column([p.speed_mps for _, _, p in rows]),
        column([p.acceleration_mps2 for _, _, p in rows]),
        np.zeros((n + steps, 4)),
        np.ones(n + steps),
        column([p.length_m for _, _, p in rows]),
        np.full(n + steps, -1),
    ).take(order)
    return true_window(truth, _straight(stretch, lanes), 0.0, steps * step_s, rule)


def _straight(stretch: WatchedStretch, lanes: int) -> WatchedSegment:
    """A watched segment along the x-axis; x is the distance along the segment."""
    low, high, width = stretch.from_m, stretch.to_m, lanes * _LANE_M
    outline = np.array([(low, 0.0), (high, 0.0), (high, width), (low, width)])
    return WatchedSegment(
        stretch.segment, outline, np.array([1.0, 0.0]), high - low, lanes, _LANE_M
    )
