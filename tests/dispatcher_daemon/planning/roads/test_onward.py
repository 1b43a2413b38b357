"""Legs of vehicles that are on their way."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.roads import Travel, leg_from, leg_onward, roads_of
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.drive import DrivingStyle, plan_drive

STYLE = DrivingStyle()


@pytest.fixture(scope="module")
def travel(town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]]) -> Travel:
    """A town's paths between its depot and a stop in each quarter; one cannot be reached."""
    problem, snapshot = town(["22", "33", "30", "p"], [{}])
    return Travel(problem, roads_of(problem, snapshot))


def test_from_a_junction_it_is_the_search_between_places(travel: Travel) -> None:
    """Without a path behind it a leg is the least-energy one."""
    for name, node in (("s0", "22"), ("s1", "33"), ("s2", "30")):
        leg = leg_onward(travel, (), ("depot-0", "00"), (name, node), STYLE)
        known = travel.leg("depot-0", name)
        assert leg is not None
        assert known is not None
        assert (leg.path, leg.cost_kwh) == (known.path, known.cost_kwh)
    assert leg_onward(travel, (), ("depot-0", "00"), ("s3", "p"), STYLE) is None
    here = leg_onward(travel, (), ("x", "22"), ("s0", "22"), STYLE)
    assert here is not None
    assert here.path == ()


def test_a_path_behind_it_stays(travel: Travel) -> None:
    """It goes on from its last segment as is cheapest; a whole one is not touched; one that this
    network has not leads nowhere.
    """
    begin = ("10-00", "00-01")
    leg = leg_onward(travel, begin, ("x", "10"), ("s1", "33"), STYLE)
    assert leg is not None
    assert leg.path[:2] == begin
    assert leg.path[-1].endswith("-33")
    # No path from the last segment on is cheaper: it contains the rest of the leg's own.
    rest = leg_onward(travel, leg.path[1:2], ("x", "00"), ("s1", "33"), STYLE)
    assert rest is not None
    assert rest.path == leg.path[1:]
    around = ("22-12", "12-11", "11-21", "21-22")
    whole = leg_onward(travel, around, ("s0", "22"), ("s0", "22"), STYLE, complete=True)
    assert whole is not None
    assert whole.path == around
    for unknown in (("moon-street",), ("00-01", "22-23")):
        assert leg_onward(travel, unknown, ("x", "00"), ("s1", "33"), STYLE) is None


def test_a_vehicle_on_its_first_segment_drives_the_rest(travel: Travel) -> None:
    """Its times count from the begin of the segment, its energy from where it is."""
    leg = leg_onward(travel, ("00-01",), ("x", "00"), ("s0", "22"), STYLE)
    assert leg is not None
    roads = travel.roads
    rows = [roads.index[name] for name in leg.path]
    lengths, speeds = roads.length_m[rows].tolist(), roads.speed_mps[rows].tolist()
    at_speed = leg_from(roads, leg, 0.25, speeds[0], STYLE)
    own = plan_drive([0.75 * lengths[0], *lengths[1:]], speeds, STYLE, speeds[0])
    assert at_speed.drive.entry_s[0] == 0.0
    behind_s = 0.25 * lengths[0] / speeds[0]
    assert at_speed.drive.duration_s == pytest.approx(own.duration_s + behind_s)
    assert at_speed.drive.length_m == pytest.approx(sum(lengths))
    assert at_speed.drive.times_s == own.times_s
    standing = leg_from(roads, leg, 0.25, 0.0, STYLE)
    assert standing.drive.duration_s > at_speed.drive.duration_s
    nearly = leg_from(roads, leg, 1.0, 99.0, STYLE)
    assert nearly.drive.entry_s[1] >= lengths[0] / speeds[0]
