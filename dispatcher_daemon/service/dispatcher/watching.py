"""What the dispatcher's alarms are found by: facts of all its parts, once a second."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Final, Self

from dispatcher_daemon.fleet.tracking import HIDDEN
from dispatcher_daemon.service.alarms import (
    KINDS,
    AlarmWatch,
    Condition,
    RoadsideWatch,
    ServiceFacts,
    fleet_conditions,
    fleet_lost,
    service_conditions,
    unmet,
)
from dispatcher_daemon.service.dispatcher.dispatcher import Dispatcher
from dispatcher_daemon.service.dispatcher.publishing import Announce, MessageBus
from dispatcher_daemon.service.on_demand import Gathering
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.quantum.hardware import JobManager
from slipstream.messages import ALARMS_KEY
from slipstream.roads import RoadNetwork
from slipstream.service import LogLimiter
from storage import Database

log = logging.getLogger(__name__)

RECONNECTED_S: Final = 10.0
"""Until so long after the bus is back RSUs and fleet count as before: all of them were silent."""


class AlarmSource:
    """Finds conditions and hands them to the alarms, which are stored on a thread that may wait; a
    context manager.

    Attributes:
        unmet: why the dispatcher is not ready, by check.
        awaited: what has not come since the start, in words, and may be about to; by check.
    """

    def __init__(
        self,
        dispatcher: Dispatcher,
        settings: DispatcherSettings,
        network: RoadNetwork,
        bus: MessageBus,
        store: Database,
        announce: Announce,
        bus_fault: Callable[[], str | None] = lambda: None,
        job_manager: JobManager | None = None,
        cluster_slots: Callable[[], int] | None = None,
    ) -> None:
        self._dispatcher, self._settings, self._store = dispatcher, settings, store
        self._bus_fault, self._job_manager = bus_fault, job_manager
        self._cluster_slots = cluster_slots
        self.unmet: Mapping[str, str] = {}
        self.awaited: Mapping[str, str] = {}
        self._unstored = False
        self._unconnected_s = -RECONNECTED_S
        self._of_others: tuple[Condition, ...] = ()
        self._of_fleet: tuple[Condition, ...] = ()
        self._limiter = LogLimiter()
        publisher = bus.publisher(ALARMS_KEY)

        self._saver = Gathering("alarms", lambda _: self.alarms.save())
        tell = partial(announce, "alarm")
        self.alarms = AlarmWatch(store, publisher.put, tell, self._saver.put)
        self.roadside = RoadsideWatch(
            network,
            settings.rsus,
            settings.stale_after_s,
            dispatcher.receiver.healths,
            dispatcher.receiver.refuse,
            time.time_ns,
            dispatcher.receiver.latest.latest,
        )
        self._started_ns = time.time_ns()

    def close(self) -> None:
        """Store what is not stored yet, and end the thread."""
        self.alarms.save()
        self._saver.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def update(self) -> None:
        """Find what is wrong now. Errors are logged and do not stop the dispatcher."""
        try:
            found = list(self._conditions())
            self.unmet = unmet(found)
            self.awaited = {KINDS[c.kind].check or c.kind: c.text for c in found if c.awaited}
            self.alarms.update(one for one in found if not one.awaited)
        except Exception as error:
            if self._limiter.allow("alarms"):
                log.exception("the alarms could not be brought up to date: %s", error)

    def _conditions(self) -> Iterator[Condition]:
        facts, now_s = self._facts(), time.monotonic()
        if self._unstored and facts.storage_fault is None:
            # It may be another database by now.
            self.alarms.save_all()
        self._unstored = facts.storage_fault is not None
        yield from service_conditions(facts)
        if facts.bus_fault is not None:
            self._unconnected_s = now_s
        if now_s - self._unconnected_s >= RECONNECTED_S:
            self._of_others = tuple(self._conditions_of_others(now_s))
        yield from self._of_others

    def _conditions_of_others(self, now_s: float) -> Iterator[Condition]:
        dispatcher, now_ns = self._dispatcher, time.time_ns()
        yield from self.roadside.conditions(dispatcher.health.receptions, now_s)
        last, number = dispatcher.delivery.last, dispatcher.delivery.next_number
        reported = () if last is None else last.unserved
        # What is hidden is a stop of the file; the order of that name is a caller's.
        unserved = {stop.stop: stop.reason for stop in reported if stop.reason != HIDDEN}
        found = dispatcher.fleet_watch.read_soon(
            lambda tracker: (
                *fleet_lost(tracker, self._started_ns, now_ns),
                *fleet_conditions(tracker, unserved, number, now_ns),
            )
        )
        # While a cycle is being stored, as it was before that.
        self._of_fleet = self._of_fleet if found is None else found
        yield from self._of_fleet

    def _facts(self) -> ServiceFacts:
        dispatcher = self._dispatcher
        began, paused = dispatcher.cycle_began, dispatcher.control.paused
        return ServiceFacts(
            interval_s=self._settings.interval_s,
            cycle=dispatcher.delivery.last,
            unanswered=dispatcher.delivery.unanswered,
            running_s=None if began is None else time.monotonic() - began,
            paused=None if paused is None else (paused.by, paused.since_ns),
            storage_fault=dispatcher.delivery.unstored,
            clock_fault=dispatcher.pruner.clock_fault,
            bus_fault=self._bus_fault(),
            set_aside=dispatcher.health.database_set_aside,
            keep_mb=self._settings.keep_mb,
            room=self._store.room(),
            device=None if self._job_manager is None else self._job_manager.health(),
            solver_fault=dispatcher.health.solver_fault(),
            cluster_slots=None if self._cluster_slots is None else self._cluster_slots(),
        )
