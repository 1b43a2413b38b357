"""Dispatch cycles of a running simulation: orders and the fleet's messages in, plans out."""

from __future__ import annotations

from collections.abc import Callable, Collection
from concurrent.futures import Executor
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.learning import HOUR_NS, History, Learned, Learning
from dispatcher_daemon.fleet.tracking import bundled_until_ns
from dispatcher_daemon.forms import RoutingProblem, routing_problem
from dispatcher_daemon.service.dispatcher import CycleRunner, FleetWatch, PlanDelivery, Surroundings
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import TrafficSnapshot, take_snapshot
from slipstream.errors import InputError
from slipstream.messages import (
    Message,
    PlanAcknowledgement,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
)
from slipstream.orders import FleetRecords
from slipstream.prices import PriceSettings
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.closed_loop.dispatch_settings import (
    DEFAULT_TIME_WORTH_KW,
    advice_of,
    evaluation_settings,
    evaluation_solve,
    installed_settings,
)
from slipstream_lab.simulation.closed_loop.gates import WINDOW_S, SimulatedRoadside
from slipstream_lab.simulation.closed_loop.history_file import time_worth_kw
from slipstream_lab.simulation.closed_loop.planned_platoons import PlannedPlatoons
from slipstream_lab.simulation.closed_loop.policy import AS_DRIVING, Policy, WaitingPrices
from slipstream_lab.simulation.closed_loop.record import LoopCycleRecord
from slipstream_lab.simulation.scenarios.demand import Deliveries, fleet_at
from storage import Database, StorageError


class Dispatching:
    """The real dispatcher's cycles and fleet, in this process and by the simulation's clock.

    Args:
        history: what movements cost on another day; for the lever "routes" alone.
        database: takes cycles, plans and the energy ledger; None: they are not stored.
    """

    def __init__(
        self,
        deliveries: Deliveries,
        network: RoadNetwork,
        policy: Policy,
        seed: int,
        executor: Executor,
        send: Callable[[VehiclePlan], None],
        roadside: SimulatedRoadside,
        history: History | None = None,
        database: Database | None = None,
        prices: WaitingPrices = AS_DRIVING,
    ) -> None:
        self._deliveries, self._network, self._roadside = deliveries, network, roadside
        self._policy = policy
        history = history if "routes" in policy.levers else None
        if policy.installed:
            settings = installed_settings(policy, seed)
            self.interval_s, delay_s = settings.interval_s, DispatcherSettings().deadline_s
            learning = None
        else:
            kind = deliveries.settings.vehicle_type
            worth_kw = 0.0 if history is None else time_worth_kw(history, network, kind)
            settings = settings_of(policy, worth_kw, prices, seed)
            self.interval_s, delay_s = deliveries.settings.cycle_s, 0.0
            learning = _AnotherDay(history, network)
        self._settings = settings
        self._now_ns = 0
        self._over: Collection[str] = ()
        self._sent = _Sent(send)
        self._watch = FleetWatch(
            network,
            FleetRecords(),
            0,
            lambda: self._now_ns,
            _refuse,
            settings.orders.plan_ahead_s,
            learning=learning,
        )
        self._delivery = PlanDelivery(self._sent, _Store(database), self._watch)
        self._runner = CycleRunner(
            settings,
            self._watch,
            self._delivery,
            Surroundings(
                self._listed,
                self.snapshot,
                self._problem,
                evaluation_solve(settings),
                executor,
            ),
            reference_delay_s=delay_s,
            # Its problem is the policy's, which settings do not say all of.
            keep_inputs=False,
        )
        self.cycles: list[LoopCycleRecord] = []

    def receive(self, message: Message) -> None:
        """Take in what a vehicle sends to the dispatcher."""
        if isinstance(message, VehiclePosition | PlanAcknowledgement | VehicleProgress):
            self._now_ns = message.time_ns
            self._watch.take(message, message.vehicle)

    def cycle(self, now_s: float, over: Collection[str]) -> None:
        """Plan the released orders and the vehicles from where they are; the plans go out."""
        self._now_ns, self._over = round(now_s * 1e9), over
        platoons, roadside = self._sent.platoons, self._roadside
        planned_m, saved_kwh = platoons.planned_m, platoons.saved_kwh
        self._sent.begun.clear()
        outcome = self._runner.run(self._now_ns)
        if outcome.error is not None:
            raise outcome.error
        self._check_stored()
        if outcome.planned.problem is None:
            return
        open_, judged, turbulent = roadside.open, roadside.judged, roadside.is_turbulent
        self.cycles.append(
            LoopCycleRecord(
                time_s=now_s,
                status=outcome.planned.report.status,
                vehicles=len(self._sent.begun),
                planned_kwh=sum(plan.energy_kwh for plan in self._sent.begun),
                planned_platooned_m=platoons.planned_m - planned_m,
                planned_drafting_kwh=platoons.saved_kwh - saved_kwh,
                open=len(open_ & judged),
                judged=len(judged),
                watched=len(roadside.watched),
                open_turbulent=sum(turbulent(segment) for segment in open_),
            )
        )

    def close(self, now_s: float) -> None:
        """Store what was driven since the last cycle."""
        self._now_ns = round(now_s * 1e9)
        self._delivery.store_fleet(self._now_ns)
        self._check_stored()

    def _check_stored(self) -> None:
        if self._delivery.unstored is not None:
            raise StorageError(self._delivery.unstored)

    def _listed(self, now_ns: int) -> Fleet | None:
        now_s = now_ns / 1e9
        everybody = dict.fromkeys(self._deliveries.vehicles, now_s)
        # Times count from when vehicles may leave; what is ordered until then is not known yet.
        bundle_s = self._settings.orders.bundle_s
        to_come = [
            one.id
            for one in self._deliveries.orders
            if bundled_until_ns(round(1e9 * one.release_s), round(1e9 * one.latest_s), bundle_s)
            > self._now_ns
        ]
        return fleet_at(self._deliveries, now_s, everybody, {*self._over, *to_come})

    def snapshot(self, now_ns: int) -> TrafficSnapshot:
        """The traffic as the dispatcher knows it; all gates closed where it may not platoon."""
        snapshot = take_snapshot(
            self._network, self._roadside.states, now_ns, stale_after_s=1.5 * WINDOW_S
        )
        if "platoons" not in self._policy.levers:
            return with_gates(snapshot, frozenset())
        return (
            snapshot if self._policy.gating == "rsu" else with_gates(snapshot, self._roadside.open)
        )

    def _problem(self, fleet: Fleet) -> RoutingProblem:
        problem = routing_problem(self._network, fleet, self._settings)
        return replace(problem, search=self._policy.search)


