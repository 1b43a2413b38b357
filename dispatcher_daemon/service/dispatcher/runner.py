"""The one way of a cycle: fleet and traffic at a moment in, its plans stored and sent out.

The running dispatcher and simulated ones share it; what differs between them is around it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon import metrics
from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.tracking import HIDDEN, FleetSituation, fleet_of, idle_text
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.cycle import cycle_of, run_cycle
from dispatcher_daemon.planning.plans import plan_energies
from dispatcher_daemon.planning.replay import InputEncoder, TraceRecorder
from dispatcher_daemon.planning.route_form import NO_VEHICLE
from dispatcher_daemon.planning.routes import insert_stops, obstacles
from dispatcher_daemon.service.dispatcher.delivery import PlanDelivery, PlannedCycle
from dispatcher_daemon.service.dispatcher.reports import (
    error_text,
    failed_report,
    idle_report,
    insertion_report,
    waits,
)
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.workers import Solve
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.errors import InputError
from slipstream.messages import CycleReport, SegmentState, Unserved
from slipstream.service import LogLimiter
from storage import CycleInputs

log = logging.getLogger(__name__)

INSERTION_S: Final = 2.0
"""From the begin of an insertion between cycles to the first departure by its plans."""


_MAX_ASKED: Final = 100
"""Stops that are told of each idle vehicle; of more of them, those that are not in the cycle."""


@dataclass(frozen=True)
class CycleOutcome:
    """What became of a cycle.

    Attributes:
        stored: its report as it was stored, before plans were sent; None: it was not.
        abandoned: whether the dispatcher stops, and it was not to be stored.
    """

    planned: PlannedCycle
    error: Exception | None = None
    stored: CycleReport | None = None
    abandoned: bool = False


@dataclass(frozen=True)
class Surroundings:
    """What cycles ask of what is around them.

    Attributes:
        listed: the fleet's list, its times counted from a moment, UTC ns; None: nothing is listed.
        traffic: the roads at a moment, UTC ns, without what was learned.
    """

    listed: Callable[[int], Fleet | None]
    traffic: Callable[[int], TrafficSnapshot]
    problem_of: Callable[[Fleet], RoutingProblem]
    solve: Solve
    executor: Executor | None = None


class CycleRunner:
    """Runs cycles of one fleet, and puts new orders into its tours between them; one at a time.

    Args:
        keep_inputs: whether what a cycle was made from is stored with it.
    """

    def __init__(
        self,
        settings: DispatcherSettings,
        fleet_watch: FleetWatch,
        delivery: PlanDelivery,
        around: Surroundings,
        *,
        reference_delay_s: float | None = None,
        keep_inputs: bool = True,
    ) -> None:
        self._settings, self._watch, self._delivery = settings, fleet_watch, delivery
        self._around, self._delay_s = around, reference_delay_s
        self._reference_s = settings.deadline_s if reference_delay_s is None else reference_delay_s
        self._inputs = InputEncoder() if keep_inputs else None
        self._problem: RoutingProblem | None = None
        self._stops: Mapping[str, tuple[str, ...]] = {}
        self._limiter = LogLimiter()

    def run(self, now_ns: int) -> CycleOutcome:
        """One cycle: traffic and fleet, plans, stored, sent. A fault of planning is reported."""
        number, began = self._delivery.next_number, time.monotonic()
        error: Exception | None = None
        states: tuple[SegmentState, ...] = ()
        try:
            snapshot = self._watch.expected(self._around.traffic(now_ns))
            states = snapshot.states
            planned = self._planned(number, snapshot, began)
        except Exception as fault:
            error, text = fault, error_text(fault)
            if isinstance(fault, InputError):
                text = str(fault)[:500]
                self._limiter.warn(log, "input", f"cycle {number} failed: {fault}")
            else:
                log.exception("cycle %d failed", number)
            report = failed_report(number, now_ns, time.monotonic() - began, text)
            planned = PlannedCycle(report, states)
        if self._delivery.stopping.is_set():
            log.info("cycle %d abandoned: stopping", number)
            return CycleOutcome(planned, error, abandoned=True)
        self._delivery.next_number += 1
        stored = self._delivery.store_and_send(planned, self._reference_s)
        return CycleOutcome(planned, error, stored)

    def _planned(self, number: int, snapshot: TrafficSnapshot, began: float) -> PlannedCycle:
        now_ns = snapshot.now_ns
        situation = self._situation(number, now_ns)
        problem = self._problem_of(situation.fleet)
        if problem is None:
            wall_s = time.monotonic() - began
            kept_back = {**situation.waiting, **situation.later}
            report = idle_report(number, now_ns, wall_s, snapshot, kept_back)
            return PlannedCycle(_with_kept_back(report, situation), snapshot.states)
        cycle = cycle_of(
            problem,
            snapshot,
            self._settings,
            number,
            reference_delay_s=self._delay_s,
            on_road=situation.on_road,
            start=self._stops or None,
            commitments=situation.commitments,
        )
        with TraceRecorder(self._around.solve, self._around.executor) as recorder:
            result = run_cycle(cycle, recorder.solve, recorder.executor, recorder.clock)
        has_work = {*result.energies, *(own.vehicle for own in situation.commitments)}
        is_planned = result.report.status != "failed"
        idle = [v.id for v in problem.fleet.vehicles if is_planned and v.id not in has_work]
        left = {one.stop: one.reason for one in result.report.unserved}
        found = _with_idle(left, situation, problem, snapshot, idle)
        unserved = tuple(Unserved(stop=stop, reason=reason) for stop, reason in found.items())
        report = result.report.model_copy(update={"unserved": unserved})
        if report.reason is None and situation.later and (idle or situation.idle):
            names = idle_text({**dict.fromkeys(idle, "free until then"), **situation.idle})
            report = report.model_copy(update={"reason": f"{waits(situation.later)}{names}"[:500]})
        self._watch.note_unserved({one.stop: one.reason for one in unserved})
        self._stops = result.stops
        return PlannedCycle(
            _with_kept_back(report, situation),
            snapshot.states,
            result.plans,
            problem,
            result.energies,
            self._made_from(number, lambda to: to.encode(cycle, recorder.trace(), result)),
        )

    def insert(self, orders: Collection[str], now_ns: int) -> None:
        """Put new orders into tours that have not begun. Those for which there is none wait for the
        next cycle.
        """
        delivery, watch, began = self._delivery, self._watch, time.monotonic()
        number, fleet = delivery.next_number, watch.fleet
        tours, stops = watch.read(
            lambda tracker: tracker.insertion(fleet, orders, number, now_ns, INSERTION_S)
        )
        if fleet is None or not tours or delivery.stopping.is_set() or delivery.storage_fault:
            return
        snapshot = watch.learned(now_ns).onto(self._around.traffic(now_ns))
        problem = self._around.problem_of(fleet_of(fleet, tours, stops))
        kept = {vehicle.id for vehicle in problem.fleet.vehicles}
        routes = {
            tour.vehicle.id: tuple(stop.id for stop in tour.stops)
            for tour in tours
            if tour.vehicle.id in kept
        }
        wanted = [stop.id for stop in stops]
        cycle = cycle_of(
            problem, snapshot, self._settings, number, reference_delay_s=INSERTION_S, start=routes
        )
        result = insert_stops(cycle, routes, wanted)
        found, missing = result.found, result.missing
        watch.note_unserved(missing)
        if found is None:
            return
        made_from = self._made_from(number, lambda to: to.encode_insertion(cycle, wanted, result))
        wall_s = time.monotonic() - began
        if wall_s > INSERTION_S:
            # Its vehicles would leave in the past.
            late = f"an insertion took {wall_s:.1f} s: it waits for the next cycle"
            watch.note_unserved({stop.id: late for stop in stops} | dict(missing))
            log.warning("orders were not inserted within %g s", INSERTION_S)
            return
        delivery.next_number += 1
        report = insertion_report(number, now_ns, wall_s, snapshot, found, missing)
        energies = plan_energies(problem, found, None)
        planned = PlannedCycle(report, snapshot.states, found.plans, problem, energies, made_from)
        stored = delivery.store_and_send(planned, INSERTION_S)
        if stored is not None:
            watch.read(lambda tracker: tracker.skip_number(number))
            metrics.INSERTION_SECONDS.observe(time.monotonic() - began)
            log.info("orders inserted between cycles: %d plans", stored.plans)

    def _situation(self, number: int, now_ns: int) -> FleetSituation:
        """What the cycle may plan, by the fleet's list as it is now."""
        fleet = self._around.listed(now_ns + round(1e9 * self._reference_s))
        situation = self._watch.situation(fleet, number, now_ns, self._reference_s)
        if situation.hidden:
            some = ", ".join(situation.hidden[:10])
            what = f"{len(situation.hidden)} stops of the fleet's file are not planned"
            line = f"{what}, as callers' orders have their ids: {some}"
            self._limiter.warn(log, "hidden stops", line)
        return situation

    def _problem_of(self, fleet: Fleet | None) -> RoutingProblem | None:
        """The problem of a cycle's fleet; None: nothing to dispatch."""
        if fleet is None:
            return None
        if self._problem is None or fleet is not self._problem.fleet:
            self._problem = self._around.problem_of(fleet)
            self._stops = {}
        return self._problem

    def _made_from(
        self, number: int, encode: Callable[[InputEncoder], CycleInputs]
    ) -> CycleInputs | None:
        """The inputs of a cycle, to be stored with it; a fault here does not cost its plans."""
        try:
            return None if self._inputs is None else encode(self._inputs)
        except Exception as error:
            if self._limiter.allow("inputs"):
                log.exception("the inputs of cycle %d are not stored: %s", number, error)
            return None


