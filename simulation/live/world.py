"""The simulating process: SUMO against the wall clock, cameras, plans in, positions out."""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import libsumo

from simulation.closed_loop.conductor import NoConductor
from simulation.live.camera import Camera, CameraOrder
from simulation.live.fleet import LiveFleet
from simulation.live.order import WorldCounts, WorldOrder
from simulation.live.pace import Pace
from simulation.live.plans import in_world_time
from simulation.live.sites import camera_site
from simulation.live.views import RADIUS_M, Views
from simulation.scenarios.day import sumo_options
from simulation.scenarios.network import scenario_network
from simulation.sumo.net import read_roads
from simulation.sumo.pose import draw_pose
from simulation.sumo.session import Session
from simulation.sumo.settings import SumoClipSettings
from slipstream.bus import Bus, Publisher
from slipstream.errors import InputError
from slipstream.messages import ALL_PLANS, VehiclePlan, decode, position_key
from slipstream.roads import RoadNetwork

_STEP_S: Final = 0.1
_WARM_STEP_S: Final = 10.0
_TELL_S: Final = 0.5


def steps_per_frame(speed: float, fps: float) -> tuple[int, float]:
    """Steps from one picture to the next and their length, s of simulated time: at most 0.1 s."""
    frame_s = speed / fps
    count = max(1, round(frame_s / _STEP_S + 0.499))
    return count, max(0.001, round(frame_s / count, 3))


class Mailbox:
    """Plans from the bus's thread to the simulation's."""

    def __init__(self, vehicles: frozenset[str]) -> None:
        self._vehicles = vehicles
        self._plans: queue.SimpleQueue[VehiclePlan] = queue.SimpleQueue()

    def take(self, key: str, payload: bytes) -> None:
        """A message from `ALL_PLANS`; what is no plan, or for another fleet, is left out."""
        try:
            plan = decode(VehiclePlan, payload, key)
        except InputError:
            return
        if plan.vehicle in self._vehicles:
            self._plans.put(plan)

    def news(self) -> Iterator[VehiclePlan]:
        """What has come since the last call."""
        while True:
            try:
                yield self._plans.get_nowait()
            except queue.Empty:
                return


def run_world(order: WorldOrder, connection: Connection) -> None:
    """Run until the other end says so: tells the warm-up's share, the cameras, counts.

    Raises:
        InputError: SUMO refuses a file, or a camera's stretch cannot be watched.
        ChildProcessError: a camera died.
    """
    per_frame, step_s = steps_per_frame(order.speed, order.fps)
    day = replace(order.day, step_s=step_s)
    options = [
        *sumo_options(day),
        # Without a duration vehicles jump sideways from lane to lane, which no camera believes.
        *("--lanechange.duration", "2.5"),
    ]
    network = scenario_network(day.net)
    with ExitStack() as stack:
        session = stack.enter_context(Session(options, (day.net, day.routes, *day.additional)))
        _warm_up(session, order, lambda share: connection.send(("warm", share)))
        cameras, views = _open_cameras(order, network, stack)
        connection.send(("cameras", [camera.place() for camera in cameras]))
        bus = stack.enter_context(Bus.open(order.bus))
        mailbox = Mailbox(frozenset(order.deliveries.vehicles))
        bus.subscribe(ALL_PLANS, mailbox.take)
        outlets = {name: bus.publisher(position_key(name)) for name in order.deliveries.vehicles}
        fleet = LiveFleet(session, order.deliveries, network, NoConductor(), step_s, session.time_s)
        _run(order, connection, session, fleet, cameras, views, mailbox, outlets, per_frame, step_s)


def _warm_up(session: Session, order: WorldOrder, tell: Callable[[float], None]) -> None:
    whole_s = order.begin_s - order.day.begin_s
    while (left_s := order.begin_s - session.time_s) > 0:
        tell(1.0 - left_s / whole_s)
        session.advance(min(order.begin_s, session.time_s + _WARM_STEP_S))
    tell(1.0)


def _open_cameras(
    order: WorldOrder, network: RoadNetwork, stack: ExitStack
) -> tuple[list[Camera], Views]:
    cameras, poses = [], []
    for number, rsu in enumerate(order.rsus):
        site = camera_site(rsu, network, order.width_px, order.height_px)
        source = Path(rsu.id)
        pose = draw_pose(site, order.seed + number, source)
        clip = SumoClipSettings(
            order.day.net, order.day.routes, source, fps=order.fps, seed=order.seed + number
        )
        roads = read_roads(pose.x_m, pose.y_m, RADIUS_M)
        calibration = order.folder / f"{rsu.id}.camera.toml"
        camera = Camera(CameraOrder(site, pose, roads, clip, calibration, os.getpid()))
        stack.callback(camera.close)
        cameras.append(camera)
        poses.append(pose)
    return cameras, Views(poses)


def _run(
    order: WorldOrder,
    connection: Connection,
    session: Session,
    fleet: LiveFleet,
    cameras: list[Camera],
    views: Views,
    mailbox: Mailbox,
    outlets: dict[str, Publisher],
    per_frame: int,
    step_s: float,
) -> None:
    pace = Pace(step_s, order.speed, time.monotonic)
    told_s = 0.0
    while not connection.poll(pace.wait_s()):
        for plan in mailbox.news():
            age_s = (time.time_ns() - plan.issued_ns) / 1e9
            fleet.plan(in_world_time(plan, session.time_s - order.speed * age_s))
        fleet.step()
        pace.stepped()
        if pace.steps % per_frame == 0:
            taken_s = time.time()
            for camera, scene in zip(cameras, views.look(), strict=True):
                camera.show(scene, taken_s)
        if time.monotonic() - told_s >= _TELL_S:
            told_s = time.monotonic()
            for position in fleet.positions(time.time_ns()):
                outlets[position.vehicle].put(position)
            connection.send(("counts", _counts(order, session, fleet, cameras, pace)))


def _counts(
    order: WorldOrder, session: Session, fleet: LiveFleet, cameras: list[Camera], pace: Pace
) -> WorldCounts:
    return WorldCounts(
        time_s=session.time_s,
        simulated_s=session.time_s - order.begin_s,
        steps=pace.steps,
        late_steps=pace.late,
        slipped_s=pace.slipped_s,
        frames=sum(camera.frames for camera in cameras),
        frames_skipped=sum(camera.skipped for camera in cameras),
        on_road=int(libsumo.vehicle.getIDCount()),
        plans_followed=fleet.begun,
        rounds_finished=fleet.finished,
        legs_driven=fleet.legs,
        driven_m=fleet.driven_m,
        fleet_on_road=fleet.on_road,
        vehicles_driven=len(fleet.driven),
    )
