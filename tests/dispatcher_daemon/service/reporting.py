"""A dispatcher on a database, and what its vehicles report."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.settings import DispatcherSettings, OrderSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from slipstream.messages import (
    Message,
    PlanAcknowledgement,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
    acknowledgement_key,
    position_key,
    progress_key,
)
from storage import Database

SETTINGS = DispatcherSettings(solvers=("exact",), orders=OrderSettings(bundle_s=0.0))


@dataclass
class Bus:
    """Keeps what is published, by key."""

    sent: list[Message] = field(default_factory=list)

    def publisher(self, key: str) -> Bus:
        """Any key."""
        return self

    def put(self, message: Message | bytes) -> None:
        """Keep it."""
        assert isinstance(message, Message)
        self.sent.append(message)

    def plans(self, vehicle: str) -> list[VehiclePlan]:
        """Of one vehicle, in order."""
        return [m for m in self.sent if isinstance(m, VehiclePlan) and m.vehicle == vehicle]


def make(demo: RoutingProblem, bus: Bus, database: Database) -> Dispatcher:
    """A dispatcher on a database, as it starts."""
    return Dispatcher(
        SETTINGS,
        demo.network,
        demo.fleet,
        bus,
        database,
        solve_in_process([ExactSolver()]),
        records=database.load_fleet(time.time_ns()),
    )


def tell(dispatcher: Dispatcher, message: VehiclePosition | VehicleProgress) -> None:
    """A vehicle reports."""
    watch = dispatcher.fleet_watch
    if isinstance(message, VehiclePosition):
        watch.on_position(position_key(message.vehicle), message.to_bytes())
    else:
        watch.on_progress(progress_key(message.vehicle), message.to_bytes())


def accept(dispatcher: Dispatcher, plan: VehiclePlan) -> None:
    """Its vehicle takes a plan."""
    answer = PlanAcknowledgement(
        vehicle=plan.vehicle, time_ns=time.time_ns(), cycle=plan.cycle, accepted=True, reason=None
    )
    key = acknowledgement_key(plan.vehicle)
    dispatcher.fleet_watch.on_acknowledgement(key, answer.to_bytes())


def at(
    plan: VehiclePlan | None, segment: str, share: float, leg: int = 0, vehicle: str = "van-a"
) -> VehiclePosition:
    """A vehicle on a segment; standing without a plan."""
    return VehiclePosition(
        vehicle=vehicle,
        time_ns=time.time_ns(),
        segment=segment,
        share=share,
        speed_mps=0.0 if plan is None else 10.0,
        on_road=plan is not None,
        cycle=None if plan is None else plan.cycle,
        leg=None if plan is None else leg,
    )
