"""The tour of one vehicle: the plan that it follows, the leg that it is on, what became of stops.

Only the plan of the latest cycle holds. A plan that begins at a depot is taken by a vehicle that is
at its depot; a vehicle under way takes one that continues its own. What does not fit is refused,
with the reason in the answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from slipstream.messages import (
    Count,
    DriverReport,
    Model,
    PlanAcknowledgement,
    PlannedStop,
    TimeNs,
    VehiclePlan,
    VehicleProgress,
    VehicleSensing,
    Visit,
)
from vehicle_agent.leg import Leg, VehicleState, legs_of

MAX_VISITS: Final = 200
"""What a VehicleProgress repeats of the past: some days of a delivery van."""

_LATE_NS: Final = 2_000_000_000
"""So long before its depot was reached again a plan's departure may lie."""


class TourRecord(Model):
    """A tour as it is kept over a restart; fields as of `Tour`."""

    plan: VehiclePlan | None
    leg: Count
    left_depot: bool
    driving: bool
    ready_ns: TimeNs
    newest: Count
    visits: tuple[Visit, ...]


class Tour:
    """What a vehicle does by its plans.

    Attributes:
        plan: that it follows; None: none, it is free at its depot.
        leg: number of the leg that it drives, or will drive next.
        driving: whether it is on the road.
        state: where it is on that leg; None while it stands, and off its way.
        ready_ns: since when it could leave, UTC: since its last stop ended, or it came home.
        revision: changes with everything that a restart needs.
    """

    def __init__(self, vehicle: str, max_speed_mps: float | None = None) -> None:
        self.vehicle = vehicle
        self._max_speed_mps = max_speed_mps or math.inf
        self.plan: VehiclePlan | None = None
        self.leg = 0
        self.driving = False
        self.state: VehicleState | None = None
        self.ready_ns = 0
        self.revision = 0
        self._legs: tuple[Leg | None, ...] = ()
        self._left_depot = False
        self._newest = -1
        self._visits: dict[str, Visit] = {}

    @property
    def current(self) -> Leg | None:
        """The leg that it drives or will drive next; None: no plan."""
        return None if self.plan is None else self._legs[self.leg]

    @property
    def under_way(self) -> bool:
        """Whether it has left its depot and is not back."""
        return self.plan is not None and (self._left_depot or self.driving)

    @property
    def standing_at(self) -> PlannedStop | None:
        """The stop of the plan at which it stands; None: no plan, or it drives."""
        return None if self.plan is None or self.driving else self.plan.stops[self.leg]

    def due_ns(self) -> int | None:
        """When the next leg is to begin, UTC; None: it drives, serves a stop, or has no plan.

        A tour begins when the plan says so, each further leg as soon as the stop before it ended,
        but after a wait for other vehicles no sooner than planned.
        """
        stop = self.standing_at
        if self.plan is None or stop is None:
            return None
        if not self.under_way:
            return max(self.plan.depart_ns, self.ready_ns)
        visit = self._visits.get(stop.stop)
        if not stop.is_hub and visit is not None and visit.status == "arrived":
            return None
        ready_ns = self.ready_ns + round(1e9 * stop.break_s)  # however late it came
        return max(stop.departure_ns, ready_ns) if stop.wait_s > 0 else ready_ns

    def slack_ns(self, due_ns: int) -> int:
        """By how much the next leg may begin later without a late delivery, the rest of the tour
        taking as long as planned; 0 where the vehicle is late already.
        """
        assert self.plan is not None
        shift_ns = due_ns - self.plan.stops[self.leg].departure_ns
        spare = [
            stop.latest_ns - stop.arrival_ns - shift_ns
            for stop in self.plan.stops[self.leg + 1 : -1]
            if stop.latest_ns is not None
        ]
        return max(0, min(spare, default=0))

    def offer(self, plan: VehiclePlan, now_ns: int) -> PlanAcknowledgement | None:
        """Take a plan, or refuse it; None: it is another vehicle's, or older than the own one."""
        if plan.vehicle != self.vehicle or plan.cycle < self._newest:
            return None
        if plan.cycle == self._newest and self.plan is not None and plan == self.plan:
            return self._answer(plan, now_ns, None)
        refusal = self._refusal(plan, now_ns)
        self._newest = plan.cycle
        if refusal is None:
            self._follow(plan)
        return self._answer(plan, now_ns, refusal)

    def sense(self, sensing: VehicleSensing) -> None:
        """Follow the vehicle: it leaves, drives on, or has come to the leg's end."""
        leg = self.current
        if leg is None:
            self.state = None
            self.driving = sensing.on_road
            return
        if sensing.on_road:
            at_least = self.state.number if self.driving and self.state is not None else 0
            self.revision += not self.driving
            self.driving = True
            self.state = leg.locate(sensing, at_least)
        elif self.driving and sensing.segment == leg.path[-1]:
            self._arrive(sensing.time_ns)

    def report(self, report: DriverReport, now_ns: int) -> PlanAcknowledgement | None:
        """Take in what the driver says; the answer to the plan if the driver refuses it."""
        plan = self.plan
        if plan is None:
            return None
        if report.event == "refused":
            if self.under_way:
                return None  # its parcels are on board; single stops may fail
            self._forget()
            return self._answer(plan, now_ns, report.reason or "refused by the driver")
        assert report.stop is not None
        if report.event == "arrived":
            if self.driving and report.stop == plan.stops[self.leg + 1].stop:
                self._arrive(report.time_ns)
        elif report.stop in self._visits or report.stop in [s.stop for s in plan.stops[1:-1]]:
            self._end_visit(report)
        return None

    def progress(self, now_ns: int) -> VehicleProgress:
        """What became of the stops of its last tours."""
        cycle = None if self.plan is None else self.plan.cycle
        return VehicleProgress(
            vehicle=self.vehicle, time_ns=now_ns, cycle=cycle, visits=tuple(self._visits.values())
        )

    def skip(self, now_ns: int) -> None:
        """Begin the next leg where it has no road: the next stop is at the same junction."""
        if self.plan is not None and self.current is None:
            self._arrive(now_ns)

    def record(self) -> TourRecord:
        """What a restart needs."""
        return TourRecord(
            plan=self.plan,
            leg=self.leg,
            left_depot=self.under_way,
            driving=self.driving,
            ready_ns=self.ready_ns,
            newest=max(0, self._newest),
            visits=tuple(self._visits.values()),
        )

    def resume(self, record: TourRecord) -> None:
        """Go on from a record; ValueError where it is not of a plan that can be driven by."""
        plan = record.plan
        self._visits = {visit.stop: visit for visit in record.visits}
        self.ready_ns, self._newest = record.ready_ns, record.newest
        if plan is None:
            return
        legs = self._legs_of(plan)
        if plan.vehicle != self.vehicle or record.leg >= len(legs):
            raise ValueError("a record of another tour")
        self.plan, self._legs, self.leg = plan, legs, record.leg
        self._left_depot, self.driving = record.left_depot, record.driving

    def _refusal(self, plan: VehiclePlan, now_ns: int) -> str | None:
        """Why a plan cannot be followed; None: it can."""
        if plan.valid_until_ns <= now_ns:
            return "the plan has lapsed"
        if len(plan.stops) < 2:
            return "the plan has no stop to drive to"
        try:
            legs = self._legs_of(plan)
            for leg in legs:
                if leg is not None:
                    leg.slow  # noqa: B018 - reads all lengths and limits
        except (IndexError, ValueError):
            return "the plan has not the road that is needed to drive by it"
        ended = {v.stop for v in self._visits.values() if v.status == "served"}
        again = [stop.stop for stop in plan.service_stops if stop.stop in ended]
        if again:
            return f"stop {again[0]} is served"
        if not self.under_way:
            followed = None if self.plan is None else self.plan.cycle
            if plan.continues not in (None, followed):
                return f"the vehicle is at its depot and does not follow cycle {plan.continues}"
            if plan.depart_ns < self.ready_ns - _LATE_NS:
                return "its departure was before the vehicle was back"
            return None
        return self._cannot_continue(plan, legs)

    def _cannot_continue(self, plan: VehiclePlan, legs: Sequence[Leg | None]) -> str | None:
        assert self.plan is not None
        if plan.continues != self.plan.cycle:
            return f"the vehicle is under way on the plan of cycle {self.plan.cycle}"
        number = self._number_in(plan)
        if number is None:
            return f"the vehicle left {self.plan.stops[self.leg].stop} last"
        if self.driving:
            if plan.stops[number + 1].stop != self.plan.stops[self.leg + 1].stop:
                return f"the vehicle is on its way to {self.plan.stops[self.leg + 1].stop}"
            leg = legs[number]
            if leg is None or (self.state is not None and self.state.segment not in leg.path):
                return "the vehicle is not on the plan's way"
        return None

    def _number_in(self, plan: VehiclePlan) -> int | None:
        """Number of its present leg in a plan that continues its own: 0, or 1 where the vehicle
        came to a stop while the plan was made; None: it does not fit.
        """
        assert self.plan is not None
        here = self.plan.stops[self.leg].stop
        for number, stop in enumerate(plan.stops[:2]):
            if stop.stop == here and number < len(plan.stops) - 1:
                return number
        return None

    def _follow(self, plan: VehiclePlan) -> None:
        state, driving, under_way = self.state, self.driving, self.under_way
        number = (self._number_in(plan) or 0) if under_way else 0
        self.revision += 1
        self.plan = plan
        self._legs = self._legs_of(plan)
        self.leg = number
        self._left_depot = under_way
        self.state = None
        for stop in plan.stops:
            visit = self._visits.get(stop.stop)
            if visit is not None and visit.status == "failed":
                del self._visits[stop.stop]  # it is tried again
        leg = self._legs[number]
        if driving and leg is not None and state is not None:
            at = leg.path.index(state.segment)
            self.state = replace(state, number=at)

    def _arrive(self, time_ns: int) -> None:
        """At the leg's end; also at each further stop at the same junction."""
        assert self.plan is not None
        self.revision += 1
        self.driving, self.state = False, None
        self._left_depot = True
        self.leg += 1
        self.ready_ns = time_ns
        if self.leg == len(self._legs):
            self._forget()
            return
        if self.plan.stops[self.leg].is_hub:
            return
        self._note(
            Visit(
                stop=self.plan.stops[self.leg].stop,
                status="arrived",
                arrived_ns=time_ns,
                ended_ns=None,
                reason=None,
            )
        )

    def _end_visit(self, report: DriverReport) -> None:
        assert self.plan is not None
        assert report.stop is not None
        known = self._visits.get(report.stop)
        if known is not None and known.status != "arrived":
            return
        self._note(
            Visit(
                stop=report.stop,
                status="served" if report.event == "served" else "failed",
                arrived_ns=report.time_ns if known is None else known.arrived_ns,
                ended_ns=report.time_ns,
                reason=report.reason,
            )
        )
        standing = self.standing_at
        if standing is None or standing.stop != report.stop:
            return
        self.ready_ns = report.time_ns
        if self._legs[self.leg] is None and standing.wait_s == 0:
            self._arrive(report.time_ns)  # the next stop is at the same junction

    def _legs_of(self, plan: VehiclePlan) -> tuple[Leg | None, ...]:
        return legs_of(plan.cycle, plan.segments, len(plan.stops) - 1, self._max_speed_mps)

    def _note(self, visit: Visit) -> None:
        self.revision += 1
        self._visits.pop(visit.stop, None)
        self._visits[visit.stop] = visit
        while len(self._visits) > MAX_VISITS:
            del self._visits[next(iter(self._visits))]

    def _forget(self) -> None:
        self.revision += 1
        self.plan, self._legs, self.leg = None, (), 0
        self._left_depot = False

    def _answer(self, plan: VehiclePlan, now_ns: int, refusal: str | None) -> PlanAcknowledgement:
        return PlanAcknowledgement(
            vehicle=self.vehicle,
            time_ns=now_ns,
            cycle=plan.cycle,
            accepted=refusal is None,
            reason=refusal,
        )
