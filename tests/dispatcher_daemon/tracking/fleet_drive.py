"""Vehicles that drive by their plans, as pure objects: plans in, positions and visits out."""

from __future__ import annotations

from dataclasses import dataclass, field

from slipstream.messages import (
    PlanAcknowledgement,
    PlannedSegment,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
    Visit,
)


@dataclass
class Van:
    """A vehicle that keeps to its plan's times, but for its lateness.

    Attributes:
        name: its id.
        home: a segment that leaves its depot.
        talks: whether it answers plans and reports visits, or only its position.
        late_s: by how much it is behind its plan.
        deaf: whether no plan reaches it.
    """

    name: str
    home: str
    talks: bool = True
    late_s: float = 0.0
    deaf: bool = False
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

    def _refusal(self, plan: VehiclePlan, now_ns: int) -> str | None:
        leg, segment = self._place(now_ns)
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
