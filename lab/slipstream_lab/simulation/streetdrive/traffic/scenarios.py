"""Who drives where: trajectories of StreetDrive's scenarios, without any drawing.

Lane traffic follows the intelligent driver model (Treiber, Hennecke and Helbing, Phys. Rev. E 62,
1805, 2000). Stop-and-go waves come from a perturbed leader at the lane's downstream end and travel
upstream from vehicle to vehicle. The `paper` scenario uses the paper's law of motion instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from slipstream_lab.simulation.streetdrive.traffic.paper_law import paper_lane
from slipstream_lab.simulation.streetdrive.traffic.road import Lane, LengthOf, Road, VehicleTrack

SCENARIOS = ("stable", "turbulent", "mixed", "paper")

FAR_M = 300.0
"""x at which lanes begin (incoming) or end (outgoing)."""
NEAR_M = -60.0
"""x at which lanes end (incoming) or begin (outgoing)."""
_MAX_STEP_S = 0.02
_MAX_BRAKING_MPS2 = 6.0


@dataclass(frozen=True)
class TrafficDriver:
    """Parameters of the intelligent driver model."""

    desired_speed_mps: float
    time_gap_s: float
    min_gap_m: float = 2.0
    max_acceleration_mps2: float = 1.4
    comfortable_braking_mps2: float = 2.0

    def acceleration(self, speed_mps: float, gap_m: float, leader_speed_mps: float) -> float:
        """IDM acceleration in m/s2, bounded below by hard braking."""
        root = math.sqrt(self.max_acceleration_mps2 * self.comfortable_braking_mps2)
        closing = speed_mps * (speed_mps - leader_speed_mps) / (2 * root)
        wanted = self.min_gap_m + max(0.0, speed_mps * self.time_gap_s + closing)
        free = (speed_mps / self.desired_speed_mps) ** 4
        pull = 1.0 - free - (wanted / max(gap_m, 0.1)) ** 2
        return max(self.max_acceleration_mps2 * pull, -_MAX_BRAKING_MPS2)


@dataclass(frozen=True)
class Wave:
    """Speed that a perturbed leader forces on all vehicles beyond `from_m` of the lane's path."""

    mean_mps: float
    amplitude_mps: float
    period_s: float
    phase_rad: float
    from_m: float

    def speed(self, time_s: float) -> float:
        """Leader's speed in m/s, never negative."""
        angle = 2 * math.pi * time_s / self.period_s + self.phase_rad
        return max(0.0, self.mean_mps + self.amplitude_mps * math.sin(angle))


@dataclass(frozen=True)
class Inflow:
    """How vehicles enter a lane: speed, and headways between these bounds in seconds."""

    speed_mps: float
    min_time_gap_s: float
    max_time_gap_s: float


@dataclass
class _Car:
    vehicle_id: int
    length_m: float
    driver: TrafficDriver
    s_m: float
    speed_mps: float
    acceleration_mps2: float = 0.0
    first_frame: int = 0
    samples: list[tuple[float, float, float]] = field(default_factory=list)


@dataclass(frozen=True)
class LanePlan:
    """What happens on one lane."""

    lane: Lane
    inflow: Inflow
    draw_driver: Callable[[np.random.Generator], TrafficDriver]
    wave: Wave | None = None
    warm_up_s: float = 90.0


def _accelerations(cars: list[_Car], wave: Wave | None, time_s: float, step_s: float) -> None:
    """Set each car's acceleration; cars are ordered from the front backwards."""
    for i, car in enumerate(cars):
        if wave is not None and car.s_m >= wave.from_m:
            wanted = (wave.speed(time_s + step_s) - car.speed_mps) / step_s
            car.acceleration_mps2 = min(max(wanted, -4.0), 3.0)
        elif i == 0:
            car.acceleration_mps2 = car.driver.acceleration(car.speed_mps, 1e6, car.speed_mps)
        else:
            ahead = cars[i - 1]
            gap = ahead.s_m - car.s_m - (ahead.length_m + car.length_m) / 2
            car.acceleration_mps2 = car.driver.acceleration(car.speed_mps, gap, ahead.speed_mps)


def _advance(cars: list[_Car], step_s: float) -> None:
    """Move all cars by one step of constant acceleration; speeds stay non-negative."""
    for car in cars:
        speed = car.speed_mps + car.acceleration_mps2 * step_s
        if speed < 0:
            car.acceleration_mps2 = -car.speed_mps / step_s
            speed = 0.0
        car.s_m += (car.speed_mps + speed) / 2 * step_s
        car.speed_mps = speed


