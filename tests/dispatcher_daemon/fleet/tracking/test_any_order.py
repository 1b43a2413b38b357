"""Messages lost, late and repeated, dispatchers that restart, drivers that refuse: in any order no
order is lost, delivered twice or in two vehicles' hands.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

from dispatcher_daemon.fleet import Fleet, fleet_from
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.traffic.snapshot import SegmentTraffic, TrafficSnapshot
from slipstream.roads import RoadNetwork, Segment, build_network

from .fleet_drive import Day, S, Van

NOW_NS = 1_800_000_000_000_000_000
NODES = ("11", "22", "21", "02", "20")
VANS = ("van-0", "van-1", "van-2")


def town() -> RoadNetwork:
    """Three by three junctions, both ways."""
    at = {f"{x}{y}": (300.0 * x, 300.0 * y) for x in range(3) for y in range(3)}
    near = [
        (a, b)
        for a in at
        for b in at
        if abs(int(a[0]) - int(b[0])) + abs(int(a[1]) - int(b[1])) == 1
    ]
    roads = [Segment(f"{a}-{b}", a, b, 300.0, 13.89, 1, (at[a], at[b])) for a, b in near]
    return build_network("town", roads, at)


TOWN = town()
TRAFFIC = {
    s.id: SegmentTraffic(s.id, s.speed_limit_mps, y_e=1, open=True, reason=None, age_s=1.0)
    for s in TOWN.segments.values()
}


def file_of(stops: list[dict[str, Any]]) -> Fleet | None:
    """The fleet's file with these stops; None: without any."""
    if not stops:
        return None
    data = {
        "depots": [{"id": "depot", "node": "00"}],
        "stops": stops,
        "vehicles": [{"id": name, "capacity": 2} for name in VANS],
    }
    return fleet_from(data, TOWN, "town")


class AnyOrder(RuleBasedStateMachine):
    """A dispatcher and three vans, one of which sends nothing but positions."""

    @initialize()
    def begin(self) -> None:
        """Two orders, all vans at home."""
        self.stops: list[dict[str, Any]] = []
        self.names = 0
        self.removed: set[str] = set()
        self.add("11")
        self.add("22")
        fleet = file_of(self.stops)
        assert fleet is not None
        vans = {name: Van(name, "00-01", talks=name != "van-2") for name in VANS}
        snapshot = TrafficSnapshot(NOW_NS, TRAFFIC, ())
        self.day = Day(RoutingProblem(TOWN, fleet), snapshot, vans, fleet)
        # A van that is never heard of before it leaves cannot be told from one without telemetry.
        self.day.drive(2)

    @rule(node=st.sampled_from(NODES))
    def add(self, node: str) -> None:
        """A new order."""
        if self.names < 8:
            name = f"s{self.names}"
            self.stops.append({"id": name, "node": node, "service_s": 10.0, "demand": 1})
            self.names += 1

    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        """An order is gone from the file."""
        if self.stops:
            gone = self.stops.pop(data.draw(st.integers(0, len(self.stops) - 1)))
            self.removed.add(gone["id"])

    @rule(lost=st.sets(st.sampled_from(VANS), max_size=2), wait_s=st.integers(1, 40))
    def cycle(self, lost: set[str], wait_s: int) -> None:
        """A cycle; some plans are lost."""
        self.day.file = file_of(self.stops)
        on_the_way = {
            name
            for name, van in self.day.vans.items()
            if van.is_under_way(self.day.now_ns) and van.muted_until_ns < self.day.now_ns - 3 * S
        }
        plans = self.day.cycle()
        for plan in plans:
            assert plan.continues is not None or plan.vehicle not in on_the_way
        self.day.drive(1)
        for plan in plans:
            if plan.vehicle not in lost:
                self.day.vans[plan.vehicle].offer(plan, self.day.now_ns)
        self.day.drive(wait_s)

    @rule(seconds=st.integers(1, 60))
    def drive(self, seconds: int) -> None:
        """Time goes by."""
        self.day.drive(seconds)

    @rule(name=st.sampled_from(VANS), seconds=st.integers(1, 40))
    def mute(self, name: str, seconds: int) -> None:
        """A van cannot be heard for a while, but less than a plan is valid."""
        self.day.vans[name].muted_until_ns = self.day.now_ns + seconds * S

    @rule(name=st.sampled_from(VANS[:2]))
    def refuse(self, name: str) -> None:
        """A driver will refuse the next plan."""
        self.day.vans[name].refuses = True

    @precondition(lambda self: len(self.day.store.load().vehicles) == len(VANS))
    @rule()
    def restart(self) -> None:
        """The dispatcher is killed: what it has not stored is lost. Before the first cycle of its
        fleet that is who has ever reported, see the limits in docs/fleet.md.
        """
        self.day.restart()

    @invariant()
    def nothing_is_served_twice(self) -> None:
        """By no two vans, and in no order's life."""
        day = self.day
        twice = [stop for stop, vans in day.served().items() if vans > 1]
        assert not twice, twice
        ended = Counter(c.order for c in day.store.changes if c.state == "served")
        # A dispatcher that was killed before it stored a visit hears of it again.
        assert all(times <= 1 for times in ended.values())

    @invariant()
    def what_is_held_is_in_a_plan(self) -> None:
        """No order is planned for, or loaded on, a vehicle without a plan that has it."""
        for order in self.day.tracker.book.orders.values():
            if order.state not in ("planned", "under_way"):
                continue
            assert order.vehicle is not None
            vehicle = self.day.tracker.vehicles[order.vehicle]
            plans = [r.plan for r in (vehicle.accepted, vehicle.offered) if r is not None]
            assert any(order.order in [s.stop for s in plan.stops] for plan in plans), order

    def teardown(self) -> None:
        """Left alone, the fleet serves all that is still asked for, and comes home."""
        if not hasattr(self, "day"):
            return
        day = self.day
        day.file = file_of(self.stops)
        for van in day.vans.values():
            van.refuses = False
        for _ in range(40):
            day.run(1)
            states = {order.order: order.state for order in day.tracker.book.orders.values()}
            done = set(states.values()) <= {"served", "cancelled"}
            if done and all(van.plan is None for van in day.vans.values()):
                break
        assert done, day.tracker.book.orders
        served = day.served()
        for stop in self.stops:
            assert states[stop["id"]] == "served"
        for name, state in states.items():
            assert served[name] == (state == "served")
            assert state == "served" or name in self.removed


TestAnyOrder = pytest.mark.long(AnyOrder.TestCase)
TestAnyOrder.settings = settings(max_examples=5, stateful_step_count=25)
