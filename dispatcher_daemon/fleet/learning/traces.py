"""Traces of drives from positions that come about once a second."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.fleet.learning.passages import DrivenTrace
from slipstream.messages import VehiclePosition
from slipstream.roads import RoadNetwork

STEP_S: Final = 1.0
"""Between a trace's speeds. Energy lost in changes of speed within a second is not seen."""
MAX_GAP: Final = 3
"""Steps between two positions over which a speed is interpolated; after more the trace ends."""
MAX_STEPS: Final = 3600
_DAY_S: Final = 86_400
_S_NS: Final = 10**9


@dataclass
class _TracedDrive:
    """A drive that goes on."""

    begin_ns: int
    trace: DrivenTrace
    route: list[str]


class PositionTraces:
    """One trace a drive without a break: from where a vehicle begins to report on the road to where
    it stands at a stop, is not heard of, or leaves segments out.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._drives: dict[str, _TracedDrive] = {}
        self._ended: list[DrivenTrace] = []

    def add(self, position: VehiclePosition) -> None:
        """The next position of a vehicle; on a segment of the network."""
        drive = self._drives.get(position.vehicle)
        if not position.on_road:
            self._end(position.vehicle)
            return
        if drive is None:
            self._begin(position)
            return
        speeds, last = drive.trace.speeds_mps, len(drive.trace.speeds_mps) - 1
        step = round((position.time_ns - drive.begin_ns) / (STEP_S * _S_NS))
        here, before = position.segment, drive.route[-1]
        follows = here == before or here in self._network.turns(before)
        if step - last > MAX_GAP or step >= MAX_STEPS or not follows:
            self._end(position.vehicle)
            self._begin(position)
            return
        if step <= last:
            return
        for at in range(1, step - last + 1):
            share = at / (step - last)
            speeds.append(speeds[last] + share * (position.speed_mps - speeds[last]))
        if here != before:
            drive.route.append(here)
            drive.trace.entries.append((step, len(drive.route) - 1))

    def take(self) -> list[DrivenTrace]:
        """The traces that have ended since the last call."""
        ended, self._ended = self._ended, []
        return ended

    def _begin(self, position: VehiclePosition) -> None:
        route = [position.segment]
        begin_s = position.time_ns // _S_NS % _DAY_S
        trace = DrivenTrace(float(begin_s), route, [position.speed_mps], [(0, 0)])
        self._drives[position.vehicle] = _TracedDrive(position.time_ns, trace, route)

    def _end(self, vehicle: str) -> None:
        drive = self._drives.pop(vehicle, None)
        # The first and the last segment are no whole passages.
        if drive is not None and len(drive.route) > 2:
            self._ended.append(drive.trace)
