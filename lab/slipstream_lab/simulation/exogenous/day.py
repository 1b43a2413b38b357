"""The paper's own evaluation: routes on background traffic that they do not change.

A recorded day gives speeds, densities and turbulence. The fleet is dispatched cycle by cycle, and
every leg is driven from rest to rest at the speeds that the background had then; stops at signals
are part of a segment's mean speed, not of the drive. Platoons are whoever enters an open segment
within the synchronization window. What this leaves out is what the closed loop has: signals, other
vehicles in the way, forming up, and what the fleet does to the traffic.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from dispatcher_daemon.fleet import on_road
from dispatcher_daemon.forms import routing_problem
from dispatcher_daemon.planning.cycle import cycle_of, run_cycle
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.energy.drive import DrivingStyle, plan_drive
from slipstream.messages import VehiclePlan
from slipstream.spacing import MOST_VEHICLES
from slipstream_lab.simulation.closed_loop.dispatch_settings import (
    evaluation_settings,
    evaluation_solve,
)
from slipstream_lab.simulation.closed_loop.planned_platoons import platooned
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult, LoopCycleRecord, Others
from slipstream_lab.simulation.exogenous.passages import RecordedLeg, evaluate
from slipstream_lab.simulation.exogenous.recorded import RecordedTraffic
from slipstream_lab.simulation.exogenous.roadside import RecordedRoadside
from slipstream_lab.simulation.exogenous.tours import LegOrder, Tours
from slipstream_lab.simulation.scenarios.demand import draw_deliveries, fleet_at
from slipstream_lab.simulation.scenarios.scenario import Scenario
from slipstream_lab.simulation.sumo import Progress

_STYLE: Final = DrivingStyle()
_NO_OTHERS: Final = Others(0, 0.0, 0.0, 0.0, 0)


def exogenous_day(
    scenario: Scenario,
    recorded: RecordedTraffic,
    policy: Policy,
    seed: int,
    *,
    end_s: float | None = None,
    settings: DispatcherSettings | None = None,
    progress: Progress | None = None,
) -> ArmResult:
    """Dispatch and evaluate a fleet's day; same arguments, same day.

    The background's own figures are zero, since nothing happens to it. Disengagements are platoons,
    one count a segment, on a segment whose true traffic was turbulent.

    Of the policy, what counts is whether it has platoons, the gating, and the noise; without
    platoons it is the paper's baseline, the same model with H_platoon = 0.

    Args:
        end_s: orders are released until then; the fleet goes on until all are served, or the record
            ends. None: until the record ends.
        progress: called with the simulated time and the end, s.

    Raises:
        InputError: the scenario's fleet does not fit its network.
    """
    settings = settings or evaluation_settings()
    settings = settings.model_copy(update={"objective": "paper", "seed": seed})
    deliveries = draw_deliveries(scenario.fleet, scenario.network, seed, scenario.name)
    keep_s = {rsu.id: rsu.keep_s for rsu in scenario.rsus or ()}
    roadside = RecordedRoadside(recorded, scenario.network, policy, seed, keep_s)
    day = _FleetDay(Tours(deliveries, scenario.network), roadside, settings)
    begin_s = recorded.traffic.begin_s
    end_s = recorded.end_s if end_s is None else end_s
    day.run(begin_s, end_s, recorded.end_s, progress)
    roadside.until(recorded.end_s)
    legs, disengagements = evaluate(
        day.legs, roadside, scenario.network, settings.sync_window_s, day.longest_platoon
    )
    return ArmResult(
        scenario=scenario.name,
        seed=seed,
        policy=policy.name,
        begin_s=begin_s,
        end_s=end_s,
        legs=legs,
        services=day.tours.services(end_s),
        cycles=tuple(day.cycles),
        others=_NO_OTHERS,
        disengagements=disengagements,
        teleports=0,
        collisions=0,
        emergency_stops=0,
        gridlock_s=None,
        unfinished=0,
        ended_s=max((leg.arrived_s for leg in legs), default=end_s),
        watched=tuple(sorted(roadside.watched)),
        opened=tuple(sorted(roadside.opened)),
    )


@dataclass
class _FleetDay:
    """The fleet's day, cycle by cycle.

    Attributes:
        longest_platoon: what every cycle's fleet allows.
    """

    tours: Tours
    roadside: RecordedRoadside
    settings: DispatcherSettings
    legs: list[RecordedLeg] = field(default_factory=list)
    cycles: list[LoopCycleRecord] = field(default_factory=list)
    longest_platoon: int = MOST_VEHICLES
    _under_way: list[tuple[float, str, RecordedLeg]] = field(default_factory=list)

    def run(self, begin_s: float, end_s: float, until_s: float, progress: Progress | None) -> None:
        """Dispatch the orders of a time until all are on a tour, and finish these."""
        tours, solve = self.tours, evaluation_solve()
        tours.keep_released(begin_s, end_s)
        deliveries, now_s = tours.deliveries, begin_s
        while now_s < end_s or (now_s < until_s and tours.open):
            self._drive_until(now_s)
            idle = {name: at for name, at in tours.idle.items() if at <= now_s}
            fleet = fleet_at(deliveries, now_s, idle, tours.taken)
            if fleet is not None:
                number, snapshot = len(self.cycles), self.roadside.snapshot(now_s)
                problem = routing_problem(tours.network, fleet, self.settings)
                self.longest_platoon = min(self.longest_platoon, problem.longest_platoon)
                cycle = cycle_of(
                    problem,
                    snapshot,
                    self.settings,
                    number,
                    reference_delay_s=0.0,
                    on_road=on_road(tours.plans(), snapshot.now_ns, tours.late_s()),
                )
                result = run_cycle(cycle, solve)
                for plan in result.plans:
                    self._start(tours.begin(plan))
                self._note(now_s, result.report.status, result.plans)
            now_s += deliveries.settings.cycle_s
            if progress is not None:
                progress(min(now_s, end_s), end_s)
        self._drive_until(math.inf)

    def _drive_until(self, now_s: float) -> None:
        """End the legs that end by a time, and begin those that follow."""
        while self._under_way and self._under_way[0][0] <= now_s:
            self._start(self.tours.arrived(heapq.heappop(self._under_way)[2]))

    def _start(self, orders: Iterable[LegOrder]) -> None:
        """Drive legs at the speeds that they find when they begin."""
        for order in orders:
            lengths = [self.tours.network.segments[segment].length_m for segment in order.path]
            speeds = [self.roadside.speed_mps(segment, order.due_s) for segment in order.path]
            leg = RecordedLeg(
                order.vehicle,
                order.round,
                order.leg,
                order.path,
                order.ready_s,
                order.due_s,
                plan_drive(lengths, speeds, _STYLE),
                order.free_s,
            )
            self.legs.append(leg)
            heapq.heappush(self._under_way, (leg.arrived_s, order.id, leg))

    def _note(self, now_s: float, status: str, plans: Sequence[VehiclePlan]) -> None:
        watched, judged, opened, wrong = self.roadside.counts()
        in_platoons = [platooned(plan) for plan in plans]
        self.cycles.append(
            LoopCycleRecord(
                time_s=now_s,
                status=status,
                vehicles=len(plans),
                planned_kwh=sum(plan.energy_kwh for plan in plans),
                planned_platooned_m=sum(distance_m for distance_m, _ in in_platoons),
                planned_drafting_kwh=sum(saved_kwh for _, saved_kwh in in_platoons),
                open=opened,
                judged=judged,
                watched=watched,
                open_turbulent=wrong,
            )
        )
