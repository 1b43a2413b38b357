"""The dispatcher as a service: states in, cycles on time, plans out once they are stored."""

from __future__ import annotations

import gc
import logging
import threading
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Literal, Protocol

from dispatcher_daemon import metrics
from dispatcher_daemon.cycle import CycleResult, cycle_seed, form_of, run_cycle
from dispatcher_daemon.feeds.publisher import Feeds
from dispatcher_daemon.fleet import Fleet, Stop
from dispatcher_daemon.fleet_file import FleetFile
from dispatcher_daemon.fleet_watch import FleetWatch
from dispatcher_daemon.hardware import JobManager, open_job_manager
from dispatcher_daemon.intake import OrderAnswers, OrderIntake
from dispatcher_daemon.on_demand import Gathering
from dispatcher_daemon.planning import insert_stops, search_within
from dispatcher_daemon.plans import Cycle
from dispatcher_daemon.problem import RoutingProblem, routing_problem
from dispatcher_daemon.replay import InputEncoder, Recorder
from dispatcher_daemon.reports import (
    error_text,
    failed_report,
    idle_report,
    insertion_report,
    worst_receptions,
)
from dispatcher_daemon.schedule import CycleScheduler
from dispatcher_daemon.settings import ApiSettings, DispatcherSettings
from dispatcher_daemon.solvers.execution.pool import Solve, SolverPool
from dispatcher_daemon.solvers.execution.processes import WorkerExecutor
from dispatcher_daemon.solvers.protocol import Solver
from dispatcher_daemon.solvers.registry import configured_solvers
from dispatcher_daemon.states import HARMLESS, LatestStates, Verdict
from dispatcher_daemon.store import (
    CyclePruner,
    CycleStore,
    database_fault,
    open_checked_database,
    open_in_turn,
)
from dispatcher_daemon.tracking import fleet_of
from dispatcher_daemon.traffic import TrafficSnapshot, take_snapshot
from slipstream.admission import check_rsus, implausibility
from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.freshness import age_s
from slipstream.inbox import lost
from slipstream.messages import (
    ALL_RSU_HEALTH,
    ALL_STATES,
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    CycleReport,
    DispatcherHealth,
    Message,
    SegmentState,
    VehiclePlan,
    decode,
    plan_key,
    state_key,
)
from slipstream.orders import FleetRecords, OrderChange
from slipstream.roads import RoadNetwork
from slipstream.service import LogLimiter, Service, configure_logging, rss_mb
from slipstream.sumo_net import load_network
from slipstream.tracing import is_on, note, span, sparse_span, traced
from storage import (
    CycleInputs,
    Database,
    OwnedError,
    Reader,
    RollUpBuffer,
    StorageError,
    open_reader,
)

if TYPE_CHECKING:
    from dispatcher_daemon.api import ApiServer, Services

log = logging.getLogger(__name__)

HEALTH_EVERY_S = 1.0
INSERTION_S = 2.0
"""From the begin of an insertion between cycles to the first departure by its plans."""
_NAMED_STATES = 1000
"""States that a trace names."""
HEARD_AFTER_S = 2.5
"""By then vehicles that the run before knew have said where they are: they do so each second."""


class MessagePublisher(Protocol):
    """A declared publisher: the part of `slipstream.bus.Publisher` that is used here."""

    def put(self, message: Message | bytes) -> None:
        """Publish."""
        ...


class MessageBus(Protocol):
    """The part of `slipstream.bus.Bus` that is used here."""

    def publisher(self, key: str) -> MessagePublisher:
        """Declare a publisher."""
        ...


class Announce(Protocol):
    """Tells callers of the API what has happened."""

    def __call__(
        self,
        kind: Literal["plan", "state", "cycle", "order"],
        value: Message | OrderChange,
        /,
    ) -> None:
        """Tell."""
        ...


def _announce_nothing(kind: str, value: Message | OrderChange, /) -> None:
    """Without an API nobody listens."""


