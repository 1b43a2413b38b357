"""New orders between cycles: put into tours that have not begun."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Sequence
from typing import Final

from dispatcher_daemon import metrics
from dispatcher_daemon.fleet.tracking import fleet_of
from dispatcher_daemon.forms import routing_problem
from dispatcher_daemon.planning.cycle import cycle_seed
from dispatcher_daemon.planning.plans import Cycle, plan_energies
from dispatcher_daemon.planning.replay import InputEncoder
from dispatcher_daemon.planning.routes import Insertion, insert_stops
from dispatcher_daemon.service.dispatcher.delivery import PlanDelivery
from dispatcher_daemon.service.dispatcher.receiver import StateReceiver
from dispatcher_daemon.service.dispatcher.reports import insertion_report
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.roads import RoadNetwork
from slipstream.service import LogLimiter
from storage import CycleInputs

log = logging.getLogger(__name__)

INSERTION_S: Final = 2.0
"""From the begin of an insertion between cycles to the first departure by its plans."""


class OrderInsertion:
    """Puts orders into plans between cycles; never while a cycle runs.

    Args:
        settings: of the dispatcher.
        network: roads.
        fleet_watch: the tracked fleet.
        receiver: of segment states.
        delivery: stores and sends plans.
        inputs: encodes what an insertion was made from, to be stored with it.
    """

    def __init__(
        self,
        settings: DispatcherSettings,
        network: RoadNetwork,
        fleet_watch: FleetWatch,
        receiver: StateReceiver,
        delivery: PlanDelivery,
        inputs: InputEncoder,
    ) -> None:
        self._settings, self._network = settings, network
        self._fleet_watch, self._receiver = fleet_watch, receiver
        self._delivery, self._inputs = delivery, inputs
        self._limiter = LogLimiter()

    def insert(self, orders: Collection[str]) -> None:
        """Put new orders into tours that have not begun. Those for which there is none wait for the
        next cycle.
        """
        delivery, watch = self._delivery, self._fleet_watch
        number, began, now_ns = delivery.next_number, time.monotonic(), time.time_ns()
        fleet = watch.fleet
        tours, stops = watch.insertion(orders, number, now_ns, INSERTION_S)
        if fleet is None or not tours or delivery.stopping.is_set() or delivery.storage_fault:
            return
        snapshot = self._receiver.snapshot(now_ns)
        snapshot = watch.learned(now_ns).onto(snapshot)
        joined = fleet_of(fleet, tours, stops)
        kept = {vehicle.id for vehicle in joined.vehicles}
        routes = {
            tour.vehicle.id: tuple(stop.id for stop in tour.stops)
            for tour in tours
            if tour.vehicle.id in kept
        }
        wanted = [stop.id for stop in stops]
        cycle = Cycle(
            routing_problem(self._network, joined, self._settings),
            snapshot,
            self._settings,
            number,
            now_ns,
            cycle_seed(self._settings.seed, number),
            reference_delay_s=INSERTION_S,
            start=routes,
        )
        result = insert_stops(cycle, routes, wanted)
        found, missing = result.found, result.missing
        watch.note_unserved(missing)
        if found is None:
            return
        made_from = self._made_from(cycle, wanted, result)
        wall_s = time.monotonic() - began
        if wall_s > INSERTION_S:
            # Its vehicles would leave in the past.
            late = f"an insertion took {wall_s:.1f} s: it waits for the next cycle"
            watch.note_unserved({stop.id: late for stop in stops} | dict(missing))
            log.warning("orders were not inserted within %g s", INSERTION_S)
            return
        delivery.next_number += 1
        report = insertion_report(number, now_ns, wall_s, snapshot, found, missing)
        stored = delivery.store_and_send(
            report,
            found.plans,
            snapshot.states,
            joined.stop_by_id,
            INSERTION_S,
            plan_energies(cycle.problem, found, None),
            made_from,
        )
        if stored is not None:
            watch.skip_number(number)
            metrics.INSERTION_SECONDS.observe(time.monotonic() - began)
            log.info("orders inserted between cycles: %d plans", stored.plans)

    def _made_from(
        self, cycle: Cycle, wanted: Sequence[str], result: Insertion
    ) -> CycleInputs | None:
        """The inputs of an insertion; a fault here does not cost its plans."""
        try:
            return self._inputs.encode_insertion(cycle, wanted, result)
        except Exception as error:
            if self._limiter.allow("inputs"):
                log.exception("the inputs of cycle %d are not stored: %s", cycle.number, error)
            return None
