"""The fleet's vehicles on Troy's empty roads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from simulation.closed_loop.alternative_routes import AlternativeRoutes
from simulation.closed_loop.world import FleetWorld
from simulation.controllers.fleet_controller import Drafting
from simulation.controllers.vehicle import LegOrder, VehicleState

from dispatcher_daemon.fleet import Depot, Fleet, Stop, Vehicle
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.travel import roads_of
from dispatcher_daemon.traffic import take_snapshot
from research.resources.scaling import least_cost_paths
from simulation.exogenous.tours import free_s
from simulation.fleet.driven_leg import DrivenLeg
from simulation.scenarios.scenario import Scenario, load_scenario
from simulation.sumo.session import Session
from simulation.sumo.vehicle_types import TYPES
from slipstream.energy import ETA_FOLLOWER, ETA_LEADER
from slipstream.messages import DrivingAdvice

STEP_S = 0.5


@pytest.fixture(scope="module")
def troy() -> Scenario:
    """Its roads."""
    return load_scenario("troy")


@pytest.fixture
def session(troy: Scenario, tmp_path: Path) -> Iterator[Session]:
    """SUMO without a background."""
    routes = tmp_path / "types.rou.xml"
    routes.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    options = [
        *("--net-file", str(troy.net), "--route-files", str(routes)),
        *("--step-length", str(STEP_S), "--no-step-log", "true", "--xml-validation", "never"),
    ]
    with Session(options, (troy.net, routes)) as running:
        yield running


def shortest(troy: Scenario, start: str, end: str) -> tuple[str, ...]:
    """The shortest way between two junctions."""
    cost = {name: segment.length_m for name, segment in troy.network.segments.items()}
    return least_cost_paths(troy.network, cost, [start], [end])[start, end]


def blocked(troy: Scenario, segments: tuple[str, ...]) -> AlternativeRoutes:
    """Ways of least time while some segments crawl."""
    depot, stop = Depot(node="vand_campbell"), Stop(id="a", node="3rd_broadway")
    fleet = Fleet(depots=(depot,), stops=(stop,), vehicles=(Vehicle(id="van"),))
    free = take_snapshot(troy.network, (), 0, stale_after_s=1.0)
    slow = {name: replace(free.segments[name], speed_mps=1.0) for name in segments}
    snapshot = replace(free, segments={**free.segments, **slow})
    problem = RoutingProblem(troy.network, fleet, search="time")
    return AlternativeRoutes(troy.network, roads_of(problem, snapshot))


def order(troy: Scenario, path: tuple[str, ...]) -> LegOrder:
    """A leg that is due after ten seconds."""
    return LegOrder("van", 0, 0, path, 10.0, 10.0, free_s(troy.network, path), (), DrivingAdvice())


def length_m(troy: Scenario, path: tuple[str, ...]) -> float:
    """Of a way, its junctions apart."""
    return sum(troy.network.segments[name].length_m for name in path)


class NoControl:
    """Vehicles drive as SUMO's drivers do."""

    disengagements = 0

    def departed(self, name: str, order: LegOrder) -> None:
        """Nothing to prepare."""

    def ended(self, name: str) -> None:
        """Nothing to forget."""

    def control(self, now_s: float, states: Mapping[str, VehicleState]) -> Drafting:
        """No vehicle is controlled."""
        return Drafting()


def drive(world: FleetWorld, steps: int) -> list[DrivenLeg]:
    """The legs that end within some steps."""
    return [leg for _ in range(steps) for leg in world.step()]


def test_a_leg_goes_from_rest_to_rest(troy: Scenario, session: Session) -> None:
    """It leaves when it is due, drives its way, needs traction for it and is gone at the end."""
    path = shortest(troy, "vand_campbell", "4th_madison")
    lengths = {name: segment.length_m for name, segment in troy.network.segments.items()}
    world = FleetWorld(session, lengths, NoControl(), STEP_S)
    world.send(order(troy, path))
    assert not drive(world, 19)
    assert world.unfinished == 0
    (leg,) = drive(world, 1200)
    assert world.unfinished == 0
    assert 10.0 <= leg.departed_s <= 11.0
    assert leg.path == path
    assert leg.distance_m == pytest.approx(length_m(troy, path), rel=0.1)
    assert leg.free_s < leg.arrived_s - leg.departed_s < 3 * leg.free_s
    assert leg.driven == leg.alone
    assert 0.05 < 1000 * leg.driven.total_kwh / leg.distance_m < 0.3
    assert sum(leg.losses) == pytest.approx(leg.alone.total_kwh, rel=1e-6)


@pytest.mark.parametrize(
    ("eta", "led", "followed"), [(0.0, 0, 0), (ETA_LEADER, 1, 0), (ETA_FOLLOWER, 0, 1)]
)
def test_what_is_driven_in_platoons_is_counted(
    troy: Scenario, session: Session, eta: float, led: int, followed: int
) -> None:
    """Distances by the drag reduction that is credited; exposure with and without one."""

    class Drafts(NoControl):
        def control(self, now_s: float, states: Mapping[str, VehicleState]) -> Drafting:
            return Drafting({n: eta for n in states if eta}, turbulent=frozenset(states))

    path = shortest(troy, "vand_campbell", "4th_madison")
    lengths = {name: segment.length_m for name, segment in troy.network.segments.items()}
    world = FleetWorld(session, lengths, Drafts(), STEP_S)
    world.send(order(troy, path))
    (leg,) = drive(world, 1219)
    assert leg.turbulent_s == pytest.approx(leg.arrived_s - leg.departed_s, abs=1.0)
    assert leg.led_m == pytest.approx(led * leg.distance_m, rel=0.01)
    assert leg.followed_m == pytest.approx(followed * leg.distance_m, rel=0.01)
    assert (leg.driven.drag_kwh < leg.alone.drag_kwh) == (eta > 0)


def test_a_leg_is_put_off_and_sent_another_way(troy: Scenario, session: Session) -> None:
    """Whoever is asked when it is due may hold it; on the road it can turn off ahead, twice."""
    path = shortest(troy, "vand_campbell", "3rd_broadway")
    lengths = {name: segment.length_m for name, segment in troy.network.segments.items()}

    def later(leg: LegOrder, now_s: float) -> tuple[LegOrder, float]:
        return replace(leg, free_s=1.0), now_s + 20.0

    world = FleetWorld(session, lengths, NoControl(), STEP_S, leave=later)
    world.send(order(troy, path))
    ended = drive(world, 100)
    taken, turned = path, 0
    while turned < 2:
        ((leg, state),) = world.running().values()
        ahead = taken[state.number + 2 : state.number + 4]
        other = blocked(troy, ahead).better(taken, state.number)
        if other is not None and world.reroute(leg.id, other):
            assert other != taken
            taken, turned = other, turned + 1
        ended += drive(world, 40)
    (arrived,) = ended + drive(world, 2400)
    assert arrived.departed_s >= 30.0
    assert (arrived.path, arrived.free_s) == (taken, 1.0)
    assert arrived.distance_m == pytest.approx(length_m(troy, taken), rel=0.1)
