"""The page copes with a city: 200 vans, 1,000 stops, 2,024 road segments, 600 of them watched."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import viser

from dashboard.live import Snapshot
from dashboard.panels.layout import PanelLayout
from dashboard.scene import RoadMap
from dashboard.scene.fleet import VEHICLE_UNITS
from dashboard.server import start_server, stop_server
from dashboard.view.build import DashboardView, build_view
from slipstream.bus import free_port
from slipstream.roads import RoadNetwork
from tests.dashboard import city

S = 1_000_000_000
MAX_NODES = 12
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
    return build_view(snapshot, now_ns, 5.0)


@pytest.mark.long
@pytest.mark.slow
def test_one_node_a_layer(server, network, world, now_ns):
    """All routes, stops, cameras and vans are a few nodes, however many there are."""
    road_map = RoadMap(server, network, ("x0y0",))
    snapshot = city.snapshot(world, network, now_ns)
    drawn = road_map.update(_view(snapshot, now_ns))
    scene = server.scene
    nodes = {
        message.name
        for message in server._websock_server._broadcast_buffer.message_from_id.values()
        if type(message).__name__ in ("MeshMessage", "BatchedMeshesMessage", "LabelMessage")
    }
    assert {
        "/roads",
        "/watched",
        "/all_routes",
        "/platoons",
        "/planned_vans",
    } <= nodes
    assert len(nodes) <= MAX_NODES
    assert len(scene.get_handle_by_name("/planned_vans").batched_positions) == 200
    assert len(scene.get_handle_by_name("/rsus").batched_positions) == 600
    places = {stop.node for plan in snapshot.plans.values() for stop in plan.stops} - {"x0y0"}
    assert len(scene.get_handle_by_name("/stops").batched_positions) == len(places)
    # Each road that is driven at all is drawn once.
    strokes = {name: len(road.shape) - 1 for name, road in network.segments.items()}
    driven = {part.segment for plan in snapshot.plans.values() for part in plan.segments}
    routes = scene.get_handle_by_name("/all_routes")
    assert len(routes.faces) == 2 * sum(strokes[name] for name in driven)
    assert scene.get_handle_by_name("/routes") is None
    kinds = [mark.kind for mark in drawn.marks]
    assert (kinds.count("van"), kinds.count("rsu"), kinds.count("road")) == (200, 600, 600)


@pytest.mark.long
def test_routes_end_with_their_vans(server, network, world, now_ns):
    """When the last plan is void its route goes from the map, and comes back with a new one."""
    road_map = RoadMap(server, network, ())
    for plans, shown in ((True, True), (False, False), (True, True)):
        snapshot = city.snapshot(world, network, now_ns)
        road_map.update(_view(snapshot if plans else Snapshot(), now_ns))
        for name in ("/all_routes", "/platoons", "/planned_vans", "/stops", "/watched"):
            assert (server.scene.get_handle_by_name(name) is not None) == shown, name


def _srgb(colours: np.ndarray) -> list[list[float]]:
    share = np.unique(colours.reshape(-1, 3), axis=0) / 255
    srgb = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055) * 255
    return sorted(srgb.tolist())


@pytest.mark.slow
def test_each_route_has_its_vans_colour(server, network, world, now_ns):
    """Strips of a van are drawn in its colour, in linear light, and a void plan's fade."""
    road_map = RoadMap(server, network, ())
    rng = np.random.default_rng(1)
    plans = {name: city.plan(name, city.drive(network, rng, 10), [], now_ns) for name in ("a", "b")}
    plans["b"] = plans["b"].model_copy(update={"valid_until_ns": now_ns - S})
    view = _view(Snapshot(plans=plans), now_ns)
    road_map.update(view)
    routes = server.scene.get_handle_by_name("/routes")
    expected = sorted(
        [list(view.vehicles[0].rgb), [255 - (255 - part) * 0.3 for part in view.vehicles[1].rgb]]
    )
    np.testing.assert_allclose(_srgb(routes.batched_colors), expected, atol=9)


def _platoon(network, world, now_ns, y_e: int):
    """Two vans, one behind the other on one road, and what the road's camera says."""
    road = next(name for name in network.segments if network.follows[name])
    driven = [network.segments[name] for name in (road, network.follows[road][0])]
    plans = {}
    for place, begun_s in enumerate((9.0, 8.0)):
        plan = city.plan(f"van-{place}", driven, [], now_ns, begun_s=begun_s)
        parts = tuple(
            part.model_copy(update={"platoon": "p", "place": place}) for part in plan.segments
        )
        plans[plan.vehicle] = plan.model_copy(update={"segments": parts})
    state = world.state(road, now_ns, y_e=y_e)
    return Snapshot(states={(road, state.rsu): state}, plans=plans)


@pytest.mark.slow
def test_a_platoon_is_linked_while_traffic_is_calm(server, network, world, now_ns):
    """Its members stand apart and facing their road, and the link goes when the flag closes."""
    road_map = RoadMap(server, network, ())
    for y_e, linked in ((1, True), (0, False), (1, True)):
        drawn = road_map.update(_view(_platoon(network, world, now_ns, y_e), now_ns))
        for name in ("/platoon_links", "/platoons"):
            assert (server.scene.get_handle_by_name(name) is not None) == linked, name
        leader, follower = drawn.placed.places_m
        ahead = np.array([np.cos(drawn.placed.headings[0]), np.sin(drawn.placed.headings[0])])
        apart = float((leader - follower) @ ahead)
        length_m = VEHICLE_UNITS * road_map.canvas.unit_m
        assert (apart > length_m) == linked
        assert apart > 0


@pytest.mark.long
@pytest.mark.slow
def test_only_what_changed_is_sent(server, network, world, now_ns, monkeypatch):
    """A second view of the same moment sends nothing; a flag that flips sends its colours only."""
    road_map = RoadMap(server, network, ())
    snapshot = city.snapshot(world, network, now_ns)
    road_map.update(_view(snapshot, now_ns))
    sent = []
    monkeypatch.setattr(server.scene._websock_interface, "queue_message", sent.append)
    road_map.update(_view(snapshot, now_ns))
    assert sent == []
    parts = [part for plan in snapshot.plans.values() for part in plan.segments]
    platoons = {part.segment for part in parts if part.platoon is not None}
    key = next(key for key in snapshot.states if key[0] not in platoons)
    flipped = world.state(key[0], now_ns, y_e=1 - snapshot.states[key].y_e)
    states = dict(snapshot.states) | {key: flipped}
    road_map.update(_view(replace(snapshot, states=states), now_ns))
    assert [(message.name, list(message.updates)) for message in sent] == [
        ("/watched", ["batched_colors"])
    ]


@pytest.mark.nightly
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
