"""Whether a vehicle is alone, follows another one, or leaves it: from interval to interval; and
whether it goes on believing that one.
"""

from __future__ import annotations

from typing import Final

from slipstream.messages import PlatoonMode
from slipstream.spacing import RESPONSE_S, driver_gap_m
from vehicle_agent.platooning.gap_control import has_left
from vehicle_agent.platooning.join_leave import (
    NONE_AHEAD,
    obstacle,
    too_long,
    turbulent_segment,
)
from vehicle_agent.platooning.needed_braking import EVIDENT_MPS, Told
from vehicle_agent.platooning.neighbours import Neighbours
from vehicle_agent.platooning.situation import Situation, planned_mps2
from vehicle_agent.platooning.speed_commands import on_another_lane

_SETTLE_NS: Final = 2_000_000_000
# A sensor may lose the vehicle ahead for a moment, as where a lane begins.
_DROPOUT_NS: Final = 1_000_000_000
_LANE_CHANGE_NS: Final = 3_000_000_000
_UNPROMISED_NS: Final = 5_000_000_000
_NOT_AGAIN_NS: Final = 30_000_000_000
_NEARER_M: Final = 0.3
_SOFT_MPS2: Final = 0.1


class Membership:
    """A vehicle's mode, and why.

    Attributes:
        mode: alone, following or leaving.
        partner: that it follows or leaves; None: it is alone.
        reason: why a platoon ended or does not form; None: neither.
        disengaged_on: segment whose turbulence it has left for and that still lies ahead.
    """

    def __init__(self) -> None:
        self.mode: PlatoonMode = "alone"
        self.partner: str | None = None
        self.reason: str | None = None
        self.disengaged_on: str | None = None
        self._seen_ns = 0
        self._left_ns = self._parted_ns = self._alone_ns = -_SETTLE_NS
        self._promised_ns = 0
        self._unpromising: tuple[str, int] | None = None

    def has_just_parted(self, now_ns: int) -> bool:
        """Whether it has left a platoon, or was told to end platooning, in the last 2 s."""
        return 0 <= now_ns - self._parted_ns < _SETTLE_NS

    def is_just_alone(self, now_ns: int) -> bool:
        """Whether it has come out of a platoon in the last 2 s."""
        return 0 <= now_ns - self._alone_ns < _SETTLE_NS

    def leave(self, reason: str | None, now_ns: int) -> None:
        """Open the gap from now on."""
        self.mode, self.reason = "leaving", reason
        self._left_ns = self._parted_ns = now_ns

    def end(self, reason: str, now_ns: int) -> None:
        """Note that platooning was ended from outside."""
        self.reason, self._parted_ns = reason, now_ns

    def may_go_on(self, s: Situation, neighbours: Neighbours, behind: int) -> bool:
        """Take the situation in; False: it follows and must leave now, for `reason`.

        Args:
            behind: number of its followers, and of theirs.
        """
        follows = self.mode == "following"
        keeps = follows and s.ahead is not None and s.ahead.vehicle == self.partner
        found = self._obstacle(s, neighbours, keeps=keeps)
        if found is None and s.partner is not None:
            # Of one that has grown too long the last ones leave.
            found = too_long(s, s.partner, neighbours, 0 if keeps else behind)
        if found is None and s.partner is not None:
            self.mode, self.partner = "following", s.partner.vehicle
            self.reason, self._seen_ns = None, s.now_ns
        elif follows:
            if not self._is_merely_hidden(s, found, neighbours):
                self.reason = found
                return False
        elif self.mode == "leaving":
            settled = not 0 <= s.now_ns - self._left_ns < _SETTLE_NS
            if settled and (s.motion is None or has_left(s.own, s.motion)):
                self.mode, self.partner, self._alone_ns = "alone", None, s.now_ns
        else:
            self.reason = None if s.partner is None else found
        return True

    def partners_lane(self, s: Situation, neighbours: Neighbours) -> int | None:
        """The lane of the vehicle that it follows, while both are on one segment and go on alike;
        for a moment also of the one that it has just left: that may have changed its lane.
        """
        front, state = neighbours.get(self.partner), s.state
        if front is None or state.crossing or front.crossing or front.front_m < state.front_m:
            return None
        stays = self.has_just_parted(s.now_ns) and s.gates.is_open(state.segment)
        if self.mode == "leaving" and not stays:
            return None
        alike = front.path[:2] == s.leg.path[state.number : state.number + 2]
        return front.lane if alike else None

    def _is_merely_hidden(self, s: Situation, found: str | None, neighbours: Neighbours) -> bool:
        """Whether its partner, still heard, is not sensed ahead for a moment: a dropout of the
        sensor, or it has told of another lane and is sensed ahead once the vehicle is there too.
        """
        front = neighbours.get(self.partner)
        aside = front is not None and on_another_lane(s, front)
        seen = 0 <= s.now_ns - self._seen_ns < (_LANE_CHANGE_NS if aside else _DROPOUT_NS)
        heard = neighbours.fresh(self.partner, s.now_ns) is not None
        return found == NONE_AHEAD and heard and seen

    def _obstacle(self, s: Situation, neighbours: Neighbours, *, keeps: bool) -> str | None:
        """Why it may not follow the vehicle directly ahead; None: it may."""
        doubt = None if s.ahead is None else neighbours.doubt(s.ahead.vehicle, s.now_ns)
        if doubt is not None:
            return doubt
        rough = turbulent_segment(s)
        if rough is not None:
            if self.mode == "following":
                self.disengaged_on = rough
            return f"the traffic on {rough} is turbulent"
        if self.disengaged_on is not None:
            if self.disengaged_on in s.leg.path[s.state.number :]:
                return f"the traffic on {self.disengaged_on} was turbulent"
            self.disengaged_on = None
        if self.mode != "following" and self.has_just_parted(s.now_ns):
            return self.reason or "it has just parted"
        return obstacle(s, keeps=keeps) or self._unpromised(s)

    def _unpromised(self, s: Situation) -> str | None:
        """Why a follower leaves one that does not promise to brake less hard than it can: behind it
        a driver keeps no larger gap. For a while it does not come again.
        """
        partner = s.partner
        if partner is None:
            return None
        if partner.limit_mps2 is not None or s.wanted_m <= driver_gap_m(s.own.speed_mps):
            self._promised_ns = s.now_ns
            return None
        reason = f"{partner.vehicle} cannot promise a limit of its braking"
        if self._unpromising is not None and self._unpromising[0] == partner.vehicle:
            if 0 <= s.now_ns - self._unpromising[1] < _NOT_AGAIN_NS:
                return reason
            self._unpromising = None
        if self.mode != "following":
            self._promised_ns = s.now_ns
        elif not 0 <= s.now_ns - self._promised_ns < _UNPROMISED_NS:
            self._unpromising = partner.vehicle, s.now_ns
            return reason
        return None


