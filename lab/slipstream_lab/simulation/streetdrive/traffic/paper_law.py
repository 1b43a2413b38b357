"""The `paper` scenario: vehicles under the paper's law of motion."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slipstream_lab.simulation.streetdrive.traffic.road import Floats, Lane, LengthOf, VehicleTrack


@dataclass(frozen=True)
class PaperLaw:
    """Y(t) = Y_s + (Y_e - Y_s) (t/T)^1.5 (the paper, section on input data), along one axis.

    Speed grows with the square root of time: v = 1.5 (Y_e - Y_s)/T (t/T)^0.5. Acceleration is
    0.75 (Y_e - Y_s)/T^2 (t/T)^-0.5 and singular at t = 0, so t/T starts where v is slowest allowed.
    """

    start_m: float
    end_m: float
    duration_s: float

    def at(self, time_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Position, velocity and acceleration, signed along the axis, at times 0 < t <= T."""
        tau = time_s / self.duration_s
        span = self.end_m - self.start_m
        position = self.start_m + span * tau**1.5
        velocity = 1.5 * span / self.duration_s * np.sqrt(tau)
        return position, velocity, 0.75 * span / self.duration_s**2 / np.sqrt(tau)


_PAPER_MIN_SPEED_MPS = 60 / 3.6
_PAPER_GAP_M = 6.0


def paper_lane(
    lane: Lane,
    *,
    frames: int,
    fps: float,
    rng: np.random.Generator,
    ids: Iterator[int],
    length_of: LengthOf,
) -> list[VehicleTrack]:
    """Vehicles that obey the paper's law at 60 to 120 km/h, released so that none overlap."""
    start, end = (330.0, -20.0) if lane.direction < 0 else (-95.0, 330.0)
    tracks: list[VehicleTrack] = []
    release_s = -20.0
    ahead: tuple[PaperLaw, float, float] | None = None
    while release_s < frames / fps:
        number = next(ids)
        fastest = float(rng.uniform(106.0, 119.5)) / 3.6
        law = PaperLaw(start, end, 1.5 * abs(end - start) / fastest)
        slow_s = law.duration_s * (_PAPER_MIN_SPEED_MPS / fastest) ** 2 * 1.0001
        length = length_of(number)
        release_s += float(rng.uniform(2.2, 3.4))
        while ahead is not None and _paper_gap(ahead, (law, release_s, length)) < _PAPER_GAP_M:
            release_s += 0.2
        ahead = (law, release_s, length)
        first = max(0, math.ceil((release_s + slow_s) * fps))
        last = min(frames - 1, math.floor((release_s + law.duration_s) * fps))
        if last >= first:
            times = np.arange(first, last + 1) / fps - release_s
            x, velocity, acceleration = law.at(times)
            sign = lane.direction
            tracks.append(
                VehicleTrack(number, lane, first, x, velocity * sign, acceleration * sign)
            )
    return tracks


def _paper_gap(
    ahead: tuple[PaperLaw, float, float], behind: tuple[PaperLaw, float, float]
) -> float:
    """Least bumper-to-bumper gap in metres while both are on the road."""
    (law_a, release_a, length_a), (law_b, release_b, length_b) = ahead, behind
    begin, end = release_b + 0.2, min(release_a + law_a.duration_s, release_b + law_b.duration_s)
    if end <= begin:
        return math.inf
    times = np.linspace(begin, end, 200)
    distance = np.abs(law_a.at(times - release_a)[0] - law_b.at(times - release_b)[0])
    return float(distance.min()) - (length_a + length_b) / 2
