"""The dispatcher as a service: its parts opened, joined, watched and closed in order."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

from dispatcher_daemon import metrics
from dispatcher_daemon.fleet import FleetFile
from dispatcher_daemon.planning.cycle import Solving, form_of
from dispatcher_daemon.service.alarms import CHECKS
from dispatcher_daemon.service.api import EventHub
from dispatcher_daemon.service.dispatcher import AlarmSource, Dispatcher, announce_nothing
from dispatcher_daemon.service.intake import OrderAnswers, OrderIntake
from dispatcher_daemon.service.on_demand import Gathering
from dispatcher_daemon.service.schedule import CycleScheduler
from dispatcher_daemon.service.store import database_fault, open_checked_database, open_in_turn
from dispatcher_daemon.settings import ApiSettings, DispatcherSettings
from dispatcher_daemon.solvers import configured_solvers
from dispatcher_daemon.solvers.quantum.hardware import open_job_manager
from slipstream.bus import Bus
from slipstream.messages import (
    ALL_ACKNOWLEDGEMENTS,
    ALL_COUNTS,
    ALL_ORDERS,
    ALL_POSITIONS,
    ALL_PROGRESS,
    ALL_RSU_HEALTH,
    ALL_STATES,
    ALL_STOPPED,
    position_key,
)
from slipstream.roads import RoadNetwork
from slipstream.roads.admission import check_rsus
from slipstream.roads.sumo_net import load_network
from slipstream.service import Service, configure_logging
from slipstream.service.memory import configure_allocator, keep_loaded
from storage import StorageError, open_reader

if TYPE_CHECKING:
    from dispatcher_daemon.service.api import ApiServer

log = logging.getLogger(__name__)

HEALTH_EVERY_S = 1.0
HEARD_AFTER_S = 2.5
"""By then vehicles that the run before knew have said where they are: they do so each second."""
POLL_S = 0.05
"""Between two looks whether the first cycle can begin."""


def check_health(dispatcher: Dispatcher, scheduler: CycleScheduler, service: Service) -> None:
    """The periodic work: follow the clock, publish the health, feed the watchdog.

    Raises:
        StorageError: another dispatcher writes the database. No InputError: systemd then starts
            this one again, which may wait as a standby.
    """
    replaced = dispatcher.delivery.replaced
    if replaced is not None:
        line = f"{replaced.source}: another dispatcher has taken over; this one ends"
        raise StorageError(line)
    scheduler.follow_clock()
    next_cycle_ns = scheduler.next_run_ns
    dispatcher.health.publish(next_cycle_ns)
    if dispatcher.is_live(next_cycle_ns):
        fault = dispatcher.health.solver_fault()
        line = f"{dispatcher.delivery.cycles} cycles"
        service.progress(line if fault is None else f"{line}; {fault}")


def has_heard_all(dispatcher: Dispatcher, rsus: Mapping[str, tuple[str, ...]] | None) -> bool:
    """Whether each vehicle that has ever reported does so now, and each RSU that is listed has told
    of its segments. Without a list nobody knows.
    """
    if rsus is None or dispatcher.fleet_watch.silent():
        return False
    told = {(state.rsu, state.segment) for state in dispatcher.receiver.latest.latest()}
    return told.issuperset((rsu, one) for rsu, segments in rsus.items() for one in segments)


def _open_api(settings: ApiSettings, events: EventHub) -> ApiServer:
    """The API's server, which does not serve yet."""
    # It takes a second to import: reports come in meanwhile.
    from dispatcher_daemon.service.api import ApiServer

    return ApiServer(settings.port, settings.tokens, events=events)


