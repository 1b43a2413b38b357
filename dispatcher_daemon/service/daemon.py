"""The dispatcher as a service: its parts opened, joined, watched and closed in order."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from dispatcher_daemon import metrics
from dispatcher_daemon.fleet.file import FleetFile
from dispatcher_daemon.planning import search_within
from dispatcher_daemon.planning.cycle.cycle import form_of
from dispatcher_daemon.service.dispatcher import AlarmSource, Announce, Dispatcher, announce_nothing
from dispatcher_daemon.service.intake import OrderAnswers, OrderIntake
from dispatcher_daemon.service.on_demand import Gathering
from dispatcher_daemon.service.schedule import CycleScheduler
from dispatcher_daemon.service.store import database_fault, open_checked_database, open_in_turn
from dispatcher_daemon.settings import ApiSettings, DispatcherSettings
from dispatcher_daemon.solvers.protocol import Solver
from dispatcher_daemon.solvers.quantum.hardware import open_job_manager
from dispatcher_daemon.solvers.registry import configured_solvers
from dispatcher_daemon.solvers.workers.pool import Solve, SolverPool
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor
from slipstream.admission import check_rsus
from slipstream.bus import Bus
from slipstream.messages import ALL_RSU_HEALTH, ALL_STATES, ALL_STOPPED, position_key
from slipstream.roads import RoadNetwork
from slipstream.service import Service, configure_logging
from slipstream.sumo_net import load_network
from storage import Database, Reader, StorageError, open_reader

if TYPE_CHECKING:
    from dispatcher_daemon.service.api import ApiServer, Services

log = logging.getLogger(__name__)

HEALTH_EVERY_S = 1.0
HEARD_AFTER_S = 2.5
"""By then vehicles that the run before knew have said where they are: they do so each second."""


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


@contextmanager
def _open_api(settings: ApiSettings) -> Iterator[ApiServer | None]:
    """The API's server, which does not serve yet; None: the settings want none."""
    if settings.port == 0:
        yield None
        return
    # The web framework takes half a second to import.
    from dispatcher_daemon.service.api import ApiServer

    with ApiServer(settings.port, settings.tokens) as server:
        yield server


def _services(
    settings: DispatcherSettings,
    network: RoadNetwork,
    dispatcher: Dispatcher,
    scheduler: CycleScheduler,
    reader: Reader,
    orders: OrderIntake,
    watched: AlarmSource,
    api: ApiServer,
    checks: Mapping[str, Callable[[], str | None]],
) -> Services:
    from dispatcher_daemon.service.api import Services

    return Services(
        settings=settings,
        network=network,
        fleet=dispatcher.fleet_watch,
        states=dispatcher.receiver.latest,
        orders=orders,
        feeds=dispatcher.feeds,
        reader=reader,
        alarms=watched.alarms,
        control=dispatcher.control,
        events=api.events,
        solve_jobs=api.solve_jobs,
        is_live=lambda: dispatcher.is_live(scheduler.next_run_ns),
        solver_fault=dispatcher.health.solver_fault,
        checks=checks,
    )


def _checks(
    network: RoadNetwork,
    dispatcher: Dispatcher,
    scheduler: CycleScheduler,
    bus: Bus,
    reader: Reader,
) -> dict[str, Callable[[], str | None]]:
    """What a dispatcher needs to be ready, by name."""

    def has_cycle() -> bool:
        return dispatcher.delivery.cycles > 0 or scheduler.next_run_ns is not None

    return {
        "database": lambda: database_fault(reader),
        "bus": bus.fault,
        "network": lambda: None if network.segments else "it has no segment",
        "cycle": lambda: None if has_cycle() else "none has run, and none is scheduled",
        "solvers": dispatcher.health.solver_fault,
    }


def _solver_fault(
    pool: SolverPool, search: WorkerExecutor, slots: Callable[[], int] | None
) -> str | None:
    """Why no solver works, or no search for routes; None: they do, or a cluster does it all."""
    if slots is not None and slots() > 0:
        return None
    if (fault := pool.fault()) is not None:
        return f"no solver works ({fault})"
    return None if search.fault is None else f"no search for routes works ({search.fault})"


