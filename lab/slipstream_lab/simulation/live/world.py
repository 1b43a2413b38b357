"""The simulating process: SUMO against the wall clock, cameras, plans in, positions out."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import libsumo

from slipstream.bus import Bus
from slipstream.osm import largest_part
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from slipstream.service.memory import TRIM_INTERVAL_S, trim_memory
from slipstream_lab.simulation.fleet.brakes import Reality
from slipstream_lab.simulation.fleet.van import yards
from slipstream_lab.simulation.fleet.world import FleetWorld
from slipstream_lab.simulation.live.agents import BusAgents, BusGates
from slipstream_lab.simulation.live.camera import CameraSpec, SimulatedCamera
from slipstream_lab.simulation.live.fleet_file import LiveFleetFile
from slipstream_lab.simulation.live.pace import WorldPace
from slipstream_lab.simulation.live.signals import LiveSignals
from slipstream_lab.simulation.live.views import RADIUS_M, Views
from slipstream_lab.simulation.live.world_spec import WorldCounts, WorldSpec
from slipstream_lab.simulation.scenarios.day import sumo_options
from slipstream_lab.simulation.scenarios.gridlock import CHECK_S, GridlockWatch
from slipstream_lab.simulation.signals import SignalController
from slipstream_lab.simulation.sumo.session import SumoSession
from slipstream_lab.simulation.sumo_view import SumoClipSettings, camera_site, draw_pose
from slipstream_lab.simulation.sumo_view.net import read_roads

_WARM_STEP_S: Final = 10.0
_REPORT_S: Final = 0.5
_LOOK_S: Final = 1.0


def run_world(spec: WorldSpec, connection: Connection) -> None:
    """Run until the other end stops it; sends the warm-up's share, the cameras, status counts.

    Raises:
        InputError: SUMO refuses a file, or a camera's stretch cannot be watched.
        ChildProcessError: a camera died.
    """
    day = replace(spec.day, step_s=spec.step_s)
    options = [
        *sumo_options(day),
        # Without a duration vehicles jump sideways from lane to lane, which no camera believes.
        *("--lanechange.duration", "2.5"),
    ]
    roads = load_network(day.net)
    network = largest_part(roads, day.net)
    with ExitStack() as stack:
        session = stack.enter_context(SumoSession(options, day.files))
        _warm_up(session, spec, lambda share: connection.send(("warm", share)))
        cameras, views = _open_cameras(spec, network, stack)
        connection.send(("cameras", [camera.place() for camera in cameras]))
        bus = stack.enter_context(Bus.open(spec.bus))
        # Of all roads: the dispatcher may lead over one outside the connected part.
        lengths_m = {name: segment.length_m for name, segment in roads.segments.items()}
        _World(spec, network, lengths_m, session, cameras, views, bus).run(connection)


class _World:
    """An open world, its roads full and its cameras running."""

    def __init__(
        self,
        spec: WorldSpec,
        network: RoadNetwork,
        lengths_m: Mapping[str, float],
        session: SumoSession,
        cameras: list[SimulatedCamera],
        views: Views,
        bus: Bus,
    ) -> None:
        self._spec, self._session = spec, session
        self._cameras, self._views = cameras, views
        vehicles = spec.deliveries.vehicles
        intersections = network.intersections
        self._signals = LiveSignals(
            bus, SignalController(intersections, spec.priority), intersections
        )
        # Of the town's own orders; those of others are served as their plans have it.
        service_s = {order.id: order.service_s for order in spec.deliveries.orders}
        kind = spec.deliveries.settings.vehicle_type
        self._fleet = FleetWorld(
            session,
            yards(spec.deliveries, network),
            kind,
            lengths_m,
            BusAgents(bus, vehicles),
            BusGates(bus),
            service_s.get,
            spec.step_s,
            time.time_ns,
            _LOOK_S,
            reality=Reality.of_day(kind, spec.road, ideal=False, seed=spec.seed),
        )
        self._orders = LiveFleetFile(spec.fleet, spec.deliveries, session.time_s)
        self._legs, self._driven_m, self._platooned_m = 0, 0.0, 0.0
        self._pace = WorldPace(spec.step_s, time.monotonic)
        self._gridlock, self._look_s = GridlockWatch(), session.time_s + CHECK_S

    def run(self, connection: Connection) -> None:
        """Step by step, until the other end says something or is gone. Raises InputError: SUMO
        refuses a vehicle, or nothing moves any more.
        """
        # The network stays: looking through it would hold up a step twice a minute.
        gc.collect()
        gc.freeze()
        reported_s, trimmed_s = 0.0, time.monotonic()
        while not connection.poll(self._pace.wait_s()):
            now_s = self._session.time_s
            self._signals.step(now_s, time.time_ns() - round(now_s * 1e9))
            for leg in self._fleet.step():
                self._legs += 1
                self._driven_m += leg.distance_m
                self._platooned_m += leg.led_m + leg.followed_m
            self._pace.stepped()
            self._look_for_gridlock()
            if self._pace.steps % self._spec.steps_a_frame == 0:
                for camera, scene in zip(
                    self._cameras, self._views.vehicles_in_view(), strict=True
                ):
                    camera.show(scene, self._pace.due_s)
            if time.monotonic() - reported_s >= _REPORT_S:
                reported_s = time.monotonic()
                self._report_time(connection)
            if time.monotonic() - trimmed_s >= TRIM_INTERVAL_S:
                trimmed_s = time.monotonic()
                trim_memory()

    def _look_for_gridlock(self) -> None:
        now_s = self._session.time_s
        if now_s >= self._look_s:
            self._look_s += CHECK_S
            self._gridlock.refuse(now_s, self._spec.day.source)

    def _report_time(self, connection: Connection) -> None:
        """What orders and the world itself have to say twice a second."""
        waiting = self._orders.write(self._session.time_s, self._fleet.begun_s)
        connection.send(("counts", self._counts(waiting)))

    def _counts(self, waiting: int) -> WorldCounts:
        fleet, pace = self._fleet, self._pace
        return WorldCounts(
            time_s=self._session.time_s,
            simulated_s=self._session.time_s - self._spec.begin_s,
            steps=pace.steps,
            late_steps=pace.late,
            slipped_s=pace.slipped_s,
            frames=sum(camera.frames for camera in self._cameras),
            frames_skipped=sum(camera.skipped for camera in self._cameras),
            vehicles=int(libsumo.vehicle.getIDCount()),
            orders_waiting=waiting,
            tours_begun=fleet.tours_begun,
            tours_finished=fleet.tours_finished,
            orders_served=len(fleet.begun_s),
            orders_served_again=len(fleet.again),
            longest_silence_s=fleet.longest_silence_s,
            platooned_m=self._platooned_m,
            legs_driven=self._legs,
            fleet_driven_m=self._driven_m,
            fleet_on_road=fleet.on_road,
            fleet_vehicles_driven=fleet.driven,
            safety=fleet.safety.found,
            others=fleet.safety.others,
        )


def _warm_up(session: SumoSession, spec: WorldSpec, report_time: Callable[[float], None]) -> None:
    whole_s = spec.begin_s - spec.day.begin_s
    while (left_s := spec.begin_s - session.time_s) > 0:
        report_time(1.0 - left_s / whole_s)
        session.advance(min(spec.begin_s, session.time_s + _WARM_STEP_S))
    report_time(1.0)


def _open_cameras(
    spec: WorldSpec, network: RoadNetwork, stack: ExitStack
) -> tuple[list[SimulatedCamera], Views]:
    cameras, poses = [], []
    for number, rsu in enumerate(spec.rsus):
        site = camera_site(rsu, network, spec.width_px, spec.height_px)
        source, seed = Path(rsu.id), spec.seed + number
        pose = draw_pose(site, seed, source)
        clip = SumoClipSettings(spec.day.net, spec.day.routes, source, fps=spec.fps, seed=seed)
        roads = read_roads(pose.x_m, pose.y_m, RADIUS_M)
        calibration = spec.folder / f"{rsu.id}.camera.toml"
        camera = SimulatedCamera(CameraSpec(site, pose, roads, clip, calibration, os.getpid()))
        stack.callback(camera.close)
        cameras.append(camera)
        poses.append(pose)
    return cameras, Views(poses)
