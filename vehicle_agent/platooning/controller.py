"""Platooning of one vehicle: catch up, join, keep a close gap where gates are open, leave."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import replace
from typing import Final

from slipstream.messages import PlatoonControl, PlatoonManagement, VehicleSensing
from slipstream.spacing import (
    CLOSE_GAP_M,
    driver_gap_m,
    front_limit_mps2,
    promised_mps2,
)
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning.agreement import MAX_REASON, RENEW_NS, Agreements
from vehicle_agent.platooning.brake_estimate import BrakeEstimate
from vehicle_agent.platooning.catch_up import (
    DROP_BACK,
    MOTORWAY_MPS,
    closing_slowdown,
    farthest_back,
    find_catch_up,
)
from vehicle_agent.platooning.control_message import ControlMessages
from vehicle_agent.platooning.gap_control import COMFORTABLE_MPS2, IDM
from vehicle_agent.platooning.interface import Gates, PlatoonStep
from vehicle_agent.platooning.join_leave import followers, no_waiting_for, too_long
from vehicle_agent.platooning.membership import Membership, Trust
from vehicle_agent.platooning.needed_braking import Evidence
from vehicle_agent.platooning.neighbours import MOST_COST_S, CausedDelays, Heard, Neighbours
from vehicle_agent.platooning.shared_path import MAX_DISTANCE_M
from vehicle_agent.platooning.situation import Commanded, OwnVehicle, Situation, look
from vehicle_agent.platooning.speed_commands import (
    announced_mps,
    command_of,
    commanded,
    cruise_mps,
    held_back,
    leading,
    leading_gap_m,
    obeys,
)

_KEPT_NS: Final = 6_000_000_000
"""A promise holds until its follower is seen apart, and for so long after it was heard last where
it is not seen: opening a close gap to the one that nobody needs to promise takes as long."""

_SIGNAL_S: Final = 20.0
"""A stop line within this time may ask for comfortable braking, which not every promise allows: the
gap of a follower opens in it."""

_AGAIN_SHARE: Final = 1.05
"""Of the gap that a leader needs: so large it has to be before it promises anew."""


class Platooning:
    """Platooning of one vehicle, from interval to interval; without clock or bus.

    Two vehicles drive as a platoon where one is directly behind the other on its lane, both go the
    same way, the gates there are open, and the open distance ahead pays for the manoeuvre. The rear
    one decides that; others are asked to wait for it, and told when it leaves. When it leaves:
    docs/platooning.md.

    Args:
        vehicle: its id.
        length_m: of it.
        own: what it can do.
    """

    def __init__(self, vehicle: str, length_m: float, own: OwnVehicle) -> None:
        self._vehicle, self._own = vehicle, own
        self._brakes = BrakeEstimate(own.braking)
        self._neighbours = Neighbours(vehicle, own.interval_s)
        self._agreements = Agreements(vehicle)
        self._controls = ControlMessages(vehicle, length_m, own.braking.greatest_mps2)
        self._evidence = Evidence()
        self._member = Membership()
        self._trust, self._costs = Trust(), CausedDelays()
        self._distrusts: str | None = None
        self._lane: int | None = None
        self._drop_back = False
        self._cruise_mps: float | None = None
        self._lead_mps: float | None = None
        self._commanded_mps: float | None = None
        self._recent: deque[float] = deque(maxlen=8)
        self._plan: tuple[float, ...] = ()
        self._kept: tuple[float, int] | None = None
        self._kept_for: str | None = None
        self._promises = False
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
        own = self._own
        if self._brakes.share is not None:
            own = replace(own, braking=self._brakes.braking)
        last = Commanded(self._commanded_mps, tuple(self._recent), own.interval_s)
        s = look(
            *(now_ns, leg, state, sensing, gates),
            *(self._neighbours, self._evidence, own, last),
        )
        self._platoon = followers(s, self._neighbours, self._vehicle)
        if any(one.vehicle == self._agreements.joined.by for one in self._platoon):
            self._agreements.joined.end()  # it has come
        for one in self._platoon:
            close = s.behind is not None and s.behind.gap_m <= CLOSE_GAP_M
            if s.behind is not None and close and s.behind.vehicle == one.vehicle:
                self._agreements.waits.end_with(one.vehicle)
        self._answer(s)
        self._distrusts = None
        self._judge(s, sensing.time_ns)
        if len(self._neighbours) or self._member.mode != "alone" or self._agreements.joining.front:
            self._decide(s)
        cap = math.inf if cap_mps is None else cap_mps
        result = self._result(s, cap)
        driven = result.acceleration_mps2
        self._brakes.update(now_ns, sensing.time_ns, state.speed_mps, driven)
        return result

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

    def _judge(self, s: Situation, time_ns: int) -> None:
        """Leave who tells what it does not drive."""
        doubt = self._trust.doubt(s, time_ns, self._member)
        if doubt is not None and self._member.partner is not None:
            self._distrust(self._member.partner, doubt, s.now_ns)
        self._charge(self._member.partner, self._trust.cost_s(s, self._member), s.now_ns)

    def _charge(self, vehicle: str | None, seconds: float, now_ns: int) -> None:
        """Count by how much later another vehicle makes this one, and have done with it then."""
        if vehicle is None or seconds <= 0 or not self._costs.add(vehicle, seconds, now_ns):
            return
        if self._neighbours.doubt(vehicle, now_ns) is None:
            reason = f"{vehicle} has slowed it down by {MOST_COST_S:g} s within an hour"
            self._distrust(vehicle, reason, now_ns)

    def _distrust(self, vehicle: str, reason: str, now_ns: int) -> None:
        self._distrusts = reason
        self._neighbours.ignore(vehicle, reason, now_ns)
        if self._agreements.joined.by == vehicle:
            self._agreements.joined.end()
        if self._member.mode == "following" and self._member.partner == vehicle:
            self._leave(reason)

    def _decide_mode(self, s: Situation) -> None:
        if not self._member.may_go_on(s, self._neighbours, len(self._platoon)):
            self._leave(self._member.reason)
        elif self._member.mode == "following":
            self._agreements.joining.end()
            self._agreements.joined.end()

    def _catch_up(self, s: Situation) -> None:
        """Look for a vehicle to catch up with, and ask it, or its leader, to wait."""
        found, joining, member = None, self._agreements.joining, self._member
        calm = member.disengaged_on is None and not member.has_just_parted(s.now_ns)
        if calm and s.sensing_in_time:
            found = find_catch_up(s, self._vehicle, self._neighbours, len(self._platoon))
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

    @property
    def limit_mps2(self) -> float | None:
        """The hardest braking that others reckon with; None: they reckon with all it can do."""
        return None if self._kept is None else self._kept[0]

    @property
    def braking_share(self) -> float | None:
        """Of the declared deceleration, what its brakes do; None: as much, or not known."""
        return self._brakes.share

    def _keep_promise(self, s: Situation) -> None:
        """What the follower needs, if there is one, holds until it is apart."""
        direct = [one for one in self._platoon if one.ahead == self._vehicle]
        needs = [(one.needs_mps2, one.vehicle) for one in direct if one.needs_mps2 is not None]
        if needs:
            needed, self._kept_for = min(needs)
            self._kept = promised_mps2(needed, s.own.braking), s.now_ns
        elif self._kept is not None:
            seen = s.behind is not None and s.behind.vehicle == self._kept_for
            apart = s.behind is not None and s.behind.gap_m > driver_gap_m(s.own.speed_mps)
            if apart or not (seen or 0 <= s.now_ns - self._kept[1] <= _KEPT_NS):
                self._kept = None

    def _may_promise(self, s: Situation) -> bool:
        """Whether it can keep what its follower needs: a follower, while the one ahead promises
        too, and the platoon is not too long for its brakes; a leader, where it is commanded, far
        enough from the traffic ahead, and from signals where it may have to brake harder.
        """
        limit = self.limit_mps2
        if limit is None:
            return False
        if self._member.mode == "following":
            if s.partner is None or s.partner.limit_mps2 is None:
                return False
            return too_long(s, s.partner, self._neighbours, len(self._platoon)) is None
        if self._member.mode != "alone" or not s.gates.is_open(s.state.segment):
            return False
        if s.own.braking.commanded_mps2(limit) < COMFORTABLE_MPS2:
            line = s.leg.next_line(s.place_m)
            if line is not None and line.at_m - s.place_m < _SIGNAL_S * s.own.speed_mps:
                return False
        needed_m = leading_gap_m(s, limit) * (1.0 if self._promises else _AGAIN_SHARE)
        return self._may_be_commanded(s) and s.gap_m >= needed_m

    def _may_be_commanded(self, s: Situation) -> bool:
        """Whether a vehicle alone may be commanded as a leader: while it keeps a promise, and on a
        road without signals, not just out of a close gap, and with no vehicle nearer than its
        driver would let it come. There its own model brakes as hard as a vehicle can, and a command
        would not be bound to that.
        """
        if not s.sensing_in_time:
            return False
        if self._kept is not None:
            return True
        calm = not self._member.is_just_alone(s.now_ns)
        free = s.gap_m > IDM.desired_gap_m(s.state.speed_mps)
        return calm and free and s.leg.limits_mps[s.state.number] > MOTORWAY_MPS

    def _result(self, s: Situation, cap_mps: float) -> PlatoonStep:
        agreements, mode = self._agreements, self._member.mode
        if mode == "alone" and agreements.joining.front is None:
            self._lane, self._drop_back = None, False
        follows = self._neighbours.get(self._member.partner) if mode == "following" else None
        self._keep_promise(s)
        self._promises = self._may_promise(s)
        limit = self.limit_mps2
        command = commanded(s, mode, follows, cap_mps, limit)
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
                by = agreements.joined.by or farthest_back(platoon)
                self._charge(by, waits * s.own.interval_s, s.now_ns)
            if self._drop_back:
                waits = DROP_BACK
                self._charge(agreements.joining.front, waits * s.own.interval_s, s.now_ns)
            self._charge(self._kept_for, held_back(s, limit) * s.own.interval_s, s.now_ns)
            cruise = cruise_mps(s, waits, agreements.joining, self._cruise_mps)
            partner = agreements.joining.front or agreements.joined.by
            if partner is None and lags > 0:
                partner = platoon[0].vehicle
        elif mode == "following":
            wanted = s.wanted_m
        else:
            wanted = IDM.desired_gap_m(s.state.speed_mps)
        self._cruise_mps = cruise
        leads = mode == "alone" and self._may_be_commanded(s)
        leads = leads and (bool(self._platoon) or self._kept is not None)
        lead = None
        if leads:
            set_mps = s.own.desired_mps if cruise is None else cruise
            self._plan = leading(s, self._plan[1:], set_mps, cap_mps, limit)
            lead = command_of(s, self._plan)
        else:
            self._plan = () if command is None else (command.mps2,)
        now = command or (lead if lead is not None and obeys(s, self._lead_mps) else None)
        self._lead_mps = None if lead is None else lead.mps
        driven = command or lead
        self._commanded_mps = None if driven is None else driven.mps
        self._recent.append(0.0 if driven is None else driven.mps2)
        announced = announced_mps(
            s, None if now is None else now.mps, cap_mps if lead is None else lead.mps
        )
        control = self._controls.make(
            *(s, mode, follows, announced, agreements.joined.by, self._platoon),
            planned_mps2=() if now is None else self._plan,
            limit_mps2=limit if self._promises else None,
            needs_mps2=self._needs(s, limit),
        )
        behind = mode != "alone" and s.ahead is not None and s.ahead.vehicle == self._member.partner
        return PlatoonStep(
            mode=mode,
            speed_mps=None if command is None else command.mps,
            cruise_mps=cruise,
            lead_mps=None if lead is None else lead.mps,
            acceleration_mps2=None if driven is None else driven.mps2,
            gap_m=wanted,
            lane=self._lane,
            partner=partner,
            tail_m=control.tail_m,
            close=behind and s.gap_m <= CLOSE_GAP_M,
            reason=None if self._member.reason is None else self._member.reason[:MAX_REASON],
            control=control,
            messages=agreements.take(),
            distrusts=self._distrusts,
        )

    def _needs(self, s: Situation, limit_mps2: float | None) -> float | None:
        """Limit that the vehicle ahead has to promise for a close gap; None: it keeps none."""
        if self._member.mode != "following" or not s.own.braking.emergency_brake:
            return None
        own = s.own
        return front_limit_mps2(own.advised_gap_m, own.braking, limit_mps2, own.interval_s)
