"""Usual speeds from RSUs' states: counted once a cycle, believed once there are enough."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest

from dispatcher_daemon.fleet.learning import HOURS, History, UsualTraffic
from dispatcher_daemon.fleet.learning.usual_traffic import MIN_WINDOWS
from dispatcher_daemon.traffic.snapshot import MIN_SPEED_MPS, SegmentTraffic, TrafficSnapshot
from slipstream.orders import SpeedSum
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network

EAST, WEST = "avenue_east", "avenue_west"


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    """The built-in one."""
    return load_network("demo")


def snapshot(network: RoadNetwork, measured: dict[str, float]) -> TrafficSnapshot:
    """Traffic with these mean speeds; nothing is known of other segments."""
    traffic = {
        name: SegmentTraffic(
            name,
            min(s.speed_limit_mps, measured.get(name, s.speed_limit_mps)),
            measured_speed_mps=measured.get(name),
            age_s=0.0 if name in measured else None,
        )
        for name, s in network.segments.items()
    }
    return TrafficSnapshot(0, MappingProxyType(traffic), ())


def test_speeds_are_counted_by_segment_and_hour(network: RoadNetwork) -> None:
    """Once a cycle, no faster than the limit; what was stored is not pending again."""
    speeds = UsualTraffic(network)
    speeds.on_traffic(snapshot(network, {EAST: 8.0}), 7)
    speeds.on_traffic(snapshot(network, {EAST: 6.0, WEST: 99.0}), 7)
    limit = network.segments[WEST].speed_limit_mps
    assert speeds.pending() == (
        SpeedSum(EAST, 7, 2.0, 14.0, 2.0),
        SpeedSum(WEST, 7, 1.0, limit, 1.0),
    )
    speeds.stored()
    assert speeds.pending() == ()


def test_a_speed_is_believed_once_there_are_enough(network: RoadNetwork) -> None:
    """And after a restart; the hour's own is drawn towards the day's, and a jam stays above 0."""
    few = SpeedSum(EAST, 8, MIN_WINDOWS - 1, 5.0 * (MIN_WINDOWS - 1))
    gone = SpeedSum("moon_street", 8, 1e6, 1e6)
    jam = SpeedSum(WEST, 8, 1e6, 0.0)
    speeds = UsualTraffic(network, [few, gone, jam])
    assert speeds.speeds_mps(8) == {WEST: MIN_SPEED_MPS}
    speeds.on_traffic(snapshot(network, {EAST: 5.0}), 8)
    assert speeds.speeds_mps(8)[EAST] == pytest.approx(5.0)
    many = [SpeedSum(EAST, 8, 1e4, 5e4), SpeedSum(EAST, 3, 1e4, 15e4)]
    by_hour = [UsualTraffic(network, many).speeds_mps(hour)[EAST] for hour in (8, 9, 12, 3)]
    assert by_hour == pytest.approx([5.0, 5.0, 10.0, 15.0], abs=0.1)


def test_gates_are_as_often_open_as_states_have_opened_them(network: RoadNetwork) -> None:
    """Of all fresh states, those without a speed or flag too; a stale one says nothing."""
    usual = UsualTraffic(network)
    calm = SegmentTraffic(EAST, 8.0, 1, True, None, 1.0, 8.0)
    empty = SegmentTraffic(EAST, 8.0, None, False, "too_few_vehicles", 1.0, None)
    stale = SegmentTraffic(EAST, 8.0, None, False, "stale", 500.0, None)
    for traffic, times in ((calm, 60), (empty, 20), (stale, 500)):
        for _ in range(times):
            now = TrafficSnapshot(0, MappingProxyType({EAST: traffic}), ())
            usual.on_traffic(now, 8)
    assert usual.open_shares(8) == {EAST: pytest.approx(0.75)}
    assert usual.speeds_mps(8) == {EAST: pytest.approx(8.0)}
    assert usual.pending() == (SpeedSum(EAST, 8, 60.0, 480.0, 80.0, 60.0),)
    again = UsualTraffic(network, usual.pending())
    assert again.open_shares(8) == usual.open_shares(8)


def test_usual_speeds_hold_where_none_is_measured(network: RoadNetwork) -> None:
    """A fresh state counts more than what is usual; all else stays as it is."""
    now = snapshot(network, {EAST: 12.0})
    slowed = now.at_usual_speeds({EAST: 5.0, WEST: 6.0})
    assert slowed.segments[EAST] == now.segments[EAST]
    assert slowed.segments[WEST].speed_mps == 6.0
    assert slowed.segments[WEST].measured_speed_mps is None
    others = set(network.segments) - {WEST}
    assert all(slowed.segments[name] == now.segments[name] for name in others)


def test_movements_that_nobody_drove_take_the_usual_speed(network: RoadNetwork) -> None:
    """Their time is the segment's length at it, and slower is cheaper."""
    pair = (WEST, network.turns(WEST)[0])
    nothing = History((), *np.zeros((4, 0, HOURS)))
    free, usual = (nothing.expectations(network, 8, given) for given in ({}, {WEST: 5.0}))
    assert usual.seconds[pair] == pytest.approx(network.segments[WEST].length_m / 5.0)
    assert usual.loss_kwh[pair] < free.loss_kwh[pair]
