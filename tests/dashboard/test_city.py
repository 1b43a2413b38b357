"""The page copes with a city: 200 vans, 1,000 stops, 2,024 road segments, 600 of them watched."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
import viser

from dashboard.live import Snapshot
from dashboard.panels import PanelLayout
from dashboard.scene import RoadMap
from dashboard.server import start_server, stop_server
from dashboard.view import DashboardView, build_view
from slipstream.bus import free_port
from slipstream.roads import RoadNetwork
from tests.dashboard import city

S = 1_000_000_000
MAX_NODES = 10
MAX_UPDATE_S = 0.2


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    """The city's roads."""
    return city.grid_city()


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    """A running server on a free port of loopback."""
    server = start_server("127.0.0.1", free_port())
    yield server
    stop_server(server)


def _view(snapshot: Snapshot, now_ns: int) -> DashboardView:
    return build_view(snapshot, now_ns, stale_after_s=5.0, silent_after_s=30.0)


def test_the_city_is_one(network, world, now_ns):
    """What the tests below show is as large as is said."""
    snapshot = city.snapshot(world, network, now_ns)
    assert len(network.segments) == 2024
    assert len(snapshot.plans) == 200
    assert len({stop.stop for plan in snapshot.plans.values() for stop in plan.stops}) == 1000


@pytest.mark.slow
def test_one_node_a_layer(server, network, world, now_ns):
    """All routes, stops, cameras and vans are a few nodes, however many there are."""
    road_map = RoadMap(server, network, ("x0y0",))
    snapshot = city.snapshot(world, network, now_ns)
    view = _view(snapshot, now_ns)
    road_map.update(view)
    scene = server.scene
    nodes = {
        message.name
        for message in server._websock_server._broadcast_buffer.message_from_id.values()
        if type(message).__name__ in ("LineSegmentsMessage", "PointCloudMessage", "LabelMessage")
    }
    assert {"/roads", "/watched", "/routes_alone", "/routes_platoon", "/vans"} <= nodes
    assert len(nodes) <= MAX_NODES
    assert len(scene.get_handle_by_name("/vans").points) == 200
    assert len(scene.get_handle_by_name("/cameras").points) == 600
    places = {stop.node for plan in snapshot.plans.values() for stop in plan.stops} - {"x0y0"}
    assert len(scene.get_handle_by_name("/stops").points) == len(places)
    for name in ("/stop_0", "/van_label_0"):
        assert scene.get_handle_by_name(name) is None
    parts = [part for van in view.vehicles for part in van.route]
    together = [name for name, platoon in parts if platoon is not None]
    strokes = {name: len(road.shape) - 1 for name, road in network.segments.items()}
    routes = scene.get_handle_by_name("/routes_platoon")
    assert len(routes.points) == sum(strokes[name] for name in together)


@pytest.mark.slow(long=True)
def test_routes_end_with_their_vans(server, network, world, now_ns):
    """When the last plan is void its route goes from the map, and comes back with a new one."""
    road_map = RoadMap(server, network, ())
    for plans, shown in ((True, True), (False, False), (True, True)):
        snapshot = city.snapshot(world, network, now_ns)
        road_map.update(_view(snapshot if plans else Snapshot(), now_ns))
        for name in ("/routes_alone", "/routes_platoon", "/vans", "/stops"):
            assert (server.scene.get_handle_by_name(name) is not None) == shown


def test_each_route_has_its_vans_colour(server, network, world, now_ns):
    """Strokes of a van are drawn in its colour, in linear light, and a void plan's fade."""
    road_map = RoadMap(server, network, ())
    rng = np.random.default_rng(1)
    plans = {name: city.plan(name, city.drive(network, rng, 10), [], now_ns) for name in ("a", "b")}
    plans["b"] = plans["b"].model_copy(update={"valid_until_ns": now_ns - S})
    view = _view(Snapshot(plans=plans), now_ns)
    road_map.update(view)
    colours = server.scene.get_handle_by_name("/routes_platoon").colors
    share = np.unique(colours.reshape(-1, 3), axis=0) / 255
    srgb = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055) * 255
    a, b = view.vehicles[0].rgb, [255 - (255 - part) * 0.3 for part in view.vehicles[1].rgb]
    expected = sorted([list(a), b])
    assert len(srgb) == 2
    np.testing.assert_allclose(sorted(srgb.tolist()), expected, atol=9)


@pytest.mark.slow(long=True)
def test_an_update_is_quick(server, network, world, now_ns):
    """Two hundred new plans are on the page in a fifth of a second of computing, as is a move."""
    road_map, panels = RoadMap(server, network, ("x0y0",)), PanelLayout(server)
    first, second = (city.snapshot(world, network, now_ns, seed, seed + 1) for seed in (0, 1))

    def cost_s(snapshot: Snapshot, time_ns: int) -> float:
        began = time.thread_time()
        view = _view(snapshot, time_ns)
        road_map.update(view)
        panels.update(view)
        return time.thread_time() - began

    cost_s(first, now_ns)
    # The best of a few: other processes slow this one down, never up.
    turns = [(second if turn % 2 == 0 else first, now_ns + turn * S) for turn in range(4)]
    assert min(cost_s(*turn) for turn in turns) < MAX_UPDATE_S
    moves = [now_ns + 3 * S + part * S // 4 for part in range(1, 4)]
    assert min(cost_s(first, moment) for moment in moves) < MAX_UPDATE_S