class DispatcherParts:
    """The parts of the dispatcher's process, joined. Its service owns them.

    Raises:
        InputError: the settings do not fit the fleet, or name solvers that cannot be used.
    """

    def __init__(
        self,
        settings: DispatcherSettings,
        service: Service,
        network: RoadNetwork,
        fleet_file: FleetFile,
    ) -> None:
        self._settings, self._service, self._network = settings, service, network
        self._fleet_file, self._fleet = fleet_file, fleet_file.current()
        form = settings.form if self._fleet is None else form_of(settings, self._fleet)
        self._make_solving = partial(
            Solving, settings, configured_solvers(settings), in_routes=form != "arc"
        )
        self._events = None if settings.api.port == 0 else EventHub(time.time_ns())
        self._announce = announce_nothing if self._events is None else self._events.publish

    def start(self, *, standby: bool) -> bool:
        """Start all parts; False: the service was stopped meanwhile.

        Reports come in and the API answers while the solvers still load; cycles come last.

        Args:
            standby: wait for the database once all that takes time is done.

        Raises:
            InputError: a part cannot be started by these settings.
        """
        settings, service = self._settings, self._service
        if not standby:
            database = partial(open_checked_database, settings.database_url)
            self._database = service.start("database", database)
        self._bus = service.start("bus", partial(Bus.open, settings.bus), Bus.fault)
        self._solving = service.start("solvers", self._make_solving, Solving.fault, vital=True)
        if standby:
            self._solving.warm_up(service.stopping)
            if service.stopping.is_set():
                return False
            log.info("standby: waiting for the end of the dispatcher that writes the database")
            free = open_in_turn(settings.database_url, service)
            if free is None:
                return False
            self._database = free
            service.on_stop("database", free.close)
        self._start_dispatcher()
        hears_since = time.monotonic()
        warming = self._warm_up()
        self._start_orders()
        self._prepare_cycles()
        if self._events is not None:
            self._start_api(self._events)
        keep_loaded()
        within_s = min(HEARD_AFTER_S, settings.interval_s) if self._records.vehicles else 0.0
        ends = hears_since + within_s
        while warming.is_alive() or (
            time.monotonic() < ends and not has_heard_all(self._dispatcher, settings.rsus)
        ):
            if service.wait(POLL_S):
                return False
        self._scheduler.start()
        return True

    def _warm_up(self) -> threading.Thread:
        """Warm the solvers up in a thread that ends when they are warm, or the service."""
        stopped = threading.Event()
        thread = threading.Thread(target=self._solving.warm_up, args=(stopped,), name="warm-up")

        def stop() -> None:
            stopped.set()
            thread.join()

        thread.start()
        self._service.on_stop("warm-up", stop)
        return thread

    def _start_dispatcher(self) -> None:
        """The dispatcher and its alarms; it hears states and fleet from here on."""
        settings, service, network = self._settings, self._service, self._network
        bus, database, fleet = self._bus, self._database, self._fleet
        self._records = database.load_fleet(time.time_ns())
        self._solving.join_cluster()
        device = partial(open_job_manager, settings, self._solving.solve, database)
        job_manager = self._device = service.start("device", device)
        self._dispatcher = dispatcher = Dispatcher(
            settings,
            network,
            fleet,
            bus,
            database,
            self._solving.solve,
            self._solving.executor,
            job_manager,
            self._fleet_file,
            self._records,
            self._announce,
        )
        if database.set_aside is not None:
            dispatcher.health.database_set_aside = database.set_aside.name
        dispatcher.health.solver_fault = self._solving.fault
        alarms = partial(
            AlarmSource,
            dispatcher,
            settings,
            network,
            bus,
            database,
            self._announce,
            bus.fault,
            job_manager,
            self._solving.slots,
        )
        self._alarms = service.start("alarms", alarms)
        bus.subscribe(ALL_STATES, dispatcher.receiver.on_state, history=False)
        watch = dispatcher.fleet_watch
        bus.subscribe(ALL_POSITIONS, watch.on_position, history=False)
        bus.subscribe(ALL_ACKNOWLEDGEMENTS, watch.on_acknowledgement, every=True)
        bus.subscribe(ALL_PROGRESS, watch.on_progress)
        bus.expect(position_key(one.id) for one in (fleet.vehicles if fleet else ()))
        bus.subscribe(ALL_COUNTS, dispatcher.receiver.on_counts, every=True)
        bus.subscribe(ALL_RSU_HEALTH, dispatcher.receiver.on_health, history=False)
        bus.subscribe(ALL_STOPPED, self._alarms.roadside.on_stopped, history=False)

    def _start_orders(self) -> None:
        service, dispatcher, announce = self._service, self._dispatcher, self._announce
        inserter = service.start("insertion", partial(Gathering, "insertion", dispatcher.insert))
        reader = partial(open_reader, self._settings.database_url)
        self._reader = service.start("reading the database", reader)
        self._orders = OrderIntake(
            dispatcher.fleet_watch,
            self._database,
            self._reader,
            self._network,
            announce=lambda change: announce("order", change),
            taken=inserter.put,
        )
        self._bus.answer(ALL_ORDERS, OrderAnswers(self._orders, dispatcher.control.note).answer)

    def _prepare_cycles(self) -> None:
        """The schedule of cycles, and what the dispatcher lacks for them; none runs yet."""
        dispatcher, settings, checks = self._dispatcher, self._settings, self._service.checks
        self._scheduler = scheduler = CycleScheduler(
            dispatcher.run_cycle,
            settings.interval_s,
            lambda kind: metrics.CYCLE_FAULTS.labels(kind).inc(),
        )
        dispatcher.control.run_soon = lambda: (
            dispatcher.cycle_began is None and scheduler.run_soon()
        )

        def unscheduled() -> str | None:
            if dispatcher.delivery.cycles > 0 or scheduler.next_run_ns is not None:
                return None
            return "none has run, and none is scheduled"

        checks["database"] = partial(database_fault, self._reader)
        checks["network"] = lambda: None if self._network.segments else "it has no segment"
        checks["cycle"] = unscheduled
        for name in CHECKS:
            checks[name] = partial(self._lacks, name, checks.get(name, lambda: None))
        self._service.awaited = lambda: self._alarms.awaited
        self._service.on_stop("cycles", self._stop_cycles)

    def _lacks(self, check: str, own: Callable[[], str | None]) -> str | None:
        """Why a check is not met, by its own look at it or by what is critical now."""
        return own() or self._alarms.unmet.get(check)

    def _stop_cycles(self) -> None:
        """Workers first: a cycle that waits for them must not hold up the end."""
        self._dispatcher.delivery.stopping.set()
        self._solving.close()
        if self._device is not None:
            self._device.close()
        self._scheduler.stop()
        self._dispatcher.receiver.store_rollups(self._database)

    def _start_api(self, events: EventHub) -> None:
        dispatcher, scheduler = self._dispatcher, self._scheduler
        api = self._service.start("the API's port", partial(_open_api, self._settings.api, events))
        from dispatcher_daemon.service.api import Services

        def is_live() -> bool:
            # Cycles come once the solvers are ready.
            return not scheduler.is_started or dispatcher.is_live(scheduler.next_run_ns)

        services = Services(
            settings=self._settings,
            network=self._network,
            fleet=dispatcher.fleet_watch,
            states=dispatcher.receiver.latest,
            orders=self._orders,
            feeds=dispatcher.feeds,
            reader=self._reader,
            alarms=self._alarms.alarms,
            control=dispatcher.control,
            events=events,
            solve_jobs=api.solve_jobs,
            is_live=is_live,
            solver_fault=dispatcher.health.solver_fault,
            checks=self._service.checks,
            awaited=self._service.awaited,
        )
        self._service.on_stop("the API", api.close)
        api.start(services)
        log.info("API on http://127.0.0.1:%d", api.port)

    def watch(self) -> None:
        """Publish health and alarms each second until the service stops.

        Raises:
            StorageError: another dispatcher has taken over the database.
        """
        while not self._service.wait(HEALTH_EVERY_S):
            self._solving.ask_again()
            check_health(self._dispatcher, self._scheduler, self._service)
            self._alarms.update()


def run_dispatcher(settings: DispatcherSettings, *, standby: bool = False) -> None:
    """Run until SIGTERM or SIGINT.

    Raises:
        InputError: the network, list of RSUs, fleet, database, bus, metrics port, or the API's
            port or file of tokens cannot be used.
        StorageError: another dispatcher has taken over the database meanwhile.
    """
    configure_allocator()
    configure_logging("dispatcher", settings.service)
    # The scheduler's own faults are counted and logged by CycleScheduler.
    logging.getLogger("apscheduler").setLevel(logging.CRITICAL)
    network = load_network(settings.network)
    check_rsus(settings.rsus, network, "dispatcher")
    if settings.rsus is None:
        log.warning("any RSU may report on any segment, as rsus lists none")
    fleet_file = FleetFile(settings.fleet, network)
    with Service("dispatcher", settings.service) as service:
        parts = DispatcherParts(settings, service, network, fleet_file)
        if parts.start(standby=standby):
            service.ready()
            parts.watch()