class Trust:
    """Whether the vehicle directly ahead drives what it tells, and by how much later a vehicle is
    that follows it, by what it tells.
    """

    def __init__(self) -> None:
        self._told = Told()
        self._slowed = False

    def doubt(self, s: Situation, time_ns: int, member: Membership) -> str | None:
        """Why the vehicle that it follows is not to be believed from now on; None: it may be.

        Args:
            time_ns: of the own sensing.
        """
        partner, ahead = s.partner, s.ahead
        # In an evaluation's long intervals too little is seen of a second.
        judged = member.mode == "following" and s.own.interval_s <= RESPONSE_S
        if partner is None or ahead is None or not judged:
            self._told.end()
            return None
        planned = planned_mps2(partner, s.partner_age_s, s.own.interval_s)
        measured = partner.acceleration_mps2
        verdict = self._told.update(
            *(time_ns, ahead.track, ahead.speed_mps),
            *(measured if planned is None else planned, measured, partner.limit_mps2),
        )
        if verdict is None or member.partner != partner.vehicle:
            return None
        if verdict == "speeding up":
            nearer = s.gap_m < s.wanted_m - _NEARER_M
            return f"{partner.vehicle} told of speeding up that did not come" if nearer else None
        if verdict == "braking":
            return f"{partner.vehicle} told of braking that did not come"
        return f"{partner.vehicle} braked harder than it promised"

    def cost_s(self, s: Situation, member: Membership) -> float:
        """By how much later it becomes in this interval: by what it is slower than the vehicle
        ahead, from when that has told what asks for less speed than its own, or was left for what
        it told, until it is as fast again.
        """
        motion, own, partner = s.motion, s.own, member.partner
        if motion is None or partner is None:
            return 0.0
        slower_mps = min(motion.speed_mps, own.desired_mps) - own.speed_mps
        if slower_mps < EVIDENT_MPS:
            self._slowed = False
        elif member.mode == "leaving":  # reasons that are its partner's begin with its name
            self._slowed |= (member.reason or "").startswith(f"{partner} ")
        else:
            leader_mps = motion.speed_mps if motion.leader_mps is None else motion.leader_mps
            soft = min(motion.feed_mps2, -motion.slowing_mps2) < -_SOFT_MPS2
            slow = leader_mps < motion.speed_mps - EVIDENT_MPS
            promises = s.partner is not None and s.partner.limit_mps2 is not None
            self._slowed |= soft or slow or (not promises and s.gap_m < s.wanted_m)
        return slower_mps / own.desired_mps * own.interval_s if self._slowed else 0.0
