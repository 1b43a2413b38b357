"""What vehicles of a type save by their places in platoons, by segment."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning.reductions import planned_reductions
from dispatcher_daemon.planning.roads import planning_speed_mps
from dispatcher_daemon.traffic import GateForecast, SegmentTraffic, TrafficSnapshot
from slipstream.energy.consumption import drag_saving_kwh
from slipstream.roads import Segment
from slipstream.vehicle_types import RoutingProfile

ALWAYS_OPEN: Final = GateForecast(open=True)


@dataclass(frozen=True)
class Shares:
    """Energy that one vehicle saves on one segment while its gate is open, kWh.

    Attributes:
        leader_kwh: in front of any number of followers.
        follower_kwh: behind a leader, as the only follower.
        longer_kwh: in a platoon of three and more, between two others and as the last one; None:
            as the only follower, each.
        gate: of the segment. Savings count with the chance that it is open when they begin.
    """

    leader_kwh: float
    follower_kwh: float
    longer_kwh: tuple[float, float] | None = None
    gate: GateForecast = ALWAYS_OPEN

    def at(self, number: int, members: int) -> float:
        """Saving at one place.

        Args:
            number: 0 is the leader.
        """
        if number == 0:
            return self.leader_kwh
        if members == 2 or self.longer_kwh is None:
            return self.follower_kwh
        middle_kwh, last_kwh = self.longer_kwh
        return last_kwh if number == members - 1 else middle_kwh

    def following_kwh(self, entry_s: float) -> float:
        """Saving of an only follower, with the chance that the gate is open at its entry."""
        return self.follower_kwh * self.gate.chance(entry_s)

    def followings_kwh(self, entries_s: Sequence[float]) -> array[float]:
        """`following_kwh` of each of some entries."""
        if self.gate.usual_share is None:
            return array("d", [self.following_kwh(0.0)]) * len(entries_s)
        return array("d", [self.following_kwh(entry_s) for entry_s in entries_s])

    def platoon_kwh(self, members: int) -> float:
        """Saving of a platoon of at least two vehicles that all have these shares."""
        if members == 2 or self.longer_kwh is None:
            return self.leader_kwh + (members - 1) * self.follower_kwh
        middle_kwh, last_kwh = self.longer_kwh
        return self.leader_kwh + (members - 2) * middle_kwh + last_kwh


def open_shares(
    problem: RoutingProblem, snapshot: TrafficSnapshot, profile: RoutingProfile | None = None
) -> dict[str, Shares]:
    """Shares of all segments whose gate is open, or may be later on.

    Args:
        profile: of the vehicles; None: the fleet's first.
    """
    of = problem.profiles[0] if profile is None else profile

    def shares(segment: Segment, traffic: SegmentTraffic) -> Shares:
        speed = planning_speed_mps(segment, traffic, of)
        leader, follower, middle, last = planned_reductions(problem, of, speed)

        def saving(eta: float) -> float:
            return drag_saving_kwh(segment.length_m, speed, eta, of.physics)

        longer = None if middle == last == follower else (saving(middle), saving(last))
        return Shares(saving(leader), saving(follower), longer, traffic.gate)

    return {
        name: shares(problem.network.segments[name], traffic)
        for name, traffic in snapshot.segments.items()
        if traffic.gate.may_be_open
    }
