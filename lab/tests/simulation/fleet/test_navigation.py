"""A vehicle on Troy's empty roads takes another way as a newer plan has it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import libsumo
import pytest

from lab.tests.simulation.fleet.road import Running, plan, running
from lab.tests.simulation.signals.driving import leg_of
from slipstream.messages import PlanAcknowledgement, PlannedSegment
from slipstream_lab.research.resources.scaling import least_cost_paths
from slipstream_lab.simulation.scenarios.scenario import Scenario, load_scenario
from slipstream_lab.simulation.sumo.vehicle_types import TYPES

pytestmark = pytest.mark.slow

START, END = "vand_campbell", "3rd_broadway"
SUMO = "cav/van/0/0"


@pytest.fixture(scope="module")
def troy() -> Scenario:
    """Its roads."""
    return load_scenario("troy")


@pytest.fixture
def town(troy: Scenario, tmp_path: Path) -> Iterator[Running]:
    """One vehicle, and no background."""
    routes = tmp_path / "types.rou.xml"
    routes.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    lengths_m = {name: segment.length_m for name, segment in troy.network.segments.items()}
    crossings = troy.network.crossings.values()
    intersections = sorted({c.intersection for c in crossings if c.intersection is not None})
    yard = next(name for name, s in troy.network.segments.items() if s.end == START)
    with running(
        (troy.net, routes), lengths_m=lengths_m, yard=yard, intersections=intersections
    ) as found:
        yield found


def way(troy: Scenario, start: str, blocked: tuple[str, ...] = ()) -> tuple[str, ...]:
    """The shortest way to the end, around what is blocked."""
    cost = {
        name: segment.length_m * (1000 if name in blocked else 1)
        for name, segment in troy.network.segments.items()
    }
    return least_cost_paths(troy.network, cost, [start], [END])[start, END]


def planned(troy: Scenario, path: tuple[str, ...], leg: int = 0) -> tuple[PlannedSegment, ...]:
    """A path as a plan has it."""
    parts = leg_of(troy.network, path).planned
    return tuple(part.model_copy(update={"leg": leg}) for part in parts)


def turned_off(troy: Scenario, path: tuple[str, ...], at: int) -> tuple[str, ...] | None:
    """Another way from the segment of that number on, that leaves the path some way ahead."""
    junction = troy.network.segments[path[at + 1]].end
    rest = way(troy, junction, path[at + 2 : at + 4])
    found = (*path[at : at + 2], *rest)
    ways = all(pair in troy.network.crossings for pair in pairwise(found))
    return found if ways and found != path[at:] and len(set(found)) == len(found) else None


def length_m(troy: Scenario, path: tuple[str, ...]) -> float:
    """With its junctions."""
    return leg_of(troy.network, path).length_m


def in_junction() -> bool:
    """Whether the vehicle crosses one."""
    return bool(libsumo.vehicle.getRoadID(SUMO).startswith(":"))


def drive_until_it_can_turn_off(
    troy: Scenario, town: Running, path: tuple[str, ...], *, crossing: bool
) -> tuple[str, ...]:
    """Drive until another way exists, on a segment or in the junction behind it."""
    while True:
        town.step()
        sensed = town.exchange.sensed["van"]
        assert sensed.on_road
        at = path.index(sensed.segment)
        assert at < len(path) - 4, "no other way was found"
        if in_junction() == crossing:
            other = turned_off(troy, path, at)
            if other is not None:
                return other


@pytest.mark.parametrize("crossing", [False, True], ids=["on a segment", "in a junction"])
def test_a_continued_plan_changes_the_path_on_the_road(
    troy: Scenario, town: Running, crossing: bool
) -> None:
    """At once, or on the segment behind the junction; what is measured is the way that it drove."""
    path = way(troy, START)
    town.exchange.send_plan(plan(planned(troy, path), "one"))
    town.until(lambda: town.world.on_road == 1)
    other = drive_until_it_can_turn_off(troy, town, path, crossing=crossing)
    began = path.index(other[0])
    town.exchange.send_plan(plan(planned(troy, other), "depot", "one", cycle=2, continues=1))
    town.step()
    if crossing:
        town.until(lambda: not in_junction(), limit_s=60.0)
        town.step()
    ahead = libsumo.vehicle.getRoute(SUMO)[libsumo.vehicle.getRouteIndex(SUMO) :]
    assert other[-len(ahead) :] == tuple(ahead)
    town.until(lambda: bool(town.legs))
    (leg,) = town.legs
    assert leg.path == path[:began] + other
    assert leg.distance_m == pytest.approx(length_m(troy, leg.path), abs=15.0)
    answers = [m.accepted for m in town.sent if isinstance(m, PlanAcknowledgement)]
    assert answers == [True, True]
    assert set(town.world.begun_s) == {"one"}


def test_a_path_may_change_more_than_once(troy: Scenario, town: Running) -> None:
    """Each plan continues the one before it."""
    path = way(troy, START)
    town.exchange.send_plan(plan(planned(troy, path), "one"))
    town.until(lambda: town.world.on_road == 1)
    driven: tuple[str, ...] = ()
    for cycle in (2, 3):
        other = drive_until_it_can_turn_off(troy, town, path, crossing=False)
        driven += path[: path.index(other[0])]
        told = plan(planned(troy, other), "depot", "one", cycle=cycle, continues=cycle - 1)
        town.exchange.send_plan(told)
        path = other
        for _ in town.steps_for(5.0):
            pass
    town.until(lambda: bool(town.legs))
    (leg,) = town.legs
    assert leg.path == driven + path
    assert leg.distance_m == pytest.approx(length_m(troy, leg.path), abs=15.0)


def test_a_plan_that_the_vehicle_is_not_on_changes_nothing(troy: Scenario, town: Running) -> None:
    """It is refused, and the vehicle drives on as before."""
    path = way(troy, START)
    town.exchange.send_plan(plan(planned(troy, path), "one"))
    town.until(lambda: town.world.on_road == 1)
    for _ in town.steps_for(5.0):
        pass
    elsewhere = planned(troy, path[-3:])
    town.exchange.send_plan(plan(elsewhere, "depot", "one", cycle=2, continues=1))
    town.until(lambda: bool(town.legs))
    assert town.legs[0].path == path
    answers = [m.accepted for m in town.sent if isinstance(m, PlanAcknowledgement)]
    assert answers == [True, False]