def _collect_garbage_less() -> None:
    """Keep full collections out of cycles: one stops all threads for tenths of a second.

    By default a cycle of 10,000 segments has half a dozen of them. What is loaded by now stays.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)


def run_dispatcher(settings: DispatcherSettings, *, standby: bool = False) -> None:
    """Run until SIGTERM or SIGINT.

    Args:
        settings: checked settings.
        standby: wait, with all that takes time done, until no other dispatcher writes the database.

    Raises:
        InputError: the network, list of RSUs, fleet, database, bus, metrics port, or the API's
            port or file of tokens cannot be used.
        StorageError: another dispatcher has taken over the database meanwhile.
    """
    configure_logging("dispatcher", settings.service)
    # The scheduler's own faults are counted and logged by CycleScheduler.
    logging.getLogger("apscheduler").setLevel(logging.CRITICAL)
    network = load_network(settings.network)
    check_rsus(settings.rsus, network, "dispatcher")
    if settings.rsus is None:
        log.warning("any RSU may report on any segment, as rsus lists none")
    fleet_file = FleetFile(settings.fleet, network)
    fleet = fleet_file.current()
    form = settings.form if fleet is None else form_of(settings, fleet)
    # Blocks of a city are solved in parallel; the arc form gives each solver one problem.
    in_routes = form != "arc"
    parallel = settings.city.search.workers if in_routes else 1
    workers: dict[str, int] = dict.fromkeys(settings.city.solvers, parallel)
    solvers = configured_solvers(settings)
    own_processes = WorkerExecutor(settings.city.search.workers)
    with (
        Service("dispatcher", settings.service) as service,
        ExitStack() as stack,
    ):
        api: ApiServer | None = None
        database: Database | None = None
        if not standby:
            api = stack.enter_context(_open_api(settings.api))
            database = stack.enter_context(open_checked_database(settings.database_url))
        bus = stack.enter_context(Bus.open(settings.bus))
        pool = stack.enter_context(SolverPool(solvers, workers))
        stack.enter_context(own_processes)
        not_ready = pool.warm_up(stopping=service.stopping)
        if service.stopping.is_set():
            return
        for name, reason in not_ready.items():
            log.warning("solver %s is not ready: %s", name, reason)
        if database is None:
            log.info("standby: waiting for the end of the dispatcher that writes the database")
            database = open_in_turn(settings.database_url, service)
            if database is None:
                return
            stack.enter_context(database)
            # The active dispatcher on this machine had its port until now.
            api = stack.enter_context(_open_api(settings.api))
        records = database.load_fleet(time.time_ns())
        solve, executor, slots = with_cluster(settings, solvers, pool, own_processes)
        stack.enter_context(executor)
        job_manager = open_job_manager(settings, solve, database)
        if job_manager is not None:
            stack.enter_context(job_manager)
        announce: Announce = announce_nothing if api is None else api.events.publish
        dispatcher = Dispatcher(
            settings,
            network,
            fleet,
            bus,
            database,
            solve,
            executor,
            job_manager,
            fleet_file,
            records,
            announce,
        )
        if database.set_aside is not None:
            dispatcher.health.database_set_aside = database.set_aside.name
        dispatcher.health.solver_fault = lambda: _solver_fault(pool, own_processes, slots)
        bus.subscribe(ALL_STATES, dispatcher.receiver.on_state, history=False)
        dispatcher.fleet_watch.subscribe(bus)
        bus.expect(position_key(one.id) for one in (fleet.vehicles if fleet else ()))
        scheduler = CycleScheduler(
            dispatcher.run_cycle,
            settings.interval_s,
            lambda kind: metrics.CYCLE_FAULTS.labels(kind).inc(),
            min(HEARD_AFTER_S, settings.interval_s) if records.vehicles else 0.0,
        )
        dispatcher.control.run_soon = lambda: (
            dispatcher.cycle_began is None and scheduler.run_soon()
        )
        scheduler.start()
        saver = Gathering("alarms", lambda names: watched.alarms.save(names))
        stack.enter_context(saver)
        watched = AlarmSource(
            dispatcher,
            settings,
            network,
            bus,
            database,
            announce,
            saver.put,
            bus.fault,
            job_manager,
            slots,
        )
        dispatcher.receiver.health_to.append(watched.roadside.on_health)
        if api is not None:
            dispatcher.receiver.health_to.append(dispatcher.feeds.on_health)
        bus.subscribe(ALL_RSU_HEALTH, dispatcher.receiver.on_health, history=False)
        bus.subscribe(ALL_STOPPED, watched.roadside.on_stopped, history=False)
        inserter = stack.enter_context(Gathering("insertion", dispatcher.insert))
        reader = stack.enter_context(open_reader(settings.database_url))
        orders = OrderIntake(
            dispatcher.fleet_watch,
            database,
            reader,
            network,
            announce=lambda change: announce("order", change),
            taken=inserter.put,
        )
        OrderAnswers(orders, dispatcher.control.note).listen(bus)
        service.checks |= _checks(network, dispatcher, scheduler, bus, reader)
        service.vital = ("solvers",)
        if api is not None:
            services = _services(
                settings,
                network,
                dispatcher,
                scheduler,
                reader,
                orders,
                watched,
                api,
                service.checks,
            )
            api.start(services)
            log.info("API on http://127.0.0.1:%d", api.port)
        _collect_garbage_less()
        service.ready()
        try:
            while not service.wait(HEALTH_EVERY_S):
                check_health(dispatcher, scheduler, service)
                watched.update()
        finally:
            # Workers first: a cycle that waits for them must not hold up the end.
            dispatcher.delivery.stopping.set()
            pool.close()
            if api is not None:
                api.close()
            if job_manager is not None:
                job_manager.close()
            executor.shutdown()
            scheduler.stop()
            dispatcher.receiver.store_rollups(database)
            watched.alarms.save()


def with_cluster(
    settings: DispatcherSettings,
    solvers: Sequence[Solver],
    pool: SolverPool,
    executor: WorkerExecutor,
) -> tuple[Solve, Executor, Callable[[], int] | None]:
    """What the settings' cluster solves with these processes behind it, and how many of its
    processes are ready; without one, these, and None.
    """
    if settings.cluster.address is None:
        return pool, executor, None
    from dispatcher_daemon.solvers.cluster import client, fallback

    workers = settings.city.search.workers
    cluster = client.Cluster(settings.cluster, workers, solvers, (search_within,))
    solve = fallback.cluster_solve(cluster, solvers, pool)
    return solve, fallback.ClusterExecutor(cluster, executor, workers), lambda: cluster.slots
