"""Dispatch cycles of a running simulation: from RSU reports to legs of vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from dispatcher_daemon.cycle import cycle_seed, run_cycle
from dispatcher_daemon.fleet import Fleet, Stop, Vehicle
from dispatcher_daemon.plans import Cycle
from dispatcher_daemon.platooning import on_road
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import roads_of
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import Expectations, TrafficSnapshot, take_snapshot
from simulation.closed_loop.alternative_routes import AlternativeRoutes
from simulation.closed_loop.dispatch_settings import evaluation_settings, evaluation_solve
from simulation.closed_loop.gates import WINDOW_S, Roadside
from simulation.closed_loop.history import History
from simulation.closed_loop.policy import Policy
from simulation.closed_loop.record import CycleRecord
from simulation.closed_loop.tours import Tours
from simulation.controllers import LegOrder
from simulation.controllers.signals import DepartureSettings
from simulation.scenarios.demand import fleet_at
from slipstream.messages import DrivingAdvice, SegmentState

DEFAULT_TIME_WORTH_KW: Final = 10.0
"""Value of driving time in a city at the limit; see `History.time_worth_kw`."""


class Dispatching:
    """The real dispatch cycle on the fleet's orders.

    Args:
        tours: of the day.
        policy: of the arm.
        seed: of the searches.
        executor: runs the search for base routes.
        history: what movements cost on another day; for the lever "routes" alone.
    """

    def __init__(
        self,
        tours: Tours,
        policy: Policy,
        seed: int,
        executor: Executor,
        history: History | None = None,
    ) -> None:
        self._tours, self._policy, self._seed, self._executor = tours, policy, seed, executor
        self._history = history if "routes" in policy.levers else None
        self.time_worth_kw = (
            0.0 if self._history is None else self._history.time_worth_kw(tours.network)
        )
        self._alternatives: tuple[tuple[SegmentState, ...], AlternativeRoutes] | None = None
        self._expected: tuple[int, Expectations] | None = None
        self._settings = settings_of(policy)
        self._solve = evaluation_solve()
        self.cycles: list[CycleRecord] = []

    def cycle(self, now_s: float, roadside: Roadside) -> Iterator[LegOrder]:
        """Plan the released orders; the first legs of the tours that begin."""
        tours = self._tours
        idle = {name: at for name, at in tours.idle.items() if at <= now_s}
        fleet = fleet_at(tours.deliveries, now_s, idle, tours.taken)
        if fleet is None:
            return
        number, now_ns = len(self.cycles), round(now_s * 1e9)
        cycle = Cycle(
            self._problem(fleet),
            self.snapshot(now_s, roadside),
            self._settings,
            number,
            now_ns,
            cycle_seed(self._seed, number),
            reference_delay_s=0.0,
            on_road=tuple(on_road(tours.plans(), now_ns, tours.late_s())),
        )
        result = run_cycle(cycle, self._solve, self._executor)
        energy = result.report.energy
        open_, judged, turbulent = roadside.open, roadside.judged, roadside.is_turbulent
        self.cycles.append(
            CycleRecord(
                time_s=now_s,
                status=result.report.status,
                vehicles=len(result.plans),
                planned_kwh=sum(plan.energy_kwh for plan in result.plans),
                planned_platooned_m=0.0 if energy is None else energy.platooned_distance_m,
                open=len(open_ & judged),
                judged=len(judged),
                watched=len(roadside.watched),
                open_turbulent=sum(turbulent(segment) for segment in open_),
            )
        )
        for plan in result.plans:
            yield from tours.begin(plan)

    def snapshot(self, now_s: float, roadside: Roadside) -> TrafficSnapshot:
        """The traffic as the dispatcher knows it; all gates closed where it may not platoon."""
        snapshot = take_snapshot(
            self._tours.network,
            roadside.states,
            round(now_s * 1e9),
            stale_after_s=1.5 * WINDOW_S,
        )
        if "platoons" not in self._policy.levers:
            snapshot = with_gates(snapshot, frozenset())
        elif self._policy.gating != "rsu":
            snapshot = with_gates(snapshot, roadside.open)
        return replace(snapshot, expected=self._expectations(now_s))

    def alternatives(self, now_s: float, roadside: Roadside) -> AlternativeRoutes:
        """Alternative paths by the present traffic and the costs of the arm's routes."""
        if self._alternatives is None or self._alternatives[0] is not roadside.states:
            # A problem needs a stop; the costs of roads do not depend on it.
            depots = self._tours.deliveries.settings.depots
            stop = Stop(id="anywhere", node=depots[0].node)
            fleet = Fleet(depots=depots, stops=(stop,), vehicles=(Vehicle(id="anybody"),))
            roads = roads_of(self._problem(fleet), self.snapshot(now_s, roadside))
            self._alternatives = roadside.states, AlternativeRoutes(self._tours.network, roads)
        return self._alternatives[1]

    @property
    def waiting_worth_kw(self) -> float:
        """Value of waiting at the depot or at the kerb."""
        return self.time_worth_kw or DEFAULT_TIME_WORTH_KW

    def _problem(self, fleet: Fleet) -> RoutingProblem:
        return RoutingProblem(
            self._tours.network,
            fleet,
            search=self._policy.search,
            value_of_time_kw=self.time_worth_kw,
            value_of_waiting_kw=self.waiting_worth_kw,
        )

    def _expectations(self, now_s: float) -> Expectations | None:
        if self._history is None:
            return None
        hour = int(now_s // 3600)
        if self._expected is None or self._expected[0] != hour:
            self._expected = hour, self._history.expectations(self._tours.network, hour)
        return self._expected[1]


def settings_of(policy: Policy) -> DispatcherSettings:
    """The dispatcher's settings in an arm."""
    levers = policy.levers
    advice = DrivingAdvice(
        eco_approach="eco_approach" in levers,
        coasting_budget=policy.coasting_budget if "coasting" in levers else 0.0,
        signal_priority="priority" in levers,
        departure_window_s=DepartureSettings().window_s if "departures" in levers else 0.0,
    )
    return evaluation_settings().model_copy(update={"advice": advice})


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
