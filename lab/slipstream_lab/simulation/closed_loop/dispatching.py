"""Dispatch cycles of a running simulation: orders and the fleet's messages in, plans out."""

from __future__ import annotations

from collections.abc import Callable, Collection
from concurrent.futures import Executor
from dataclasses import replace
from types import MappingProxyType

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.learning import History
from dispatcher_daemon.fleet.tracking import FleetTracker
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.cycle import cycle_seed, run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.settings import AdviceSettings, DispatcherSettings
from dispatcher_daemon.traffic import Expectations, TrafficSnapshot, take_snapshot
from slipstream.messages import (
    Message,
    PlanAcknowledgement,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
)
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.closed_loop.dispatch_settings import (
    DEFAULT_TIME_WORTH_KW,
    evaluation_settings,
    evaluation_solve,
)
from slipstream_lab.simulation.closed_loop.gates import WINDOW_S, Roadside
from slipstream_lab.simulation.closed_loop.planned_platoons import PlannedPlatoons
from slipstream_lab.simulation.closed_loop.policy import AS_DRIVING, Policy, WaitingPrices
from slipstream_lab.simulation.closed_loop.record import CycleRecord
from slipstream_lab.simulation.scenarios.demand import Deliveries, fleet_at
from storage import Database
from vehicle_agent.signals import DepartureSettings


