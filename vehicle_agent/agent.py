"""The agent of one vehicle as a pure object: messages and sensing in, advice and messages out.

Time is what the caller says, so that the same code runs on the bus and in a simulated day. What
ends close gaps: docs/architecture.md, "A vehicle's way".
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from slipstream import freshness
from slipstream.braking import BRAKING, HARDEST_MPS2, UNKNOWN_ROAD, Braking
from slipstream.energy.drafting import DragLaw
from slipstream.energy.traction import PAPER_CAR, VehicleParameters
from slipstream.messages import (
    AdviceMode,
    DriverReport,
    Message,
    PlatoonControl,
    PlatoonManagement,
    PlatoonMode,
    SegmentState,
    SignalPhaseAndTiming,
    SignalStatus,
    VehicleAdvice,
    VehiclePlan,
    VehicleSensing,
    acknowledgement_key,
    plan_key,
    platoon_control_key,
    platoon_controls_on,
    platoon_management_key,
    platoon_managements_to,
    segment_states_key,
    signal_request_key,
    signal_status_key,
    spat_key,
)
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import COMFORTABLE_MPS2, DELAY_S, OwnVehicle, Platooning, PlatoonStep
from vehicle_agent.reports import Outgoing, Reports
from vehicle_agent.roadside import CLOSED, Roadside
from vehicle_agent.signals import (
    HORIZON_M,
    LegDeparture,
    SignalRequests,
    SignalTimings,
    intersections_ahead,
)
from vehicle_agent.speed import HARD_MPS2, SpeedAdvisor, ceiling
from vehicle_agent.tour import Tour

VALID_NS: Final = 500_000_000
CLOSE_VALID_NS: Final = 250_000_000
"""In a close gap: two intervals, and what a message may be late."""
CLOCK_ERROR_S: Final = 0.1
"""Largest error of a clock that platooning trusts."""

_SENSING_AGE_S: Final = 0.5


DEFAULT_LENGTH_M: Final = 4.6


_UNKNOWN_BRAKING: Final = BRAKING["truck"].on(UNKNOWN_ROAD)


@dataclass(frozen=True)
class AgentParameters:
    """What an agent knows of its vehicle.

    Attributes:
        length_m: bumper to bumper.
        max_speed_mps: it drives no faster; None: as fast as the roads allow.
        interval_s: from one advice to the next.
        stale_after_s: age limit of a SegmentState.
        drafting: law of its drag reduction.
        braking: on the road as it is.
        others_mps2: the most that any vehicle brakes with on that road.
    """

    vehicle: VehicleParameters = PAPER_CAR
    length_m: float = DEFAULT_LENGTH_M
    max_speed_mps: float | None = None
    interval_s: float = 0.1
    stale_after_s: float = freshness.STALE_AFTER_S
    drafting: DragLaw = "paper"
    braking: Braking = _UNKNOWN_BRAKING
    others_mps2: float = HARDEST_MPS2[UNKNOWN_ROAD]


class Agent:
    """One vehicle's agent; agents of one process may share signal timings and roadside states."""

    def __init__(
        self,
        vehicle: str,
        parameters: AgentParameters | None = None,
        timings: SignalTimings | None = None,
        roadside: Roadside | None = None,
    ) -> None:
        own = parameters or AgentParameters()
        self.vehicle = vehicle
        self.tour = Tour(vehicle, own.max_speed_mps)
        self._timings = timings or SignalTimings()
        self._roadside = roadside or Roadside(own.stale_after_s)
        self._platooning = Platooning(
            vehicle,
            own.length_m,
            OwnVehicle(
                own.vehicle, own.braking, own.others_mps2, own.interval_s, 1.0, own.drafting
            ),
        )
        self._braking = own.braking
        self._speed = SpeedAdvisor(self._timings, own.interval_s, own.vehicle)
        self._requests = SignalRequests(vehicle, self._timings)
        self._departure = LegDeparture(self._timings, own.vehicle)
        self._interval_s = own.interval_s
        self._mode: PlatoonMode = "alone"
        self._tail_m = 0.0
        self._begun: Leg | None = None
        self._green_at: str | None = None
        self._reports = Reports(vehicle)
        self._outgoing: list[Outgoing] = []
        self.distrusts: str | None = None
        self._topics: tuple[object, frozenset[str]] | None = None

    def take_outgoing(self) -> list[Outgoing]:
        """Keys and messages to send, in order."""
        sent, self._outgoing = self._outgoing, []
        return sent

    def topics(self) -> frozenset[str]:
        """Key expressions that it listens to now; they follow the vehicle."""
        leg, state = self.tour.current, self.tour.state
        place = (leg, None if state is None else state.number)
        if self._topics is None or self._topics[0] != place:
            self._topics = place, self._listen(leg, state)
        return self._topics[1]

    def receive(self, message: Message, now_ns: int) -> None:
        """Take in a message from the bus, or the vehicle's driver; what is for others, late or of
        no use is left out.
        """
        match message:
            case PlatoonControl() | PlatoonManagement():
                self._platooning.receive(message, now_ns)
            # One that is dated ahead would keep out those that come once its clock is set.
            case SegmentState() if not freshness.is_ahead(message.time_ns, now_ns):
                self._roadside.receive(message)
            case SignalPhaseAndTiming() if not freshness.is_ahead(message.time_ns, now_ns):
                self._timings.receive(message)
            case SignalStatus():
                self._note_status(message)
            case VehiclePlan():
                self._take_plan(message, now_ns)
            case DriverReport():
                answer = self.tour.report(message, now_ns)
                if answer is not None:
                    self._send(acknowledgement_key(self.vehicle), answer)
                self._outgoing += self._reports.progress(self.tour, now_ns)

    def advise(self, sensing: VehicleSensing, now_ns: int) -> VehicleAdvice:
        """The advice for the coming control interval by the latest sensing; called once an
        interval.
        """
        tour, self.distrusts = self.tour, None
        before = (tour.leg, tour.driving, tour.plan is None)
        tour.sense(sensing)
        if not sensing.on_road and tour.plan is not None and tour.current is None:
            due_ns = tour.due_ns()
            if due_ns is not None and due_ns <= now_ns:
                tour.skip(now_ns)
        changed = before != (tour.leg, tour.driving, tour.plan is None)
        share = self._platooning.braking_share
        self._outgoing += self._reports.due(tour, sensing, now_ns, share, changed=changed)
        if not sensing.on_road:
            return self._standing(sensing, now_ns)
        return self._driving(sensing, now_ns)

    def _listen(self, leg: Leg | None, state: VehicleState | None) -> frozenset[str]:
        wanted = {plan_key(self.vehicle), platoon_managements_to(self.vehicle)}
        if leg is None:
            return frozenset(wanted)
        if state is None:  # the departure second depends on all signals of the leg
            near, ahead = intersections_ahead(leg, 0.0, leg.length_m), leg.path
        else:
            begin_m, length_m = leg.begins_m[state.number], leg.lengths_m[state.number]
            near = intersections_ahead(leg, begin_m, HORIZON_M + length_m)
            ahead = leg.path[state.number :]
            around = self._platooning.segments_of_interest(leg, state)
            wanted.update(platoon_controls_on(segment) for segment in around)
        wanted.update(spat_key(name) for name in near)
        wanted.update(signal_status_key(name) for name in near)
        wanted.update(segment_states_key(segment) for segment in ahead)
        return frozenset(wanted)

    def _take_plan(self, plan: VehiclePlan, now_ns: int) -> None:
        answer = self.tour.offer(plan, now_ns)
        if answer is None:
            return
        self._send(acknowledgement_key(self.vehicle), answer)
        if not answer.accepted and self.tour.plan is not None:
            self._end_platooning("the plan is superseded by one that cannot be followed")

    def _note_status(self, status: SignalStatus) -> None:
        for request in status.requests:
            if request.vehicle == self.vehicle and request.status == "rejected":
                self._green_at = None

    def _standing(self, sensing: VehicleSensing, now_ns: int) -> VehicleAdvice:
        self._end_platooning("the leg has ended")
        self._speed.end()
        self._begun = None
        self._end_requests(now_ns)
        due_ns = self.tour.due_ns()
        leg, plan = self.tour.current, self.tour.plan
        if plan is None:
            return self._advice(now_ns, "none", text="No plan.", reason="no plan")
        if due_ns is None or leg is None:
            stop = self.tour.standing_at
            where = "" if stop is None else f" {stop.stop}"
            return self._advice(now_ns, "none", text=f"Serve{where}.")
        depart_ns = due_ns
        if due_ns <= now_ns:
            slack_ns = self.tour.slack_ns(due_ns)
            depart_ns = self._departure.second_ns(leg, plan.advice, now_ns, slack_ns)
        seconds = max(0, round((depart_ns - now_ns) / 1e9))
        text = f"Leave in {seconds} s." if seconds else "Leave now."
        return self._advice(now_ns, "none", depart_ns=depart_ns, text=text)

    def _driving(self, sensing: VehicleSensing, now_ns: int) -> VehicleAdvice:
        leg, state, plan = self.tour.current, self.tour.state, self.tour.plan
        if leg is None or state is None or plan is None:
            self._end_platooning("off the planned way")
            self._end_requests(now_ns)
            return self._advice(
                now_ns, "none", text="No advice: off the planned way.", reason="off the planned way"
            )
        if leg is not self._begun:
            self._speed.begin(leg, plan.advice)
            self._begun = leg
        self._roadside.at(now_ns)
        now_s = now_ns / 1e9
        # In a close gap it is platooning that keeps the gap safe.
        ahead = sensing.ahead if self._mode == "alone" else None
        limit = self._platooning.limit_mps2 if self._mode == "alone" else None
        if limit is None:
            top = ceiling(leg, state, self._timings, now_s, self._interval_s, ahead)
        else:  # what a leader is commanded now, it drives after those that it has told
            later_s = self._interval_s + DELAY_S
            hard = min(HARD_MPS2, self._braking.commanded_mps2(limit))
            top = ceiling(leg, state, self._timings, now_s, later_s, ahead, hard)
        doubt = _clock_doubt(sensing, now_ns)
        distrust = doubt or _distrust(plan, now_ns, signal_unknown=top.signal_unknown)
        share = self._platooning.braking_share
        if distrust is None and share is not None:
            distrust = f"it brakes with {share:.0%} of what is declared"
        if distrust is not None:
            self._end_platooning(distrust)
        alone = self._mode == "alone" and doubt is None
        cap = None
        if alone:
            cap = self._speed.cap_mps(now_s, state, sensing.ahead, self._tail_m)
        step = self._platooning.step(
            now_ns,
            leg,
            state,
            sensing,
            self._roadside if distrust is None else CLOSED,
            cap_mps=top.speed_mps if cap is None else min(cap, top.speed_mps),
        )
        self._mode, self._tail_m, self.distrusts = step.mode, step.tail_m, step.distrusts
        self._send(platoon_control_key(step.control.path[0], self.vehicle), step.control)
        self._send_all(step.messages)
        if step.speed_mps is not None:
            mode: AdviceMode = "follow" if step.mode == "following" else "open_gap"
            return self._advice(now_ns, mode, step.speed_mps, step=step)
        if doubt is not None:
            self._end_requests(now_ns)
            return self._advice(now_ns, "none", text=f"No advice: {doubt}.", reason=doubt)
        if not alone:
            cap = self._speed.cap_mps(now_s, state, sensing.ahead, step.tail_m)
        if plan.advice.signal_priority:
            self._ask(now_s, leg, state, step.tail_m)
        if step.lead_mps is not None and not top.signal_unknown:
            return self._advice(now_ns, "speed", step.lead_mps, step=step)
        set_mps = leg.limits_mps[state.number]
        if step.cruise_mps is not None:
            set_mps = min(set_mps, step.cruise_mps)
        if cap is None or top.signal_unknown:  # the driver alone sees what the signal shows
            return self._advice(now_ns, "cruise", min(set_mps, top.speed_mps), step=step)
        wanted_mps = min(cap, set_mps, top.speed_mps)
        advised_mps = self._ahead_of_response(state.speed_mps, wanted_mps)
        return self._advice(now_ns, "speed", advised_mps, step=step)

    def _ahead_of_response(self, speed_mps: float, wanted_mps: float) -> float:
        """The speed to advise for one that is wanted at the end of the interval. A vehicle comes to
        an advised speed within twice its response: told the wanted one alone it would slow down by
        a part only, again and again.
        """
        loop_s = 2 * self._braking.nominal_s + self._braking.lag_s
        if wanted_mps >= speed_mps or loop_s <= self._interval_s:
            return wanted_mps
        change_mps = max(wanted_mps - speed_mps, -COMFORTABLE_MPS2 * self._interval_s)
        return max(0.0, min(wanted_mps, speed_mps + change_mps * loop_s / self._interval_s))

    def _end_platooning(self, reason: str) -> None:
        self._send_all(self._platooning.reset(reason))

    def _send_all(self, messages: Iterable[PlatoonManagement]) -> None:
        for message in messages:
            self._send(platoon_management_key(message.partner, self.vehicle), message)

    def _ask(self, now_s: float, leg: Leg, state: VehicleState, tail_m: float) -> None:
        for request in self._requests.step(now_s, leg, state, tail_m):
            asks = request.kind != "priorityCancellation"
            self._green_at = request.intersection if asks else None
            self._send(signal_request_key(request.intersection, self.vehicle), request)

    def _end_requests(self, now_ns: int) -> None:
        self._green_at = None
        for request in self._requests.end(now_ns / 1e9):
            self._send(signal_request_key(request.intersection, self.vehicle), request)

    def _advice(
        self,
        now_ns: int,
        mode: AdviceMode,
        speed_mps: float | None = None,
        *,
        step: PlatoonStep | None = None,
        depart_ns: int | None = None,
        text: str | None = None,
        reason: str | None = None,
    ) -> VehicleAdvice:
        plan = self.tour.plan
        close = mode in ("follow", "open_gap")
        accelerates = step is not None and (close or speed_mps == step.lead_mps)
        limit = self._platooning.limit_mps2
        return VehicleAdvice(
            vehicle=self.vehicle,
            time_ns=now_ns,
            valid_until_ns=now_ns + (CLOSE_VALID_NS if close else VALID_NS),
            acceleration_mps2=step.acceleration_mps2 if step and accelerates else None,
            least_mps2=None if limit is None else -limit,
            fallback_mps2=COMFORTABLE_MPS2 if close else None,
            cycle=None if plan is None else plan.cycle,
            leg=None if plan is None else self.tour.leg,
            mode=mode,
            speed_mps=speed_mps,
            gap_m=None if step is None else step.gap_m,
            lane=None if step is None else step.lane,
            partner=None if step is None else step.partner or step.control.joined_by,
            depart_ns=depart_ns,
            green_at=self._green_at,
            text=text or _text(mode, speed_mps, step),
            reason=reason or (None if step is None else step.reason),
        )

    def _send(self, key: str, message: Message) -> None:
        self._outgoing.append((key, message))


