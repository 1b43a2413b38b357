"""Specification and status of a live world, sent between processes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from slipstream.braking import Road
from slipstream.config import BusSettings
from slipstream_lab.simulation.fleet.safety import FleetSafety, OthersSafety
from slipstream_lab.simulation.rsus import Rsu
from slipstream_lab.simulation.scenarios.day import DaySpec
from slipstream_lab.simulation.scenarios.demand import Deliveries

_MAX_STEP_S: Final = 0.1
"""Between two steps of this length vehicles move as cameras see them move."""


@dataclass(frozen=True)
class WorldSpec:
    """A world that runs against the wall clock.

    Attributes:
        day: files, and the time that the background starts at; its step is not used.
        begin_s: simulated time that the world opens at; what comes before fills the roads.
        deliveries: orders and vehicles; plans for others are ignored.
        road: state of the roads; the agents have theirs from their settings.
    """

    day: DaySpec
    begin_s: float
    rsus: tuple[Rsu, ...]
    deliveries: Deliveries
    fleet: Path
    bus: BusSettings
    folder: Path
    priority: bool = False
    seed: int = 1
    fps: float = 10.0
    width_px: int = 1280
    height_px: int = 720
    road: Road = "dry"

    @property
    def steps_a_frame(self) -> int:
        """Steps of the simulation from one picture to the next."""
        return max(1, math.ceil(1 / self.fps / _MAX_STEP_S - 1e-6))

    @property
    def step_s(self) -> float:
        """Simulated time of a step, in SUMO's whole milliseconds: at most 0.1 s, so that a picture
        is due after whole steps.
        """
        return max(0.001, round(1 / self.fps / self.steps_a_frame, 3))


@dataclass(frozen=True)
class CameraEndpoint:
    """A camera that serves pictures."""

    rsu: str
    segments: tuple[str, ...]
    url: str
    calibration: Path


@dataclass(frozen=True)
class WorldCounts:
    """What has happened since the world opened."""

    time_s: float
    simulated_s: float
    steps: int
    late_steps: int
    slipped_s: float
    frames: int
    frames_skipped: int
    vehicles: int
    orders_waiting: int
    tours_begun: int
    tours_finished: int
    orders_served: int
    orders_served_again: int
    longest_silence_s: float
    platooned_m: float
    legs_driven: int
    fleet_driven_m: float
    fleet_on_road: int
    fleet_vehicles_driven: int
    safety: FleetSafety
    others: OthersSafety
