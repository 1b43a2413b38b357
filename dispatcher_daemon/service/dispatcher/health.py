"""What the dispatcher says of itself: DispatcherHealth, once a second."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Final

from dispatcher_daemon.service.dispatcher.control import Control
from dispatcher_daemon.service.dispatcher.delivery import PlanDelivery
from dispatcher_daemon.service.dispatcher.publishing import MessageBus
from dispatcher_daemon.service.dispatcher.receiver import StateReceiver
from dispatcher_daemon.service.dispatcher.reports import worst_receptions
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.quantum.hardware import JobManager
from dispatcher_daemon.traffic import Reception
from slipstream.bus.inbox import lost
from slipstream.freshness import FUTURE_TOLERANCE_S
from slipstream.messages import DISPATCHER_HEALTH_KEY, DispatcherHealth
from slipstream.service import LogLimiter, rss_mb

log = logging.getLogger(__name__)

_MAX_VEHICLES: Final = 200
"""Vehicles that it names."""


class HealthPublisher:
    """Publishes the dispatcher's health.

    Attributes:
        database_set_aside: file that a damaged database became.
    """

    def __init__(
        self,
        bus: MessageBus,
        settings: DispatcherSettings,
        receiver: StateReceiver,
        fleet_watch: FleetWatch,
        delivery: PlanDelivery,
        job_manager: JobManager | None,
        started_ns: int,
        control: Control,
    ) -> None:
        self._settings, self._receiver, self._delivery = settings, receiver, delivery
        self._fleet_watch, self._job_manager = fleet_watch, job_manager
        self._started_ns, self._control = started_ns, control
        self._publisher = bus.publisher(DISPATCHER_HEALTH_KEY)
        self._limiter = LogLimiter()
        self._stops = 0
        self.receptions: tuple[tuple[str, Reception], ...] = ()
        self.database_set_aside: str | None = None
        self.solver_fault: Callable[[], str | None] = lambda: None

    def publish(self, next_cycle_ns: int | None) -> None:
        """Publish it; errors are logged and do not stop the dispatcher."""
        try:
            self._publisher.put(self._health(next_cycle_ns))
        except Exception as error:
            if self._limiter.allow("health"):
                log.exception("the health could not be published: %s", error)

    def _health(self, next_cycle_ns: int | None) -> DispatcherHealth:
        receiver = self._receiver
        fleet = self._fleet_watch.figures()
        silent = sorted(fleet.silent, key=lambda one: (-one.orders, one.vehicle))
        reception = receiver.latest.reception
        reception.beat()
        if reception.stops > self._stops:
            # Whether the beat or a state before it has noticed.
            self._stops = reception.stops
            log.warning(
                "this dispatcher stood still for seconds: no RSU is blamed for states missed"
            )
        self.receptions = tuple(reception.figures())
        return DispatcherHealth(
            time_ns=time.time_ns(),
            started_ns=self._started_ns,
            cycles=self._delivery.cycles,
            cycles_failed=self._delivery.failed,
            states_received=receiver.received,
            bad_messages=receiver.bad_messages,
            states_refused=receiver.refused,
            messages_lost=lost(),
            stops=reception.stops,
            states_missed_here=reception.missed_here,
            rsus=worst_receptions(self.receptions),
            next_cycle_ns=next_cycle_ns,
            rss_mb=rss_mb(),
            hardware=None if self._job_manager is None else self._job_manager.health(),
            stale_after_s=self._settings.stale_after_s,
            future_tolerance_s=FUTURE_TOLERANCE_S,
            vehicles_reporting=fleet.reporting,
            vehicles_silent=len(silent),
            silent=tuple(silent[:_MAX_VEHICLES]),
            unheard=fleet.unheard[:_MAX_VEHICLES],
            orders=dict(fleet.orders),
            database_set_aside=self.database_set_aside,
            paused=self._control.paused is not None,
            solver_fault=self.solver_fault(),
        )
