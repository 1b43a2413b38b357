"""Platooning of one vehicle: catch up, join, keep a close gap where gates are open, leave."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

from slipstream.energy.drafting import DragLaw
from slipstream.energy.traction import VehicleParameters
from slipstream.messages import PlatoonControl, PlatoonManagement, VehicleSensing
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning.agreement import MAX_REASON, RENEW_NS, Agreements
from vehicle_agent.platooning.catch_up import (
    DROP_BACK,
    MOTORWAY_MPS,
    closing_slowdown,
    find_catch_up,
)
from vehicle_agent.platooning.control_message import ControlMessages
from vehicle_agent.platooning.gap_control import CLOSE_GAP_M, IDM
from vehicle_agent.platooning.interface import Gates, PlatoonStep
from vehicle_agent.platooning.join_leave import followers, no_waiting_for
from vehicle_agent.platooning.membership import Membership
from vehicle_agent.platooning.neighbours import Heard, Neighbours
from vehicle_agent.platooning.shared_path import MAX_DISTANCE_M
from vehicle_agent.platooning.situation import Situation, look
from vehicle_agent.platooning.speed_commands import (
    announced_mps,
    commanded_mps,
    cruise_mps,
    leading_mps,
    obeys,
)


class Platooning:
    """Platooning of one vehicle, from interval to interval; without clock or bus.

    Two vehicles drive as a platoon where one is directly behind the other on its lane, both go the
    same way, the gates there are open, and the open distance ahead pays for the manoeuvre. The rear
    one decides that; others are asked to wait for it, and told when it leaves. When it leaves:
    docs/platooning.md.

    Args:
        vehicle: its id.
        vehicle_parameters: its physics.
        length_m: of it.
        interval_s: between two steps, and between two messages of every vehicle.
        pace: share of the limit that it drives at alone, in (0, 1].
        drafting: law of its drag reduction, by which it judges what joining saves.
    """

    def __init__(
        self,
        vehicle: str,
        vehicle_parameters: VehicleParameters,
        length_m: float,
        interval_s: float,
        pace: float = 1.0,
        drafting: DragLaw = "paper",
    ) -> None:
        self._vehicle, self._parameters, self._drafting = vehicle, vehicle_parameters, drafting
        self._interval_s, self._pace = interval_s, pace
        self._neighbours = Neighbours(vehicle, interval_s)
        self._agreements = Agreements(vehicle)
        self._controls = ControlMessages(vehicle, length_m)
        self._member = Membership()
        self._lane: int | None = None
        self._drop_back = False
        self._cruise_mps: float | None = None
        self._lead_mps: float | None = None
        self._commanded_mps: float | None = None
        self._now_ns = self._look_ns = 0
        self._requests: dict[str, PlatoonManagement] = {}
        self._platoon: tuple[PlatoonControl, ...] = ()

    @staticmethod
    def segments_of_interest(leg: Leg, state: VehicleState) -> tuple[str, ...]:
        """Segments whose vehicles' PlatoonControl it must hear, in the order of the path, as far
        ahead and behind as a rendezvous may be from anywhere on the present segment: they stay the
        same on it, however long it is.
        """
        first = bisect_left(leg.ends_m, leg.begins_m[state.number] - MAX_DISTANCE_M)
        last = bisect_right(leg.begins_m, leg.ends_m[state.number] + MAX_DISTANCE_M)
        return leg.path[first:last]

    def receive(self, message: PlatoonControl | PlatoonManagement, now_ns: int) -> None:
        """Take a message; those of the future, late, out of order or to others are ignored."""
        if isinstance(message, PlatoonControl):
            self._neighbours.receive(message, now_ns)
        elif self._agreements.admit(message, now_ns):
            self._now_ns = now_ns
            if message.kind == "join_request":
                self._requests[message.vehicle] = message
            elif message.kind == "leave":
                self._other_leaves(message)
            elif not message.accepted:
                self._agreements.joining.refuse(message.vehicle, now_ns)

    def reset(self, reason: str) -> tuple[PlatoonManagement, ...]:
        """End platooning, the plan being superseded or advice at its end: the gap opens at once.
        Returns what partners must be told now.

        While the mode is not yet alone, go on with `step`, on the former leg if there is no other,
        with gates that are closed. It may be called as often as the reason holds.
        """
        agreements = self._agreements
        told = {agreements.joined.by, agreements.joining.asked}
        told |= {heard.message.vehicle for heard in self._followers()}
        if self._member.mode == "following":
            told.add(self._member.partner)
            self._leave(reason, tell=False)
        agreements.joined.end()
        agreements.joining.end()
        self._requests.clear()
        for partner in sorted(name for name in told if name is not None):
            agreements.send(self._now_ns, "leave", partner, reason=reason)
        self._member.end(reason, self._now_ns)
        return agreements.take()

    def step(
        self,
        now_ns: int,
        leg: Leg,
        state: VehicleState,
        sensing: VehicleSensing,
        gates: Gates,
        cap_mps: float | None = None,
    ) -> PlatoonStep:
        """Platooning in the coming interval.

        Args:
            now_ns: by the own clock.
            leg: driven.
            state: where on it.
            sensing: the latest.
            gates: of segments.
            cap_mps: what the rest of the agent allows at the end of the interval, as at a red
                light, not negative; it bounds the command and what is announced. None: nothing.
        """
        self._now_ns = now_ns
        if len(self._neighbours):
            self._neighbours.forget(now_ns)
        self._agreements.joined.expire(now_ns)
        s = look(
            *(now_ns, leg, state, sensing, gates),
            *(self._neighbours, self._parameters, self._pace, self._interval_s),
            *(self._drafting, self._commanded_mps),
        )
        self._platoon = followers(s, self._neighbours, self._vehicle)
        if any(one.vehicle == self._agreements.joined.by for one in self._platoon):
            self._agreements.joined.end()  # it has come
        for one in self._platoon:
            close = s.behind is not None and s.behind.gap_m <= CLOSE_GAP_M
            if s.behind is not None and close and s.behind.vehicle == one.vehicle:
                self._agreements.waits.end_with(one.vehicle)
        self._answer(s)
        if len(self._neighbours) or self._member.mode != "alone" or self._agreements.joining.front:
            self._decide(s)
        cap = math.inf if cap_mps is None else cap_mps
        return self._result(s, cap)

    def _decide(self, s: Situation) -> None:
        due = not 0 < self._look_ns - s.now_ns <= RENEW_NS
        if due:
            self._look_ns = s.now_ns + RENEW_NS
        if due or self._member.mode != "alone":
            self._decide_mode(s)
        if self._member.mode == "alone":
            if due:
                self._catch_up(s)
            return
        self._drop_back = False
        self._lane = self._member.partners_lane(s, self._neighbours)

    def _decide_mode(self, s: Situation) -> None:
        if not self._member.may_go_on(s, self._neighbours):
            self._leave(self._member.reason)
        elif self._member.mode == "following":
            self._agreements.joining.end()
            self._agreements.joined.end()

    def _catch_up(self, s: Situation) -> None:
        """Look for a vehicle to catch up with, and ask it, or its leader, to wait."""
        found, joining, member = None, self._agreements.joining, self._member
        calm = member.disengaged_on is None and not member.has_just_parted(s.now_ns)
        if calm and s.sensing_in_time:
            found = find_catch_up(s, self._vehicle, self._neighbours)
        if found is None:
            joining.end()
            return
        asked = found.asked if joining.may_ask(found.asked, s.now_ns) else None
        self._lane, self._drop_back = found.lane, found.drop_back
        meets = found.rendezvous
        # Who comes behind another one falls back from it: that one must not slow down as well.
        slowdown = 0.0 if found.drop_back else meets.slowdown
        speedup = 0.0 if found.drop_back else meets.speedup
        joining.choose(found.front.vehicle, asked, speedup, slowdown, s.now_ns)
        if asked is not None:
            self._agreements.send(s.now_ns, "join_request", asked, slowdown=slowdown)

    def _answer(self, s: Situation) -> None:
        """Answer who has asked it to wait since the last step, the first one first."""
        agreements, requests = self._agreements, self._requests
        self._requests = {}
        spent = agreements.waits.are_spent(s.now_ns)
        if spent:
            agreements.joined.end()
        for request in requests.values():
            if self._member.mode != "alone":
                reason: str | None = f"it is {self._member.mode}"
            elif spent:
                reason = "it has waited for others for long"
            else:
                reason = no_waiting_for(s, self._neighbours, request.vehicle)
                reason = reason or agreements.joined.ask(request, s.now_ns)
            agreements.send(
                *(s.now_ns, "join_response", request.vehicle),
                accepted=reason is None,
                reason=reason,
            )

    def _other_leaves(self, message: PlatoonManagement) -> None:
        name, agreements = message.vehicle, self._agreements
        if agreements.joined.by == name:
            agreements.joined.end()
        if name in (agreements.joining.front, agreements.joining.asked):
            agreements.joining.end()
        if self._member.mode == "following" and self._member.partner == name:
            self._leave(f"{name} has left")

    def _leave(self, reason: str | None, *, tell: bool = True) -> None:
        self._member.leave(reason, self._now_ns)
        if tell:
            told = {self._member.partner, self._agreements.joining.asked}
            for partner in sorted(name for name in told if name is not None):
                self._agreements.send(self._now_ns, "leave", partner, reason=reason)
        self._agreements.joining.end()

    def _followers(self) -> list[Heard]:
        return [heard for heard in self._neighbours if heard.message.ahead == self._vehicle]

    def _may_be_commanded(self, s: Situation) -> bool:
        """Whether a vehicle alone may be commanded as a leader: on a road without signals, not just
        out of a close gap, and with no vehicle nearer than its driver would let it come. There its
        own model brakes as hard as a vehicle can, and a command would not be bound to that.
        """
        calm = not self._member.is_just_alone(s.now_ns)
        free = s.gap_m > IDM.desired_gap_m(s.state.speed_mps)
        return calm and free and s.leg.limits_mps[s.state.number] > MOTORWAY_MPS

    def _result(self, s: Situation, cap_mps: float) -> PlatoonStep:
        agreements, mode = self._agreements, self._member.mode
        if mode == "alone" and agreements.joining.front is None:
            self._lane, self._drop_back = None, False
        follows = self._neighbours.get(self._member.partner) if mode == "following" else None
        speed = commanded_mps(s, mode, follows, cap_mps)
        cruise = wanted = None
        partner = self._member.partner
        if mode == "alone":
            platoon = self._platoon
            lags = closing_slowdown(s, platoon)
            if agreements.waits.are_spent(s.now_ns):
                lags = 0.0
            waits = max(agreements.joined.slowdown, lags)
            if waits > 0:
                agreements.waits.add(s.own.interval_s)
            if self._drop_back:
                waits = DROP_BACK
            cruise = cruise_mps(s, waits, agreements.joining, self._cruise_mps)
            partner = agreements.joining.front or agreements.joined.by
            if partner is None and lags > 0:
                partner = platoon[0].vehicle
        elif mode == "following":
            wanted = s.own.wanted_gap_m + s.margin_m
        else:
            wanted = IDM.desired_gap_m(s.state.speed_mps)
        self._cruise_mps = cruise
        leads = mode == "alone" and self._may_be_commanded(s) and bool(self._platoon)
        told_mps, lead_mps = speed, None
        if leads:
            set_mps = s.own.desired_mps if cruise is None else cruise
            lead_mps = leading_mps(s, set_mps, cap_mps)
            if obeys(s, self._lead_mps):
                told_mps = lead_mps
        self._lead_mps = lead_mps
        self._commanded_mps = lead_mps if speed is None else speed
        announced = announced_mps(s, told_mps, cap_mps if lead_mps is None else lead_mps)
        control = self._controls.make(
            s, mode, follows, announced, agreements.joined.by, self._platoon
        )
        behind = mode != "alone" and s.ahead is not None and s.ahead.vehicle == self._member.partner
        return PlatoonStep(
            mode=mode,
            speed_mps=speed,
            cruise_mps=cruise,
            lead_mps=lead_mps,
            gap_m=wanted,
            lane=self._lane,
            partner=partner,
            tail_m=control.tail_m,
            close=behind and s.gap_m <= CLOSE_GAP_M,
            reason=None if self._member.reason is None else self._member.reason[:MAX_REASON],
            control=control,
            messages=agreements.take(),
        )