def _with_idle(
    unserved: Mapping[str, str],
    situation: FleetSituation,
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    idle: Collection[str],
) -> dict[str, str]:
    """Reasons of stops without a vehicle, each with what keeps every vehicle that has no work.

    Args:
        idle: vehicles of the cycle's fleet that it gave none.
    """
    explained: Mapping[str, Mapping[str, str]] = {}
    asked = [stop for stop, why in unserved.items() if why != NO_VEHICLE][:_MAX_ASKED]
    if idle and asked:
        try:
            explained = obstacles(problem, snapshot, idle, asked)
        except Exception as error:
            # Words are not worth a plan.
            log.exception("why vehicles stand idle is not known: %s", error)
    return {
        stop: situation.nobody
        if why == NO_VEHICLE
        else why + idle_text({**explained.get(stop, {}), **situation.idle})
        for stop, why in unserved.items()
    }


def _with_kept_back(report: CycleReport, situation: FleetSituation) -> CycleReport:
    """A report with the stops that its cycle was not given."""
    kept_back = [*((stop, HIDDEN) for stop in situation.hidden), *situation.waiting.items()]
    others = tuple(Unserved(stop=stop, reason=reason) for stop, reason in kept_back)
    return report.model_copy(update={"unserved": (*others, *report.unserved)})
