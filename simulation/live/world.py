"""The simulating process: SUMO against the wall clock, cameras, plans in, positions out."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import libsumo

from simulation.closed_loop.policy import LEVERS, WITHOUT_PRIORITY, Policy
from simulation.controllers.fleet_controller import FleetController
from simulation.live.camera import Camera, CameraSpec
from simulation.live.fleet import LiveFleet
from simulation.live.fleet_file import FleetFile
from simulation.live.gates import BusGates
from simulation.live.pace import Pace
from simulation.live.plans import PlanQueue, in_world_time
from simulation.live.sites import camera_site
from simulation.live.views import RADIUS_M, Views
from simulation.live.world_spec import WorldCounts, WorldSpec
from simulation.scenarios.day import sumo_options
from simulation.scenarios.gridlock import CHECK_S, GridlockWatch
from simulation.scenarios.networks import scenario_network
from simulation.sumo.session import Session
from simulation.sumo_view import SumoClipSettings, draw_pose
from simulation.sumo_view.net import read_roads
from slipstream.bus import Bus
from slipstream.messages import ALL_PLANS, ALL_STATES, position_key
from slipstream.roads import RoadNetwork

_WARM_STEP_S: Final = 10.0
_REPORT_S: Final = 0.5


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
    network = scenario_network(day.net)
    with ExitStack() as stack:
        session = stack.enter_context(Session(options, (day.net, day.routes, *day.additional)))
        _warm_up(session, spec, lambda share: connection.send(("warm", share)))
        cameras, views = _open_cameras(spec, network, stack)
        connection.send(("cameras", [camera.place() for camera in cameras]))
        bus = stack.enter_context(Bus.open(spec.bus))
        _World(spec, network, session, cameras, views, bus).run(connection)


class _World:
    """An open world, its roads full and its cameras running."""

    def __init__(
        self,
        spec: WorldSpec,
        network: RoadNetwork,
        session: Session,
        cameras: list[Camera],
        views: Views,
        bus: Bus,
    ) -> None:
        self._spec, self._session = spec, session
        self._cameras, self._views = cameras, views
        vehicles = spec.deliveries.vehicles
        self._mailbox, gates = PlanQueue(vehicles), BusGates()
        bus.subscribe(ALL_PLANS, self._mailbox.take)
        bus.subscribe(ALL_STATES, gates.take, history=False)
        self._outlets = {name: bus.publisher(position_key(name), history=0) for name in vehicles}
        lengths_m = {name: segment.length_m for name, segment in network.segments.items()}
        policy = Policy("live", frozenset(LEVERS) if spec.priority else WITHOUT_PRIORITY)
        controller = FleetController(policy.levers, spec.day.net, spec.step_s, lengths_m, gates)
        self._fleet = LiveFleet(
            session, spec.deliveries, network, controller, spec.step_s, session.time_s
        )
        self._orders = FleetFile(spec.fleet, spec.deliveries)
        self._pace = Pace(spec.step_s, spec.speed, time.monotonic)
        self._gridlock, self._look_s = GridlockWatch(), session.time_s + CHECK_S

    def run(self, connection: Connection) -> None:
        """Step by step, until the other end says something or is gone.

        Raises:
            InputError: SUMO refuses a vehicle, or nothing moves any more.
        """
        reported_s = 0.0
        while not connection.poll(self._pace.wait_s()):
            self._take_plans()
            self._fleet.step()
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

    def _look_for_gridlock(self) -> None:
        now_s = self._session.time_s
        if now_s >= self._look_s:
            self._look_s += CHECK_S
            self._gridlock.refuse(now_s, self._spec.day.routes)

    def _take_plans(self) -> None:
        for plan in self._mailbox.drain():
            age_s = (time.time_ns() - plan.issued_ns) / 1e9
            issued_s = self._session.time_s - self._spec.speed * age_s
            self._fleet.plan(in_world_time(plan, issued_s))

    def _report_time(self, connection: Connection) -> None:
        """What vehicles, orders and the world itself have to say twice a second."""
        for position in self._fleet.positions(time.time_ns()):
            self._outlets[position.vehicle].put(position)
        tours = self._fleet.tours
        waiting = self._orders.write(self._session.time_s, tours.idle, tours.taken)
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
            rounds_begun=fleet.begun,
            rounds_finished=fleet.finished,
            legs_driven=fleet.legs,
            fleet_driven_m=fleet.driven_m,
            fleet_on_road=fleet.on_road,
            fleet_vehicles_driven=len(fleet.driven),
        )


def _warm_up(session: Session, spec: WorldSpec, report_time: Callable[[float], None]) -> None:
    whole_s = spec.begin_s - spec.day.begin_s
    while (left_s := spec.begin_s - session.time_s) > 0:
        report_time(1.0 - left_s / whole_s)
        session.advance(min(spec.begin_s, session.time_s + _WARM_STEP_S))
    report_time(1.0)


def _open_cameras(
    spec: WorldSpec, network: RoadNetwork, stack: ExitStack
) -> tuple[list[Camera], Views]:
    cameras, poses = [], []
    for number, rsu in enumerate(spec.rsus):
        site = camera_site(rsu, network, spec.width_px, spec.height_px)
        source, seed = Path(rsu.id), spec.seed + number
        pose = draw_pose(site, seed, source)
        clip = SumoClipSettings(spec.day.net, spec.day.routes, source, fps=spec.fps, seed=seed)
        roads = read_roads(pose.x_m, pose.y_m, RADIUS_M)
        calibration = spec.folder / f"{rsu.id}.camera.toml"
        camera = Camera(CameraSpec(site, pose, roads, clip, calibration, os.getpid()))
        stack.callback(camera.close)
        cameras.append(camera)
        poses.append(pose)
    return cameras, Views(poses)