class Dispatcher:
    """The running dispatcher. The bus's thread delivers states, the scheduler's runs cycles.

    Args:
        settings: checked settings.
        network: roads.
        fleet: what is dispatched; None: nothing until `fleet_file` has a fleet.
        bus: to publish through.
        store: database.
        solve: solver pool.
        executor: for the search of the route form's base routes; None: the cycle's own thread.
        job_manager: of a quantum device, which then solves in place of the pool.
        fleet_file: the fleet of each cycle is read from it; None: it is always `fleet`.
        records: orders, plans and vehicles of the run before.
        announce: told of accepted states, and of what was stored; it does not wait.

    Attributes:
        replaced: another dispatcher writes the database by now; None: none does.
    """

    def __init__(
        self,
        settings: DispatcherSettings,
        network: RoadNetwork,
        fleet: Fleet | None,
        bus: MessageBus,
        store: CycleStore,
        solve: Solve,
        executor: Executor | None = None,
        job_manager: JobManager | None = None,
        fleet_file: FleetFile | None = None,
        records: FleetRecords | None = None,
        announce: Announce = _announce_nothing,
    ) -> None:
        self._announce = announce
        self._executor = executor
        self._job_manager = job_manager
        self._stops: Mapping[str, tuple[str, ...]] = {}
        self._settings = settings
        self._network = network
        self._problem: RoutingProblem | None = None
        self._fleet, self._fleet_file = fleet, fleet_file
        self._bus = bus
        self._store = store
        self._solve = solve if job_manager is None else job_manager
        self.latest_states = LatestStates(
            network,
            rsus=settings.rsus,
            stale_after_s=settings.stale_after_s,
            future_tolerance_s=settings.future_tolerance_s,
        )
        self.feeds = Feeds(network, settings, self.latest_states.latest, self._refuse)
        metrics.RECEPTION.figures = self.latest_states.reception.figures
        self._limiter = LogLimiter()
        vehicles = () if fleet is None else fleet.vehicles
        self._plan_publishers = {v.id: bus.publisher(plan_key(v.id)) for v in vehicles}
        self._cycle_publisher = bus.publisher(CYCLE_KEY)
        self._health_publisher = bus.publisher(DISPATCHER_HEALTH_KEY)
        self._cycle = store.next_cycle_number()
        self._inputs = InputEncoder()
        self._pruner = CyclePruner(store, settings.keep_days, settings.keep_mb)
        self._rollups = RollUpBuffer()
        self.database_set_aside: str | None = None
        self._storage_fault = False
        self.replaced: OwnedError | None = None
        self.stopping = threading.Event()
        self._turn = threading.Lock()
        self.cycle_began: float | None = None
        self.started_ns = time.time_ns()
        self.fleet_watch = FleetWatch(
            network,
            records or FleetRecords(),
            self.started_ns,
            time.time_ns,
            self._refuse,
            settings.orders.plan_ahead_s,
        )
        self.fleet_watch.fleet = fleet
        self.cycles = 0
        self.cycles_failed = 0
        self.states_received = 0
        self.bad_messages = 0
        self.states_refused = 0

    def on_state(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_STATES`; what is not a SegmentState is counted."""
        try:
            state = decode(SegmentState, payload, key)
            if state_key(state.rsu, state.segment) != key:
                raise InputError(key, "not the RSU or segment of its key", "check the sender")
        except InputError as error:
            self._refuse(error)
            return
        self.states_received += 1
        now_ns = time.time_ns()
        with sparse_span("receive", rsu=state.rsu, segment=state.segment, sequence=state.sequence):
            verdict = self.latest_states.accept(state, now_ns)
        metrics.STATES.labels(verdict.value).inc()
        if verdict is Verdict.ACCEPTED:
            metrics.STATE_AGE.observe(max(0.0, age_s(state.time_ns, now_ns)))
            self._announce("state", state)
            self._rollups.add(state)
        if verdict not in HARMLESS:
            self.states_refused += 1
            what = verdict.value.replace("_", " ")
            if verdict is Verdict.IMPLAUSIBLE:
                what += f", {implausibility(state, self._network.segments[state.segment])}"
            self._warn(verdict.value, f"{key}: state refused: {what}")

    def _refuse(self, error: InputError) -> None:
        """Count a message that is not what its key promises."""
        self.bad_messages += 1
        metrics.BAD_MESSAGES.inc()
        self._warn("bad message", str(error))

    def run_cycle(self) -> None:
        """One cycle: snapshot, solve, store, publish. Errors end the cycle, not the dispatcher."""
        with self._turn:
            self._run_one_cycle()

    def _run_one_cycle(self) -> None:
        self.cycle_began = time.monotonic()
        try:
            with span("cycle", cycle=self._cycle):
                self._run_cycle()
        except Exception as error:
            self.cycles_failed += 1
            metrics.CYCLES.labels("lost").inc()
            if self._limiter.allow("lost"):
                log.exception("cycle %d is lost: %s", self._cycle - 1, error)
        finally:
            self.cycle_began = None
        if self._storage_fault:
            # After the cycle, as the check of a large database takes longer than one may.
            self._recover_storage()

    def _run_cycle(self) -> None:
        number, began, now_ns = self._cycle, time.monotonic(), time.time_ns()
        plans: tuple[VehiclePlan, ...] = ()
        states: tuple[SegmentState, ...] = ()
        problem: RoutingProblem | None = None
        made_from: CycleInputs | None = None
        reference_s = self._settings.deadline_s
        if self._job_manager is not None:
            self._job_manager.begin_cycle(number)
        try:
            snapshot = self.fleet_watch.expected(self._snapshot(now_ns))
            states = snapshot.states
            metrics.GATES_OPEN.set(sum(gate.open for gate in snapshot.gates()))
            situation = self.fleet_watch.situation(
                self._fleet if self._fleet_file is None else self._fleet_file.current(),
                number,
                now_ns,
                reference_s,
            )
            if situation.hidden:
                some = ", ".join(situation.hidden[:10])
                what = f"{len(situation.hidden)} stops of the fleet's file are not planned"
                self._warn("hidden stops", f"{what}, as callers' orders have their ids: {some}")
            problem = self._problem_of(situation.fleet)
            if problem is None:
                report = idle_report(number, now_ns, time.monotonic() - began, snapshot)
            else:
                seed = cycle_seed(self._settings.seed, number)
                cycle = Cycle(
                    problem,
                    snapshot,
                    self._settings,
                    number,
                    now_ns,
                    seed,
                    start=self._stops or None,
                    commitments=situation.commitments,
                    on_road=situation.on_road,
                )
                with Recorder(self._solve, self._executor) as recorder:
                    result = run_cycle(cycle, recorder.solve, recorder.executor, recorder.clock)
                self.fleet_watch.note_unserved({u.stop: u.reason for u in result.report.unserved})
                report, plans = result.report, result.plans
                self._stops = result.stops
                made_from = self._made_from(cycle, recorder, result)
        except InputError as error:
            self._warn("input", f"cycle {number} failed: {error}")
            report = failed_report(number, now_ns, time.monotonic() - began, str(error)[:500])
        except Exception as error:
            log.exception("cycle %d failed", number)
            report = failed_report(number, now_ns, time.monotonic() - began, error_text(error))
        if self.stopping.is_set():
            log.info("cycle %d abandoned: stopping", number)
            return
        self._cycle += 1
        stops = {} if problem is None else problem.fleet.stop_by_id
        stored = self._store_and_send(report, plans, states, stops, reference_s, made_from)
        # Also after a cycle that could not be stored, which bounds what waits.
        self.store_rollups(now_ns)
        if stored is not None:
            self._count(stored)
            self._pruner.after_cycle(now_ns)

    @traced("snapshot")
    def _snapshot(self, now_ns: int) -> TrafficSnapshot:
        snapshot = take_snapshot(
            self._network,
            self.latest_states.latest(),
            now_ns,
            stale_after_s=self._settings.stale_after_s,
            future_tolerance_s=self._settings.future_tolerance_s,
            stops_at_signals=self._settings.stops_at_signals,
        )
        if is_on():
            # What the spans of the edge that published them are found by.
            named = [f"{s.rsu} {s.segment} {s.sequence}" for s in snapshot.states[:_NAMED_STATES]]
            note(states=named)
        return snapshot

    def insert(self, orders: Collection[str]) -> None:
        """Put new orders into tours that have not begun, as soon as no cycle runs. Those for which
        there is none wait for the next cycle.
        """
        with self._turn:
            number, began, now_ns = self._cycle, time.monotonic(), time.time_ns()
            fleet = self.fleet_watch.fleet
            tours, stops = self.fleet_watch.insertion(orders, number, now_ns, INSERTION_S)
            if fleet is None or not tours or self.stopping.is_set() or self._storage_fault:
                return
            snapshot = self._snapshot(now_ns)
            snapshot = self.fleet_watch.learned(now_ns).onto(snapshot)
            joined = fleet_of(fleet, tours, stops)
            cycle = Cycle(
                routing_problem(self._network, joined, self._settings),
                snapshot,
                self._settings,
                number,
                now_ns,
                cycle_seed(self._settings.seed, number),
                reference_delay_s=INSERTION_S,
            )
            routes = {tour.vehicle.id: [stop.id for stop in tour.stops] for tour in tours}
            found, missing = insert_stops(cycle, routes, [stop.id for stop in stops])
            self.fleet_watch.note_unserved(missing)
            if found is None:
                return
            wall_s = time.monotonic() - began
            if wall_s > INSERTION_S:
                # Its vehicles would leave in the past.
                late = f"an insertion took {wall_s:.1f} s: it waits for the next cycle"
                self.fleet_watch.note_unserved({stop.id: late for stop in stops} | dict(missing))
                log.warning("orders were not inserted within %g s", INSERTION_S)
                return
            self._cycle += 1
            report = insertion_report(number, now_ns, wall_s, snapshot, found, missing)
            stored = self._store_and_send(
                report, found.plans, snapshot.states, joined.stop_by_id, INSERTION_S
            )
            if stored is not None:
                self.fleet_watch.skip_number(number)
                metrics.INSERTION_SECONDS.observe(time.monotonic() - began)
                log.info("orders inserted between cycles: %d plans", stored.plans)

    def _store_and_send(
        self,
        report: CycleReport,
        plans: tuple[VehiclePlan, ...],
        states: tuple[SegmentState, ...],
        stops: Mapping[str, Stop],
        reference_s: float,
        made_from: CycleInputs | None = None,
    ) -> CycleReport | None:
        """Store plans with their report, then send them; None: they could not be stored."""

        def save(admitted: tuple[VehiclePlan, ...], records: FleetRecords) -> None:
            told = report.model_copy(update={"plans": len(admitted)})
            self._store.record_cycle(told, admitted, states, records, made_from)
            # Under the fleet's lock, so that nobody is told of a later change before.
            for change in records.changes:
                self._announce("order", change)

        try:
            reference_ns = report.started_ns + round(1e9 * reference_s)
            plans = self.fleet_watch.store(plans, stops, reference_ns, save)
        except Exception as error:
            self._report_storage_fault(report, error)
            return None
        report = report.model_copy(update={"plans": len(plans)})
        note(status=report.status, plans=len(plans))
        self._send(report, plans)
        return report

    @traced("publish")
    def _send(self, report: CycleReport, plans: tuple[VehiclePlan, ...]) -> None:
        for plan in plans:
            self._publisher_of(plan.vehicle).put(plan)
        self._cycle_publisher.put(report)
        for plan in plans:
            self._announce("plan", plan)
        self._announce("cycle", report)

    def _made_from(
        self, cycle: Cycle, recorder: Recorder, result: CycleResult
    ) -> CycleInputs | None:
        """The inputs of a cycle, to be stored with it; a fault here does not cost its plans."""
        try:
            return self._inputs.encode(cycle, recorder.trace(), result)
        except Exception as error:
            if self._limiter.allow("inputs"):
                log.exception("the inputs of cycle %d are not stored: %s", cycle.number, error)
            return None

    def store_rollups(self, now_ns: int | None = None) -> None:
        """Store what was reported in the minutes that have ended; None: in those begun, too.

        Plans do not wait for it, and what cannot be stored is tried again after the next cycle.
        """
        minutes = self._rollups.take(now_ns)
        if not minutes:
            return
        try:
            self._store.add_rollups(minutes)
        except Exception as error:
            dropped = self._rollups.give_back(minutes)
            more = f", {dropped} of them are dropped" if dropped else ""
            self._warn("rollups", f"{len(minutes)} roll-ups could not be stored{more}: {error}")

    def _problem_of(self, fleet: Fleet | None) -> RoutingProblem | None:
        """The problem of a cycle's fleet; None: nothing to dispatch."""
        if fleet is None:
            return None
        if self._problem is None or fleet is not self._problem.fleet:
            self._problem = routing_problem(self._network, fleet, self._settings)
            self._stops = {}
        return self._problem

    def _publisher_of(self, vehicle: str) -> MessagePublisher:
        if vehicle not in self._plan_publishers:
            self._plan_publishers[vehicle] = self._bus.publisher(plan_key(vehicle))
        return self._plan_publishers[vehicle]

    def _report_storage_fault(self, report: CycleReport, error: Exception) -> None:
        """Publish a failed report for a cycle that could not be stored; its plans are not sent."""
        reason = f"not stored, so no plan was sent: {error_text(error)}"
        self._warn("storage", f"cycle {report.cycle} {reason}")
        self._storage_fault = True
        self.cycles_failed += 1
        metrics.CYCLES.labels("lost").inc()
        self._cycle_publisher.put(
            failed_report(report.cycle, report.started_ns, report.wall_s, reason)
        )

    def _recover_storage(self) -> None:
        """Open the database anew if it was replaced; numbers go on above all stored ones."""
        try:
            self._cycle = max(self._cycle, self._store.next_cycle_number())
            self._storage_fault = False
            self.fleet_watch.store_all()
        except OwnedError as error:
            # Its orders and plans would be overwritten by what was known before.
            self.replaced = error
            self.stopping.set()
        except Exception as error:
            self._warn("recovery", f"the database cannot be used yet: {error}")

    def _count(self, report: CycleReport) -> None:
        self.cycles += 1
        self.cycles_failed += report.status == "failed"
        metrics.CYCLES.labels(report.status).inc()
        metrics.CYCLE_SECONDS.observe(report.wall_s)
        metrics.PLANS.inc(report.plans)
        metrics.LAST_CYCLE.set(report.started_ns * 1e-9)
        for solver in report.solvers:
            metrics.SOLVER_RUNS.labels(solver.solver, solver.status).inc()
            metrics.SOLVER_SECONDS.labels(solver.solver).observe(solver.wall_s)
        saved = "no energy figures"
        if report.energy is not None:
            energy = report.energy
            metrics.SAVED_KWH.labels("distance").set(energy.saved_distance_kwh)
            metrics.SAVED_KWH.labels("drag").set(energy.saved_drag_kwh)
            metrics.SAVED_KWH.labels("acceleration").set(energy.saved_acceleration_kwh)
            saved = f"{energy.cooperative_kwh:.3f} kWh against {energy.baseline_kwh:.3f}"
        log.info(
            "cycle %d %s: %d plans by %s, %s, %.2f s%s",
            report.cycle,
            report.status,
            report.plans,
            report.solver,
            saved,
            report.wall_s,
            f" ({report.reason})" if report.reason else "",
        )

    def publish_health(self, next_cycle_ns: int | None) -> None:
        """Publish a DispatcherHealth; errors are logged and do not stop the dispatcher."""
        try:
            self._publish_health(next_cycle_ns)
        except Exception as error:
            if self._limiter.allow("health"):
                log.exception("the health could not be published: %s", error)

    def _publish_health(self, next_cycle_ns: int | None) -> None:
        reporting, silent, orders = self.fleet_watch.figures()
        self._health_publisher.put(
            DispatcherHealth(
                time_ns=time.time_ns(),
                started_ns=self.started_ns,
                cycles=self.cycles,
                cycles_failed=self.cycles_failed,
                states_received=self.states_received,
                bad_messages=self.bad_messages,
                states_refused=self.states_refused,
                messages_lost=lost(),
                rsus=worst_receptions(self.latest_states.reception.figures()),
                next_cycle_ns=next_cycle_ns,
                rss_mb=rss_mb(),
                hardware=None if self._job_manager is None else self._job_manager.health(),
                stale_after_s=self._settings.stale_after_s,
                future_tolerance_s=self._settings.future_tolerance_s,
                vehicles_reporting=reporting,
                vehicles_silent=silent,
                orders=orders,
                database_set_aside=self.database_set_aside,
            )
        )

    def is_live(self, next_cycle_ns: int | None) -> bool:
        """False if a cycle hangs or none is scheduled; the condition for feeding the watchdog."""
        began, settings = self.cycle_began, self._settings
        if began is not None:
            return time.monotonic() - began < settings.deadline_s + 60.0
        if next_cycle_ns is None:
            return False
        return abs(time.time_ns() - next_cycle_ns) < 2e9 * settings.interval_s

    def _warn(self, kind: str, line: str) -> None:
        if self._limiter.allow(kind):
            suppressed = self._limiter.suppressed(kind)
            more = f" ({suppressed} more of this kind)" if suppressed else ""
            log.warning("%s%s", line, more)


def check_health(dispatcher: Dispatcher, scheduler: CycleScheduler, service: Service) -> None:
    """The periodic work: follow the clock, publish the health, feed the watchdog.

    Raises:
        StorageError: another dispatcher writes the database. No InputError: systemd then starts
            this one again, which may wait as a standby.
    """
    if dispatcher.replaced is not None:
        line = f"{dispatcher.replaced.source}: another dispatcher has taken over; this one ends"
        raise StorageError(line)
    scheduler.follow_clock()
    next_cycle_ns = scheduler.next_run_ns
    dispatcher.publish_health(next_cycle_ns)
    if dispatcher.is_live(next_cycle_ns):
        service.progress(f"{dispatcher.cycles} cycles")


@contextmanager
def _open_api(settings: ApiSettings) -> Iterator[ApiServer | None]:
    """The API's server, which does not serve yet; None: the settings want none."""
    if settings.port == 0:
        yield None
        return
    # The web framework takes half a second to import.
    from dispatcher_daemon.api import ApiServer

    with ApiServer(settings.port, settings.tokens) as server:
        yield server


def _services(
    settings: DispatcherSettings,
    network: RoadNetwork,
    dispatcher: Dispatcher,
    scheduler: CycleScheduler,
    bus: Bus,
    reader: Reader,
    orders: OrderIntake,
    api: ApiServer,
) -> Services:
    from dispatcher_daemon.api import Services

    def has_cycle() -> bool:
        return dispatcher.cycles > 0 or scheduler.next_run_ns is not None

    return Services(
        settings=settings,
        network=network,
        fleet=dispatcher.fleet_watch,
        states=dispatcher.latest_states,
        orders=orders,
        feeds=dispatcher.feeds,
        reader=reader,
        events=api.events,
        solve_jobs=api.solve_jobs,
        is_live=lambda: dispatcher.is_live(scheduler.next_run_ns),
        checks={
            "database": lambda: database_fault(reader),
            "bus": lambda: None if bus.is_connected else "no router answers",
            "network": lambda: None if network.segments else "it has no segment",
            "cycle": lambda: None if has_cycle() else "none has run, and none is scheduled",
        },
    )


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
        solve, executor = with_cluster(settings, solvers, pool, own_processes)
        stack.enter_context(executor)
        job_manager = open_job_manager(settings, solve, database)
        if job_manager is not None:
            stack.enter_context(job_manager)
        announce: Announce = _announce_nothing if api is None else api.events.publish
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
            dispatcher.database_set_aside = database.set_aside.name
        bus.subscribe(ALL_STATES, dispatcher.on_state, history=False)
        dispatcher.fleet_watch.subscribe(bus)
        scheduler = CycleScheduler(
            dispatcher.run_cycle,
            settings.interval_s,
            lambda kind: metrics.CYCLE_FAULTS.labels(kind).inc(),
            min(HEARD_AFTER_S, settings.interval_s) if records.vehicles else 0.0,
        )
        scheduler.start()
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
        OrderAnswers(orders).listen(bus)
        if api is not None:
            bus.subscribe(ALL_RSU_HEALTH, dispatcher.feeds.on_health, history=False)
            services = _services(settings, network, dispatcher, scheduler, bus, reader, orders, api)
            api.start(services)
            log.info("API on http://127.0.0.1:%d", api.port)
        _collect_garbage_less()
        service.ready()
        try:
            while not service.wait(HEALTH_EVERY_S):
                check_health(dispatcher, scheduler, service)
        finally:
            # Workers first: a cycle that waits for them must not hold up the end.
            dispatcher.stopping.set()
            pool.close()
            if api is not None:
                api.close()
            if job_manager is not None:
                job_manager.close()
            executor.shutdown()
            scheduler.stop()
            dispatcher.store_rollups()


def with_cluster(
    settings: DispatcherSettings,
    solvers: Sequence[Solver],
    pool: SolverPool,
    executor: WorkerExecutor,
) -> tuple[Solve, Executor]:
    """What the settings' cluster solves with these processes behind it; without one, these."""
    if settings.cluster.address is None:
        return pool, executor
    from dispatcher_daemon.solvers.execution.cluster import client, fallback

    workers = settings.city.search.workers
    cluster = client.Cluster(settings.cluster, workers, solvers, (search_within,))
    solve = fallback.cluster_solve(cluster, solvers, pool)
    return solve, fallback.ClusterExecutor(cluster, executor, workers)