def _clock_doubt(sensing: VehicleSensing, now_ns: int) -> str | None:
    """Why no advice can be given; None: nothing speaks against it."""
    age_s = freshness.age_s(sensing.time_ns, now_ns)
    if sensing.clock_error_s > CLOCK_ERROR_S or not -CLOCK_ERROR_S <= age_s <= _SENSING_AGE_S:
        return "the clock is in doubt"
    return None


def _distrust(plan: VehiclePlan, now_ns: int, *, signal_unknown: bool) -> str | None:
    """Why there may be no close gaps, though advice goes on; None: nothing speaks against them."""
    if plan.valid_until_ns <= now_ns:
        return "the plan has lapsed"
    if plan.issued_ns > now_ns + round(freshness.FUTURE_TOLERANCE_S * 1e9):
        return "the plan is dated ahead of the clock"
    return "the signal ahead tells nothing" if signal_unknown else None


def _text(mode: AdviceMode, speed_mps: float | None, step: PlatoonStep | None) -> str:
    """The advice in words for the driver."""
    speed = "" if speed_mps is None else f"{3.6 * speed_mps:.0f} km/h"
    partner = None if step is None else step.partner
    match mode:
        case "follow":
            gap = "" if step is None or step.gap_m is None else f", gap {step.gap_m:.1f} m"
            return f"Following {partner}, {speed}{gap}."
        case "open_gap":
            return f"Opening the gap, {speed}."
        case "speed":
            return f"Drive {speed}."
        case "cruise" if partner is not None:
            return f"Up to {speed}: {partner} joins."
        case _:
            return f"Up to {speed}."