class Dispatching:
    """The real dispatcher's cycle and fleet tracking, called in this process.

    Args:
        deliveries: orders and vehicles of the day.
        network: roads.
        policy: of the arm.
        seed: of the searches.
        executor: runs the search for base routes.
        send: takes each plan that goes out.
        history: what movements cost on another day; for the lever "routes" alone.
        database: takes cycles, plans and the energy ledger; None: they are not stored.
        prices: of waiting for other vehicles.
    """

    def __init__(
        self,
        deliveries: Deliveries,
        network: RoadNetwork,
        policy: Policy,
        seed: int,
        executor: Executor,
        send: Callable[[VehiclePlan], None],
        history: History | None = None,
        database: Database | None = None,
        prices: WaitingPrices = AS_DRIVING,
    ) -> None:
        self._database, self._prices = database, prices
        self._deliveries, self._network = deliveries, network
        self._policy, self._seed, self._executor, self._send = policy, seed, executor, send
        self._history = history if "routes" in policy.levers else None
        self.time_worth_kw = 0.0 if self._history is None else self._history.time_worth_kw(network)
        self._expected: tuple[int, Expectations] | None = None
        self._settings = settings_of(policy, self.time_worth_kw or DEFAULT_TIME_WORTH_KW)
        self._solve = evaluation_solve(self._settings)
        self._tracker = FleetTracker(network)
        self._platoons = PlannedPlatoons()
        self._number = 0
        self.cycles: list[CycleRecord] = []

    def receive(self, message: Message) -> None:
        """Take in what a vehicle sends to the dispatcher."""
        match message:
            case VehiclePosition():
                self._tracker.on_position(message, message.time_ns)
            case PlanAcknowledgement():
                self._tracker.on_acknowledgement(message, message.time_ns)
            case VehicleProgress():
                self._tracker.on_progress(message, message.time_ns)

    def cycle(self, now_s: float, over: Collection[str], roadside: Roadside) -> None:
        """Plan the released orders and the vehicles from where they are; the plans go out.

        Args:
            now_s: since midnight.
            over: orders that are, or are being, served, and those that do not count.
            roadside: has the RSUs' reports.
        """
        everybody = dict.fromkeys(self._deliveries.vehicles, now_s)
        fleet = fleet_at(self._deliveries, now_s, everybody, over)
        number, now_ns = self._number, round(now_s * 1e9)
        self._number += 1
        self._tracker.list_fleet(fleet, now_ns)
        situation = self._tracker.situation(fleet, number, now_ns, 0.0)
        if situation.fleet is None:
            return
        snapshot = self.snapshot(now_s, roadside)
        cycle = Cycle(
            self._problem(situation.fleet),
            snapshot,
            self._settings,
            number,
            now_ns,
            cycle_seed(self._seed, number),
            reference_delay_s=0.0,
            commitments=situation.commitments,
            on_road=situation.on_road,
        )
        result = run_cycle(cycle, self._solve, self._executor)
        plans = self._tracker.admissible(result.plans)
        stops = situation.fleet.stop_by_id
        self._tracker.publish(plans, stops, now_ns, now_ns, result.energies)
        if self._database is not None:
            report = result.report.model_copy(update={"plans": len(plans)})
            records = self._tracker.pending_records()
            self._database.record_cycle(
                report, plans, snapshot.states, records, energies=result.energies
            )
            self._tracker.stored()
        planned_m, saved_kwh = self._platoons.planned_m, self._platoons.saved_kwh
        for plan in plans:
            self._platoons.add(plan, now_ns)
            self._send(plan)
        open_, judged, turbulent = roadside.open, roadside.judged, roadside.is_turbulent
        begun = [plan for plan in plans if plan.continues is None]
        self.cycles.append(
            CycleRecord(
                time_s=now_s,
                status=result.report.status,
                vehicles=len(begun),
                planned_kwh=sum(plan.energy_kwh for plan in begun),
                planned_platooned_m=self._platoons.planned_m - planned_m,
                planned_drafting_kwh=self._platoons.saved_kwh - saved_kwh,
                open=len(open_ & judged),
                judged=len(judged),
                watched=len(roadside.watched),
                open_turbulent=sum(turbulent(segment) for segment in open_),
            )
        )

    def close(self, now_s: float) -> None:
        """Store what was driven since the last cycle."""
        if self._database is not None:
            now_ns = round(now_s * 1e9)
            self._tracker.publish((), {}, now_ns, now_ns)
            self._database.save_fleet(self._tracker.pending_records())
            self._tracker.stored()

    def snapshot(self, now_s: float, roadside: Roadside) -> TrafficSnapshot:
        """The traffic as the dispatcher knows it; all gates closed where it may not platoon."""
        snapshot = take_snapshot(
            self._network,
            roadside.states,
            round(now_s * 1e9),
            stale_after_s=1.5 * WINDOW_S,
        )
        if "platoons" not in self._policy.levers:
            snapshot = with_gates(snapshot, frozenset())
        elif self._policy.gating != "rsu":
            snapshot = with_gates(snapshot, roadside.open)
        return replace(snapshot, expected=self._expectations(now_s))

    @property
    def waiting_worth_kw(self) -> float:
        """Price of waiting for other vehicles at the depot."""
        if self._prices.waiting_kw is not None:
            return self._prices.waiting_kw
        return self.time_worth_kw or DEFAULT_TIME_WORTH_KW

    def _problem(self, fleet: Fleet) -> RoutingProblem:
        return RoutingProblem(
            self._network,
            fleet,
            search=self._policy.search,
            # Without the lever vans are routed as the paper routes them.
            objective="energy" if "routes" in self._policy.levers else "paper",
            price_of_time_kw=self.time_worth_kw,
            price_of_waiting_kw=self.waiting_worth_kw,
            standing_kw=self._prices.standing_kw,
            advised_gap_m=self._settings.gap_m,
            drafting="expected",
        )

    def _expectations(self, now_s: float) -> Expectations | None:
        if self._history is None:
            return None
        hour = int(now_s // 3600)
        if self._expected is None or self._expected[0] != hour:
            self._expected = hour, self._history.expectations(self._network, hour)
        return self._expected[1]


def settings_of(policy: Policy, value_of_time_kw: float) -> DispatcherSettings:
    """The dispatcher's settings in an arm."""
    levers = policy.levers
    advice = AdviceSettings(
        eco_approach="eco_approach" in levers,
        coasting_budget=policy.coasting_budget if "coasting" in levers else 0.0,
        signal_priority="priority" in levers,
        departure_window_s=DepartureSettings().window_s if "departures" in levers else 0.0,
        value_of_time_kw=value_of_time_kw,
    )
    return evaluation_settings(solver=policy.solver).model_copy(update={"advice": advice})


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
