"""A dispatcher that takes orders."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from dispatcher_daemon.fleet.file import FleetFile
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.service.intake import OrderIntake
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import Solve, solve_in_process
from slipstream.messages import (
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
    Visit,
    position_key,
    progress_key,
)
from storage import Database, open_database, open_reader
from tests.dispatcher_daemon.service.reporting import Bus

from .conftest import SETTINGS

SOLVE = solve_in_process([ExactSolver()])


@dataclass
class Desk:
    """A dispatcher and its intake on one database."""

    dispatcher: Dispatcher
    intake: OrderIntake
    bus: Bus
    database: Database

    def state(self, name: str) -> str:
        """Of an order."""
        return self.intake.show(name).state

    def visit(self, vehicle: str, stop: str) -> None:
        """A vehicle reports that it has served a stop."""
        now_ns = time.time_ns()
        seen = Visit(stop=stop, status="served", arrived_ns=now_ns, ended_ns=now_ns, reason=None)
        told = VehicleProgress(vehicle=vehicle, time_ns=now_ns, cycle=None, visits=(seen,))
        self.dispatcher.fleet_watch.on_progress(progress_key(vehicle), told.to_bytes())


@contextmanager
def opened(
    problem: RoutingProblem, path: Path, solve: Solve = SOLVE, fleet_file: FleetFile | None = None
) -> Iterator[Desk]:
    """A dispatcher as it starts, on what the one before has stored."""
    url, bus = f"sqlite:///{path / 'a.db'}", Bus()
    with open_database(url) as database, open_reader(url) as reader:
        records = database.load_fleet(time.time_ns())
        dispatcher = Dispatcher(
            SETTINGS,
            problem.network,
            problem.fleet,
            bus,
            database,
            solve,
            fleet_file=fleet_file,
            records=records,
        )
        intake = OrderIntake(dispatcher.fleet_watch, database, reader, problem.network)
        yield Desk(dispatcher, intake, bus, database)


def depart(desk: Desk, plan: VehiclePlan, place: str | None = None) -> None:
    """A vehicle is on the first road of its plan, or stands at a place of it."""
    leg = 0 if place is None else [stop.stop for stop in plan.stops].index(place)
    segment = next(one for one in plan.segments if one.leg == leg).segment
    position = VehiclePosition(
        vehicle=plan.vehicle,
        time_ns=time.time_ns(),
        segment=segment,
        share=0.4 if place is None else 0.0,
        speed_mps=8.0 if place is None else 0.0,
        on_road=place is None,
        cycle=plan.cycle,
        leg=leg,
    )
    key = position_key(plan.vehicle)
    desk.dispatcher.fleet_watch.on_position(key, position.to_bytes())
