"""The paper's own evaluation: routes on background traffic that they do not change.

A recorded day gives speeds, densities and turbulence. The fleet is dispatched cycle by cycle, and
every leg is driven from rest to rest at the speeds that the background had then; stops at signals
are part of a segment's mean speed, not of the drive. Platoons are whoever enters an open segment
within the synchronization window. What this leaves out is what the closed loop has: signals, other
vehicles in the way, forming up, and what the fleet does to the traffic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from dispatcher_daemon.dispatch import run_cycle
from dispatcher_daemon.drive import DrivingStyle, plan_drive
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.settings import DispatcherSettings
from simulation.closed_loop.dispatch_settings import evaluation_settings, evaluation_solve
from simulation.closed_loop.policy import Policy
from simulation.closed_loop.record import ArmResult, CycleRecord, Others, Service
from simulation.evaluation.passages import RecordedLeg, evaluate
from simulation.evaluation.recorded import Recorded
from simulation.evaluation.roadside import Roadside
from simulation.scenarios.apart import Progress
from simulation.scenarios.fleet import Deliveries, draw_deliveries, fleet_at
from simulation.scenarios.scenario import Scenario
from slipstream.energy import Energy, total
from slipstream.messages import VehiclePlan

_STYLE: Final = DrivingStyle()
_NOTHING_HAPPENED: Final = Others(0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ExogenousDay:
    """A fleet's day on traffic that it does not change.

    Attributes:
        arm: legs, services and cycles like the closed loop's; the background's own figures are
            zero, since nothing happens to it. Disengagements are platoons, one count a segment, on
            a segment that was turbulent in truth.
        watched_m: driven on segments that are watched.
        open_m: of that, driven where the gate was open on entering, in a platoon or alone.
        violations: passages in a platoon of segments that were turbulent in truth.
        violated_m: their length.
    """

    arm: ArmResult
    watched_m: float
    open_m: float
    violations: int
    violated_m: float

    @property
    def distance_m(self) -> float:
        """Driven by the fleet."""
        return sum(leg.distance_m for leg in self.arm.legs)

    @property
    def travel_s(self) -> float:
        """Driving, service apart."""
        return sum(leg.travel_s for leg in self.arm.legs)

    @property
    def platooned_m(self) -> float:
        """Driven in platoons, at their front or behind."""
        return sum(leg.led_m + leg.followed_m for leg in self.arm.legs)

    @property
    def driven(self) -> Energy:
        """With the drag reductions of platoons."""
        return total(leg.driven for leg in self.arm.legs)

    @property
    def alone(self) -> Energy:
        """The same drives without any."""
        return total(leg.alone for leg in self.arm.legs)


def exogenous_day(
    scenario: Scenario,
    recorded: Recorded,
    policy: Policy,
    seed: int,
    *,
    settings: DispatcherSettings | None = None,
    progress: Progress | None = None,
) -> ExogenousDay:
    """Dispatch and evaluate a fleet's day; same arguments, same day.

    Of the policy, what counts is whether it has platoons, the gating, and the noise; without
    platoons it is the paper's baseline, the same model with H_platoon = 0.

    Args:
        seed: of the deliveries, the perception's errors and the searches.
        settings: of the dispatcher.
        progress: told the simulated time.

    Raises:
        InputError: the scenario's fleet does not fit its network.
    """
    settings = settings or evaluation_settings()
    deliveries = draw_deliveries(scenario.fleet, scenario.network, seed, scenario.name)
    roadside = Roadside(recorded, scenario.network, policy, seed)
    rounds = _Rounds(scenario, deliveries, roadside, settings, seed)
    begin_s, end_s = recorded.traffic.begin_s, recorded.end_s
    rounds.run(begin_s, end_s, progress)
    roadside.until(end_s)
    driven = evaluate(rounds.legs, roadside, scenario.network, settings.sync_window_s)
    arm = ArmResult(
        scenario=scenario.name,
        seed=seed,
        policy=policy.name,
        begin_s=begin_s,
        end_s=end_s,
        legs=driven.legs,
        services=tuple(
            Service(order.id, order.latest_s, rounds.begun_s.get(order.id))
            for order in deliveries.orders
            if begin_s <= order.release_s < end_s
        ),
        cycles=tuple(rounds.cycles),
        others=_NOTHING_HAPPENED,
        disengagements=driven.partings,
        teleports=0,
        collisions=0,
        emergency_stops=0,
        gridlock_s=None,
        unfinished=0,
    )
    return ExogenousDay(arm, driven.watched_m, driven.open_m, driven.violations, driven.violated_m)


@dataclass
class _Rounds:
    """The fleet's rounds as the day goes on."""

    scenario: Scenario
    deliveries: Deliveries
    roadside: Roadside
    settings: DispatcherSettings
    seed: int
    legs: list[RecordedLeg] = field(default_factory=list)
    begun_s: dict[str, float] = field(default_factory=dict)
    cycles: list[CycleRecord] = field(default_factory=list)
    rounds: dict[str, int] = field(default_factory=dict)

    def run(self, begin_s: float, end_s: float, progress: Progress | None) -> None:
        """Dispatch cycle by cycle; orders released before the begin are another day's, and those
        that nobody can serve in time any more are given up.
        """
        solve, orders = evaluation_solve(), self.deliveries.orders
        back_s = dict.fromkeys(self.deliveries.vehicles, begin_s)
        gone = {order.id for order in orders if order.release_s < begin_s}
        cycle_s, now_s = self.deliveries.settings.cycle_s, begin_s
        while now_s < end_s:
            gone.update(order.id for order in orders if order.latest_s < now_s)
            idle = {name: now_s for name, at in back_s.items() if at <= now_s}
            fleet = fleet_at(self.deliveries, now_s, idle, gone)
            if fleet is not None:
                snapshot = self.roadside.snapshot(now_s)
                result = run_cycle(
                    RoutingProblem(self.scenario.network, fleet, style=_STYLE),
                    snapshot,
                    self.settings,
                    solve,
                    snapshot.now_ns,
                    round(now_s / cycle_s),
                    self.seed,
                    reference_s=0.0,
                )
                for plan in result.plans:
                    gone.update(stop.stop for stop in plan.stops[1:-1])
                    back_s[plan.vehicle] = self._drive(plan, fleet.service_s)
                self._note(now_s, result.report.status, result.plans)
            now_s += cycle_s
            if progress is not None:
                progress(min(now_s, end_s), end_s)

    def _drive(self, plan: VehiclePlan, service_s: Callable[[str], float]) -> float:
        """Drive a round at the speeds that each leg finds; returns when the vehicle is back."""
        count = self.rounds.get(plan.vehicle, 0)
        self.rounds[plan.vehicle] = count + 1
        clock_s = plan.depart_ns / 1e9
        for number, stop in enumerate(plan.stops[1:]):
            path = tuple(s.segment for s in plan.segments if s.leg == number)
            if path:
                leg = self._leg((plan.vehicle, count, number), path, clock_s)
                self.legs.append(leg)
                clock_s += leg.drive.duration_s
            if number < len(plan.stops) - 2:
                self.begun_s[stop.stop] = clock_s
                clock_s += service_s(stop.stop)
        return clock_s

    def _leg(self, name: tuple[str, int, int], path: tuple[str, ...], due_s: float) -> RecordedLeg:
        segments = [self.scenario.network.segments[segment] for segment in path]
        lengths = [segment.length_m for segment in segments]
        speeds = [self.roadside.speed_mps(segment, due_s) for segment in path]
        free = plan_drive(lengths, [segment.speed_limit_mps for segment in segments], _STYLE)
        return RecordedLeg(*name, path, due_s, plan_drive(lengths, speeds, _STYLE), free.duration_s)

    def _note(self, now_s: float, status: str, plans: Sequence[VehiclePlan]) -> None:
        watched, judged, opened, wrong = self.roadside.counts()
        segments = self.scenario.network.segments
        platooned_m = sum(
            segments[planned.segment].length_m
            for plan in plans
            for planned in plan.segments
            if planned.platoon is not None
        )
        energy = sum(plan.energy_kwh for plan in plans)
        self.cycles.append(
            CycleRecord(
                now_s, status, len(plans), energy, platooned_m, opened, judged, watched, wrong
            )
        )
