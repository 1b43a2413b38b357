"""The platoon control message of a vehicle, and the length of its platoon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from slipstream.messages import PlatoonControl, PlatoonMode
from slipstream.spacing import CLOSE_GAP_M
from vehicle_agent.leg import Leg
from vehicle_agent.platooning.situation import Situation

_MAX_SEGMENTS: Final = 64
_MAX_TAIL_M: Final = 1000.0


class ControlMessages:
    """Makes a vehicle's platoon control messages."""

    def __init__(self, vehicle: str, length_m: float, greatest_mps2: float) -> None:
        self._vehicle, self._length_m = vehicle, length_m
        self._greatest_mps2 = greatest_mps2
        self._sequence = 0
        self._path: tuple[str, ...] = ()
        self._path_of: tuple[Leg, int] | None = None

    def make(
        self,
        situation: Situation,
        mode: PlatoonMode,
        ahead: PlatoonControl | None,
        announced_mps: float,
        joined_by: str | None,
        platoon: Sequence[PlatoonControl],
        planned_mps2: tuple[float, ...] = (),
        limit_mps2: float | None = None,
        needs_mps2: float | None = None,
    ) -> PlatoonControl:
        """The next message.

        Args:
            situation: now.
            mode: of the vehicle.
            ahead: last message of the vehicle that it follows; None: it follows none.
            announced_mps: its speed at the end of the interval.
            joined_by: whom it waits for.
            platoon: of its followers.
            planned_mps2: that it is commanded for the coming intervals.
            limit_mps2: that it promises.
            needs_mps2: that the vehicle ahead has to promise.
        """
        s, state = situation, situation.state
        leader = self._vehicle
        if ahead is not None:
            leader = ahead.leader if ahead.leader != self._vehicle else ahead.vehicle
        sensed = ahead is not None and s.ahead is not None and s.ahead.vehicle == ahead.vehicle
        message = PlatoonControl(
            vehicle=self._vehicle,
            sequence=self._sequence,
            time_ns=s.now_ns,
            path=self._path_from(s.leg, state.number),
            crossing=state.crossing,
            lane=state.lane,
            front_m=state.front_m,
            length_m=self._length_m,
            speed_mps=state.speed_mps,
            acceleration_mps2=state.acceleration_mps2,
            announced_mps=announced_mps,
            desired_mps=s.own.desired_mps,
            mode=mode,
            ahead=None if ahead is None else ahead.vehicle,
            leader=leader,
            joined_by=joined_by,
            tail_m=self._tail_m(platoon),
            greatest_mps2=self._greatest_mps2,
            planned_mps2=planned_mps2,
            limit_mps2=limit_mps2,
            needs_mps2=needs_mps2,
            gap_m=s.gap_m if sensed else None,
            platoon=s.planned.platoon,
            place=s.planned.place,
        )
        self._sequence += 1
        return message

    def _path_from(self, leg: Leg, number: int) -> tuple[str, ...]:
        if self._path_of is None or self._path_of[0] is not leg or self._path_of[1] != number:
            self._path, self._path_of = leg.path[number : number + _MAX_SEGMENTS], (leg, number)
        return self._path

    def _tail_m(self, platoon: Sequence[PlatoonControl]) -> float:
        """From its front to the rear of its last follower in a close gap."""
        behind_m = max(
            (
                max(0.0, m.gap_m) + m.tail_m
                for m in platoon
                if m.ahead == self._vehicle and m.gap_m is not None and m.gap_m <= CLOSE_GAP_M
            ),
            default=0.0,
        )
        return self._length_m + min(behind_m, _MAX_TAIL_M)
