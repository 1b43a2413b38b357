"""What cycles know of the traffic beside the states: of an hour, learned until now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from dispatcher_daemon.fleet.learning.costs import MovementCosts
from dispatcher_daemon.fleet.learning.history import HOUR_NS, HOURS
from dispatcher_daemon.fleet.learning.usual_traffic import UsualTraffic
from dispatcher_daemon.traffic import Expectations, TrafficSnapshot
from slipstream.messages import VehiclePosition
from slipstream.orders import FleetRecords
from slipstream.roads import RoadNetwork


@dataclass(frozen=True)
class Learned:
    """What was learned of an hour of the day.

    Attributes:
        open_shares: of the states that opened a segment's gate.
        expected: costs of movements; None: too little is known.
    """

    usual_mps: Mapping[str, float] = field(default_factory=dict)
    open_shares: Mapping[str, float] = field(default_factory=dict)
    expected: Expectations | None = None

    def onto(self, snapshot: TrafficSnapshot) -> TrafficSnapshot:
        """A cycle's traffic with it."""
        usual = snapshot.at_usual_speeds(self.usual_mps).with_usual_gates(self.open_shares)
        return replace(usual, expected=self.expected)


class Learning:
    """Learns from the fleet's positions and the states; not safe for threads."""

    def __init__(self, network: RoadNetwork, records: FleetRecords) -> None:
        self._costs = MovementCosts(network, records.movements)
        self._usual = UsualTraffic(network, records.speeds)

    def on_position(self, position: VehiclePosition) -> None:
        """Take in where a tracked vehicle is."""
        self._costs.on_position(position)

    def on_traffic(self, snapshot: TrafficSnapshot) -> None:
        """Take in the traffic of one cycle, which counts what was learned until then."""
        self._usual.on_traffic(snapshot, snapshot.now_ns // HOUR_NS % HOURS)
        self.count_drives()

    def count_drives(self) -> None:
        """Count the drives that have ended, which are kept second by second until then."""
        self._costs.count()

    def learned(self, now_ns: int) -> Learned:
        """What was learned of an hour until now, which nothing is added to."""
        hour = now_ns // HOUR_NS % HOURS
        usual_mps = self._usual.speeds_mps(hour)
        expected = self._costs.expectations(now_ns, usual_mps)
        return Learned(usual_mps, self._usual.open_shares(hour), expected)

    def pending(self, records: FleetRecords) -> FleetRecords:
        """Records to be stored, with what was learned since `stored` was called last."""
        return replace(records, movements=self._costs.pending(), speeds=self._usual.pending())

    def stored(self) -> None:
        """What was pending is in the database."""
        self._costs.stored()
        self._usual.stored()
