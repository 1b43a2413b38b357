"""Costs of movements from positions: traces, sums, and when they are believed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.fleet.learning.costs import MIN_PASSAGES, MovementCosts
from dispatcher_daemon.fleet.learning.traces import MAX_GAP, PositionTraces
from slipstream.messages import VehiclePosition
from slipstream.orders import MovementSum
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network

DAY_NS = 86_400 * 10**9
EIGHT_NS = 20_000 * DAY_NS + 8 * 3600 * 10**9


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    """The built-in one."""
    return load_network("demo")


@pytest.fixture(scope="module")
def way(network: RoadNetwork) -> list[str]:
    """Five segments in a row."""
    way = [next(iter(network.segments))]
    while len(way) < 5:
        way.append(network.turns(way[-1])[0])
    return way


def positions(
    way: Sequence[str], seconds: Sequence[int], speed_mps: float = 10.0, begin_ns: int = EIGHT_NS
) -> Iterator[VehiclePosition]:
    """One a second, so many on each segment, then one that stands."""
    at = 0
    for segment, count in zip(way, seconds, strict=True):
        for _ in range(count):
            yield position(segment, begin_ns + at * 10**9, speed_mps)
            at += 1
    yield position(way[-1], begin_ns + at * 10**9, 0.0, on_road=False)


def position(
    segment: str, time_ns: int, speed_mps: float, *, on_road: bool = True
) -> VehiclePosition:
    """Of van-a."""
    return VehiclePosition(
        vehicle="van-a",
        time_ns=time_ns,
        segment=segment,
        share=0.5,
        speed_mps=speed_mps,
        on_road=on_road,
        cycle=1,
        leg=0,
    )


def test_whole_passages_of_a_drive_are_counted(network: RoadNetwork, way: list[str]) -> None:
    """Not the first nor the last segment; each in its hour, with its time and its losses."""
    costs = MovementCosts(network)
    for one in positions(way, (5, 20, 30, 40, 7)):
        costs.on_position(one)
    costs.count()
    found = costs.pending()
    assert [(one.segment, one.following) for one in found] == sorted(pairwise(way[1:]))
    assert {(one.hour, one.count, one.stops) for one in found} == {(8, 1.0, 0.0)}
    by_segment = {one.segment: one for one in found}
    assert by_segment[way[2]].loss_kwh / by_segment[way[1]].loss_kwh == pytest.approx(1.5)
    costs.stored()
    assert costs.pending() == ()


def test_a_drive_with_a_hole_is_two(network: RoadNetwork, way: list[str]) -> None:
    """A silence, or a segment left out, says nothing of the passage in it."""
    traces = PositionTraces(network)
    every = list(positions(way, (5, 20, 30, 40, 7)))
    for one in every:
        if not 30 <= (one.time_ns - EIGHT_NS) // 10**9 <= 30 + MAX_GAP:
            traces.add(one)
    first, second = traces.take() or (None, None)
    assert first is not None
    assert second is not None
    assert (list(first.route), list(second.route)) == (way[:3], way[2:])
    for one in every:
        if one.segment != way[2]:
            traces.add(one)
    assert [list(trace.route) for trace in traces.take()] == []


@pytest.mark.slow
@given(lost=st.sets(st.integers(1, 100)), twice=st.sets(st.integers(0, 100)))
def test_lost_and_repeated_positions_change_little(
    network: RoadNetwork, way: list[str], lost: set[int], twice: set[int]
) -> None:
    """A trace has a speed each second, its entries in order; repetitions add nothing."""
    traces = PositionTraces(network)
    for one in positions(way, (5, 20, 30, 40, 7)):
        second = (one.time_ns - EIGHT_NS) // 10**9
        if one.on_road and second in lost:
            continue
        traces.add(one)
        if second in twice:
            traces.add(one)
    for trace in traces.take():
        steps = [step for step, _ in trace.entries]
        assert steps == sorted(set(steps))
        assert steps[-1] < len(trace.speeds_mps) <= 103
        assert [number for _, number in trace.entries] == list(range(len(trace.route)))
        np.testing.assert_allclose(trace.speeds_mps, 10.0)


def test_costs_are_believed_once_there_are_enough(network: RoadNetwork, way: list[str]) -> None:
    """And after a restart; sums of a segment that the network has no more are left out."""
    movement = MovementSum(way[1], way[2], 8, MIN_PASSAGES - 1, 200.0, 90_000.0, 0.0)
    gone = MovementSum("moon_street", way[2], 8, 1e6, 1e5, 1e7, 0.0)
    costs = MovementCosts(network, [movement, gone])
    assert costs.expectations(EIGHT_NS) is None
    for one in positions(way, (5, 20, 90, 40, 7)):
        costs.on_position(one)
    costs.count()
    assert costs.expectations(EIGHT_NS) is None  # computed once an hour
    later = costs.expectations(EIGHT_NS + DAY_NS)
    assert later is not None
    assert later.seconds[way[1], way[2]] == pytest.approx(90.0, rel=0.02)
    assert costs.pending()[0].count == 1.0
