"""Specification and status of a live world, sent between processes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from slipstream.config import BusSettings
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
        rsus: that have a camera.
        deliveries: orders and vehicles; plans for others are ignored.
        fleet: the dispatcher's fleet file, kept up to date.
        bus: for plans and positions.
        folder: for the cameras' calibration files.
        priority: whether vehicles may ask signals for green.
        seed: of light and scenery.
        fps: pictures a second, by the wall clock.
        width_px: of a picture, with height_px.
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
    """A camera that serves pictures.

    Attributes:
        rsu: its RSU.
        segments: that it watches.
        url: of its stream.
        calibration: its camera.toml.
    """

    rsu: str
    segments: tuple[str, ...]
    url: str
    calibration: Path


@dataclass(frozen=True)
class WorldCounts:
    """What has happened since the world opened.

    Attributes:
        time_s: simulated now, since midnight.
        simulated_s: since it opened.
        steps: of the simulation.
        late_steps: that began more than their own length too late.
        slipped_s: wall time that it has fallen behind for good.
        frames: pictures served.
        frames_skipped: pictures left out as the camera was still busy with the one before.
        vehicles: on the road now, the fleet's included.
        orders_waiting: released and not served.
        tours_begun: of all vehicles, from their depots.
        tours_finished: of them, ended at the depot.
        orders_served: whose service has begun.
        orders_served_again: times that a vehicle came to an order that was served before.
        longest_silence_s: see `slipstream_lab.simulation.fleet.world.FleetWorld`.
        platooned_m: driven in platoons, at their front or behind.
        legs_driven: of the fleet, to their end.
        fleet_driven_m: on them.
        fleet_on_road: vehicles of the fleet on a leg now.
        fleet_vehicles_driven: vehicles of the fleet that have driven at all.
    """

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
