"""What the world is asked to be, and what it tells of itself; sent between processes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from simulation.scenarios.day import DayOrder
from simulation.scenarios.fleet import Deliveries
from simulation.scenarios.rsus import Rsu
from slipstream.config import BusSettings


@dataclass(frozen=True)
class WorldOrder:
    """A world that runs against the wall clock.

    Attributes:
        day: files, steps and the time that the background starts at.
        begin_s: simulated time that the world opens at; what comes before fills the roads.
        speed: simulated seconds a second.
        rsus: that have a camera.
        deliveries: orders and vehicles; plans for others are ignored.
        fleet: the dispatcher's fleet file.
        bus: to get plans and tell positions over.
        folder: for the cameras' calibration files.
        seed: of light and scenery.
        fps: pictures a second, by the wall clock.
        width_px: of a picture, with height_px.
    """

    day: DayOrder
    begin_s: float
    speed: float
    rsus: tuple[Rsu, ...]
    deliveries: Deliveries
    fleet: Path
    bus: BusSettings
    folder: Path
    seed: int = 1
    fps: float = 10.0
    width_px: int = 1280
    height_px: int = 720


@dataclass(frozen=True)
class CameraPlace:
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
        on_road: vehicles on the road, the fleet's included.
        plans_followed: rounds begun.
        rounds_finished: rounds ended at the depot.
        legs_driven: of them.
        driven_m: by the fleet.
        fleet_on_road: vehicles of the fleet on a leg.
        vehicles_driven: vehicles of the fleet that have driven at all.
    """

    time_s: float
    simulated_s: float
    steps: int
    late_steps: int
    slipped_s: float
    frames: int
    frames_skipped: int
    on_road: int
    plans_followed: int
    rounds_finished: int
    legs_driven: int
    driven_m: float
    fleet_on_road: int
    vehicles_driven: int