class _AnotherDay(Learning):
    """What movements cost on another day, if it is known; nothing is learned on this one."""

    def __init__(self, history: History | None, network: RoadNetwork) -> None:
        super().__init__(network, FleetRecords())
        self._history, self._network = history, network
        self._of_hour: tuple[int, Learned] = -1, Learned()

    def on_position(self, position: VehiclePosition) -> None:
        """It teaches nothing."""

    def on_traffic(self, snapshot: TrafficSnapshot) -> None:
        """It teaches nothing."""

    def learned(self, now_ns: int) -> Learned:
        """Of the hour."""
        hour = now_ns // HOUR_NS
        if self._history is not None and self._of_hour[0] != hour:
            expected = self._history.expectations(self._network, hour)
            self._of_hour = hour, Learned(expected=expected)
        return self._of_hour[1]


class _Sent:
    """A bus whose plans are vehicles' at once, which counts their platoons."""

    def __init__(self, send: Callable[[VehiclePlan], None]) -> None:
        self._send = send
        self.platoons = PlannedPlatoons()
        self.begun: list[VehiclePlan] = []

    def publisher(self, key: str) -> _Sent:
        """Of any key."""
        return self

    def put(self, message: Message | bytes) -> None:
        """Give a plan to its vehicle; nobody else listens."""
        if isinstance(message, VehiclePlan):
            self.platoons.add(message, message.issued_ns)
            if message.continues is None:
                self.begun.append(message)
            self._send(message)


class _Store:
    """An arm's database, if it has one; cycles count from 0 in each."""

    def __init__(self, database: Database | None) -> None:
        self._database = database

    def next_cycle_number(self) -> int:
        """Of an arm's first cycle."""
        return 0

    def record_cycle(self, *cycle: Any) -> None:
        """Store one cycle."""
        if self._database is not None:
            self._database.record_cycle(*cycle)

    def save_fleet(self, records: FleetRecords) -> None:
        """Store what has changed beside a cycle."""
        if self._database is not None:
            self._database.save_fleet(records)


def _refuse(error: InputError) -> None:
    raise error


def settings_of(
    policy: Policy, time_worth_kw: float, waiting: WaitingPrices, seed: int
) -> DispatcherSettings:
    """The dispatcher's settings in an arm; without the lever "routes" vans are routed as the paper
    routes them, by an objective in which time has no price.
    """
    worth_kw = time_worth_kw or DEFAULT_TIME_WORTH_KW
    # Without the lever "routes" they are those of agents' departures alone.
    prices = PriceSettings(
        energy_kwh=1.0,
        driving_hour=worth_kw,
        waiting_hour=worth_kw if waiting.waiting_kw is None else waiting.waiting_kw,
        standing_hour=waiting.standing_kw,
    )
    objective = "energy" if "routes" in policy.levers else "paper"
    changed = {"advice": advice_of(policy), "prices": prices, "objective": objective, "seed": seed}
    return evaluation_settings(policy.solver).model_copy(update=changed)


def with_gates(snapshot: TrafficSnapshot, open_: frozenset[str]) -> TrafficSnapshot:
    """The same traffic with other gates: with none open it is the paper's baseline."""
    gated = {
        name: replace(
            traffic,
            open=name in open_,
            reason=None if name in open_ else traffic.reason or "not asked for",
        )
        for name, traffic in snapshot.segments.items()
    }
    return replace(snapshot, segments=MappingProxyType(gated))