def simulate_lane(
    plan: LanePlan,
    *,
    frames: int,
    fps: float,
    rng: np.random.Generator,
    ids: Iterator[int],
    length_of: LengthOf,
) -> list[VehicleTrack]:
    """Run one lane through its warm-up and the clip; tracks hold the clip's frames only."""
    path_m = FAR_M - NEAR_M
    per_frame = max(1, math.ceil(1.0 / (fps * _MAX_STEP_S)))
    step_s = 1.0 / (fps * per_frame)
    warm_up = math.ceil(plan.warm_up_s * fps)
    cars: list[_Car] = []
    gone: list[_Car] = []
    next_entry_s = -math.inf
    for frame in range(-warm_up, frames):
        for substep in range(per_frame):
            time_s = frame / fps + substep * step_s
            if time_s >= next_entry_s:
                car = _enter(cars, plan, rng, ids, length_of)
                if car is not None:
                    cars.append(car)
                    low, high = plan.inflow.min_time_gap_s, plan.inflow.max_time_gap_s
                    next_entry_s = time_s + float(rng.uniform(low, high))
            _accelerations(cars, plan.wave, time_s, step_s)
            if substep == 0 and frame >= 0:
                for car in cars:
                    if not car.samples:
                        car.first_frame = frame
                    car.samples.append((car.s_m, car.speed_mps, car.acceleration_mps2))
            _advance(cars, step_s)
        while cars and cars[0].s_m > path_m:
            gone.append(cars.pop(0))
    return [_track(car, plan.lane) for car in (*gone, *cars) if car.samples]


def _enter(
    cars: list[_Car],
    plan: LanePlan,
    rng: np.random.Generator,
    ids: Iterator[int],
    length_of: LengthOf,
) -> _Car | None:
    """A new car at the lane's beginning, or None while there is no room for the longest one."""
    speed = plan.inflow.speed_mps
    if cars:
        last = cars[-1]
        speed = min(speed, last.speed_mps + 1.0)
        if last.s_m - last.length_m / 2 - 8.0 < 3.0 + 0.8 * speed:
            return None
    number = next(ids)
    return _Car(number, length_of(number), plan.draw_driver(rng), 0.0, speed)


def _track(car: _Car, lane: Lane) -> VehicleTrack:
    s, speed, acceleration = np.asarray(car.samples, dtype=np.float64).T
    x = FAR_M - s if lane.direction < 0 else NEAR_M + s
    return VehicleTrack(car.vehicle_id, lane, car.first_frame, x, speed, acceleration)


def _calm_driver(rng: np.random.Generator) -> TrafficDriver:
    return TrafficDriver(desired_speed_mps=18.5 * float(rng.normal(1.0, 0.008)), time_gap_s=1.1)


def _aggressive_driver(rng: np.random.Generator) -> TrafficDriver:
    return TrafficDriver(
        desired_speed_mps=15.0 * float(rng.normal(1.0, 0.05)),
        time_gap_s=float(rng.uniform(0.6, 0.8)),
        max_acceleration_mps2=3.5,
        comfortable_braking_mps2=4.0,
    )


def _calm(lane: Lane) -> LanePlan:
    return LanePlan(lane, Inflow(16.8, 2.0, 2.8), _calm_driver)


def _stop_and_go(lane: Lane, rng: np.random.Generator) -> LanePlan:
    # The wave starts behind the camera for incoming lanes and beyond the monitored part for others.
    origin = FAR_M + 20.0 if lane.direction < 0 else 115.0 - NEAR_M
    wave = Wave(
        mean_mps=float(rng.uniform(6.2, 7.0)),
        amplitude_mps=float(rng.uniform(9.0, 10.0)),
        period_s=float(rng.uniform(14.0, 17.0)),
        phase_rad=float(rng.uniform(0, 2 * math.pi)),
        from_m=origin,
    )
    return LanePlan(lane, Inflow(10.0, 1.4, 2.2), _aggressive_driver, wave)


def simulate(
    scenario: str, road: Road, *, seconds: float, fps: float, seed: int, length_of: LengthOf
) -> list[VehicleTrack]:
    """Trajectories of all vehicles of a scenario, sampled at the clip's frames. Raises ValueError:
    the scenario is unknown.
    """
    if scenario not in SCENARIOS:
        raise ValueError(f"unknown scenario {scenario!r}")
    frames = round(seconds * fps)
    ids = iter(range(1, 1_000_000))
    tracks: list[VehicleTrack] = []
    for number, lane in enumerate(road.lanes):
        rng = np.random.default_rng([seed, 1, number])
        common = {"frames": frames, "fps": fps, "rng": rng, "ids": ids, "length_of": length_of}
        if scenario == "paper":
            tracks += paper_lane(lane, **common)  # type: ignore[arg-type]
            continue
        rough = scenario == "turbulent" or (scenario == "mixed" and lane.direction > 0)
        plan = _stop_and_go(lane, rng) if rough else _calm(lane)
        tracks += simulate_lane(plan, **common)  # type: ignore[arg-type]
    return tracks
