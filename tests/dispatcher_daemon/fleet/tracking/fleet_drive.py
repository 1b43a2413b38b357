"""Vehicles that drive by their plans, and a dispatcher around the tracker and the cycle, both as
pure objects.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.tracking import FleetSituation, FleetTracker
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.ledger import EnergyHour, PlanEnergy
from slipstream.messages import (
    PlanAcknowledgement,
    PlannedSegment,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
    Visit,
)
from slipstream.orders import FleetRecords, OrderChange, PlanRecord

S = 10**9
SEARCH = SearchSettings(rounds=1, iterations_per_stop=20, time_limit_s=5.0)
SETTINGS = DispatcherSettings(
    solvers=("exact",),
    form="route",
    city=CitySettings(search=SEARCH, second_rounds=0, max_sweeps=2),
)
SOLVE = solve_in_process([ExactSolver()])


@dataclass
class Van:
    """A vehicle that keeps to its plan's times, but for its lateness.

    Attributes:
        name: its id.
        home: a segment that leaves its depot.
        talks: whether it answers plans and reports visits, or only its position.
        late_s: by how much it is behind its plan.
        deaf: whether no plan reaches it.
        refuses: whether its driver refuses the next plan.
        muted_until_ns: until when nothing that it sends arrives.
    """

    name: str
    home: str
    talks: bool = True
    late_s: float = 0.0
    deaf: bool = False
    refuses: bool = False
    muted_until_ns: int = 0
    plan: VehiclePlan | None = None
    answer: PlanAcknowledgement | None = None
    visits: dict[str, Visit] = field(default_factory=dict)
    plans: list[VehiclePlan] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)

    def offer(self, plan: VehiclePlan, now_ns: int) -> None:
        """A plan comes."""
        if self.deaf:
            return
        reason = self._refusal(plan, now_ns)
        if reason is None:
            self.plans.append(plan)
            self.plan = plan
            self.late_s = 0.0
        else:
            self.refused.append(reason)
        self.answer = PlanAcknowledgement(
            vehicle=self.name,
            time_ns=now_ns,
            cycle=plan.cycle,
            accepted=reason is None,
            reason=reason,
        )

    def is_under_way(self, now_ns: int) -> bool:
        """Whether it has left its depot and is not back."""
        leg, segment = self._place(now_ns)
        return self.plan is not None and (segment is not None or 0 < leg < len(self.plan.stops) - 1)

    def _refusal(self, plan: VehiclePlan, now_ns: int) -> str | None:
        leg, segment = self._place(now_ns)
        if self.refuses and (self.plan is None or (leg == 0 and segment is None)):
            self.refuses = False
            return "not today"
        if self.plan is None or (leg == 0 and segment is None):
            return None if plan.continues is None else "nothing to continue"
        if plan.continues != self.plan.cycle:
            return "under way"
        if plan.stops[0].stop != self.plan.stops[leg].stop:
            return "elsewhere"
        if segment is not None:
            if plan.stops[1].stop != self.plan.stops[leg + 1].stop:
                return "on its way to another stop"
            if segment.segment not in [s.segment for s in plan.segments if s.leg == 0]:
                return "not on this way"
        return None

    def _place(self, now_ns: int) -> tuple[int, PlannedSegment | None]:
        """(leg that it drives or drives next, its segment); the leg of number of all: home."""
        if self.plan is None:
            return 0, None
        at_ns = now_ns - round(1e9 * self.late_s)
        for segment in self.plan.segments:
            if segment.entry_ns <= at_ns < segment.exit_ns:
                return segment.leg, segment
        reached = [n for n, stop in enumerate(self.plan.stops) if n and stop.arrival_ns <= at_ns]
        return max(reached, default=0), None

    def step(self, now_ns: int) -> tuple[VehiclePosition, VehicleProgress | None]:
        """What it reports now."""
        leg, segment = self._place(now_ns)
        if self.plan is not None:
            self._visit(self.plan, now_ns)
            if leg == len(self.plan.stops) - 1:
                self.plan, leg = None, 0
        cycle = None if self.plan is None else self.plan.cycle
        at_ns = now_ns - round(1e9 * self.late_s)
        if segment is None:
            where, share = self.home, 0.0
            if self.plan is not None and leg > 0:
                node = self.plan.stops[leg].node
                where = next(s.segment for s in self.plan.segments if s.leg >= leg)
                assert where.startswith(node)
        else:
            where = segment.segment
            share = (at_ns - segment.entry_ns) / (segment.exit_ns - segment.entry_ns)
        position = VehiclePosition(
            vehicle=self.name,
            time_ns=now_ns,
            segment=where,
            share=min(1.0, max(0.0, share)),
            speed_mps=0.0 if segment is None else segment.speed_mps,
            on_road=segment is not None,
            cycle=cycle,
            leg=None if cycle is None else leg,
        )
        if not self.talks:
            return position, None
        visits = tuple(self.visits.values())
        return position, VehicleProgress(
            vehicle=self.name, time_ns=now_ns, cycle=cycle, visits=visits
        )

    def _visit(self, plan: VehiclePlan, now_ns: int) -> None:
        late_ns = round(1e9 * self.late_s)
        for number, stop in enumerate(plan.stops[:-1]):
            arrived_ns, left_ns = stop.arrival_ns + late_ns, stop.departure_ns + late_ns
            known = self.visits.get(stop.stop)
            if number == 0 and known is None:
                continue  # its depot
            if stop.is_hub:
                continue
            if arrived_ns > now_ns or (known is not None and known.status != "arrived"):
                continue
            done = left_ns <= now_ns
            self.visits[stop.stop] = Visit(
                stop=stop.stop,
                status="served" if done else "arrived",
                arrived_ns=arrived_ns if known is None else known.arrived_ns,
                ended_ns=left_ns if done else None,
                reason=None,
            )


class Store:
    """What the database keeps of orders, plans and vehicles."""

    def __init__(self) -> None:
        self.changes: list[OrderChange] = []
        self.driven: list[EnergyHour] = []
        self._kept: list[dict[object, object]] = [{}, {}, {}]

    def save(
        self,
        records: FleetRecords,
        plans: Collection[VehiclePlan],
        now_ns: int,
        energies: Mapping[str, PlanEnergy],
    ) -> None:
        """As `Database.record_cycle`."""
        self.driven += records.driven
        self.changes += records.changes
        orders, kept, vehicles = self._kept
        orders.update({o.order: o for o in records.orders})
        new = [
            PlanRecord(plan, "published", now_ns, energy=energies[plan.vehicle]) for plan in plans
        ]
        kept.update({(r.plan.cycle, r.plan.vehicle): r for r in (*new, *records.plans)})
        vehicles.update({v.vehicle: v for v in records.vehicles})

    def load(self) -> FleetRecords:
        """As `Database.load_fleet`."""
        orders, kept, vehicles = (tuple(of.values()) for of in self._kept)
        alive = [r for r in kept if r.status in ("published", "acknowledged", "lapsed")]  # type: ignore[attr-defined]
        return FleetRecords(orders, (), tuple(alive), vehicles)  # type: ignore[arg-type]


@dataclass
class Day:
    """A town's dispatcher and its vans, in steps of a second."""

    problem: RoutingProblem
    snapshot: TrafficSnapshot
    vans: dict[str, Van]
    file: Fleet | None
    now_ns: int = 0
    number: int = 0
    situation: FleetSituation | None = None
    sent: list[VehiclePlan] = field(default_factory=list)
    results: list[CycleResult] = field(default_factory=list)
    store: Store = field(default_factory=Store)

    def __post_init__(self) -> None:
        self.now_ns = self.snapshot.now_ns
        self.restart()

    def restart(self) -> None:
        """A new dispatcher with what the last one has stored."""
        self.tracker = FleetTracker(self.problem.network, self.store.load(), self.now_ns)

    def cycle(self) -> tuple[VehiclePlan, ...]:
        """One cycle, with what the daemon does around it."""
        self.number += 1
        now_ns, reference_s = self.now_ns, SETTINGS.deadline_s
        tracker = self.tracker
        tracker.list_fleet(self.file, now_ns)
        situation = tracker.situation(self.file, self.number, now_ns, reference_s)
        self.situation = situation
        plans: tuple[VehiclePlan, ...] = ()
        energies: Mapping[str, PlanEnergy] = {}
        if situation.fleet is not None:
            cycle = Cycle(
                replace(self.problem, fleet=situation.fleet),
                TrafficSnapshot(now_ns, self.snapshot.segments, ()),
                SETTINGS,
                self.number,
                now_ns,
                self.number,
                commitments=situation.commitments,
                on_road=situation.on_road,
            )
            result = run_cycle(cycle, SOLVE)
            assert result.report.status != "failed", result.report.reason
            plans = tracker.admissible(result.plans)
            reference_ns = now_ns + round(reference_s * S)
            energies = result.energies
            tracker.publish(plans, situation.fleet.stop_by_id, reference_ns, now_ns, energies)
            self.results.append(result)
        else:
            tracker.publish((), {}, now_ns, now_ns)
        self.store.save(tracker.pending_records(), plans, now_ns, energies)
        tracker.stored()
        self.sent += plans
        return plans

    def drive(self, seconds: int) -> None:
        """The vans drive and report."""
        for _ in range(seconds):
            self.now_ns += S
            for van in self.vans.values():
                self._report(van)

    def _report(self, van: Van) -> None:
        position, progress = van.step(self.now_ns)
        if self.now_ns < van.muted_until_ns:
            van.answer = None
            return
        if van.answer is not None and van.talks:
            self.tracker.on_acknowledgement(van.answer, self.now_ns)
            van.answer = None
        self.tracker.on_position(position, self.now_ns)
        if progress is not None:
            self.tracker.on_progress(progress, self.now_ns)

    def run(self, cycles: int, lost: Collection[str] = ()) -> None:
        """Cycles with driving between them.

        Args:
            cycles: number of them.
            lost: vans that the plans do not reach.
        """
        for _ in range(cycles):
            plans = self.cycle()
            self.drive(2)
            for plan in plans:
                if plan.vehicle not in lost:
                    self.vans[plan.vehicle].offer(plan, self.now_ns)
            self.drive(28)

    def states(self) -> Counter[str]:
        """Number of orders by state."""
        return Counter(order.state for order in self.tracker.book.orders.values())

    def served(self) -> Counter[str]:
        """How many vans have been at each stop to its end."""
        return Counter(
            stop
            for van in self.vans.values()
            for stop, visit in van.visits.items()
            if visit.status == "served"
        )
