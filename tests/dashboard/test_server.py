"""The page is served where it was asked for or not at all, and stays private."""

from __future__ import annotations

import socket
import threading

import pytest
import viser

from dashboard.live import LiveData, Snapshot
from dashboard.page import Page
from dashboard.panels.layout import PanelLayout
from dashboard.scene import RoadMap
from dashboard.server import start_server, stop_server
from dashboard.settings import DashboardSettings
from dashboard.view.build import build_view
from dashboard.web.pictures import Pictures
from slipstream.bus import free_port
from slipstream.errors import InputError

S = 1_000_000_000


@pytest.fixture
def server():
    """A running server on a free port of loopback."""
    server = start_server("127.0.0.1", free_port())
    yield server
    stop_server(server)


def test_a_taken_port_is_refused():
    """A port that somebody listens on is refused in one line, and no other port is taken."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        before = set(threading.enumerate())
        with pytest.raises(
            InputError, match="the port is taken; stop what listens there"
        ) as caught:
            start_server("127.0.0.1", port)
        assert caught.value.source == f"127.0.0.1:{port}"
        assert set(threading.enumerate()) <= before


def test_a_port_lost_in_the_last_moment_is_refused(monkeypatch):
    """Where viser ends up on another port than asked for, it is stopped and refused."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        monkeypatch.setattr("dashboard.server.check_address_free", lambda host, port: None)
        with pytest.raises(InputError, match="the port is taken"):
            start_server("127.0.0.1", port)


@pytest.mark.parametrize("host", ["192.0.2.1", "no-such-host.invalid"])
def test_addresses_that_are_not_ours_are_refused(host):
    """A host that cannot be bound is refused in one line."""
    with pytest.raises(InputError, match="cannot serve here"):
        start_server(host, free_port())


def test_no_public_tunnel(server: viser.ViserServer, monkeypatch):
    """A client that asks for a public share URL gets none, and no tunnel is made."""
    monkeypatch.setattr("viser._viser.ViserTunnel", _no_tunnel)
    assert server.request_share_url() is None
    assert server._share_tunnel is None


def _no_tunnel(*_: object) -> None:
    raise AssertionError("a tunnel was opened")


@pytest.mark.long
def test_what_is_kept_for_new_browsers_does_not_grow(server, world, now_ns):
    """After hundreds of updates, roads and vans coming and going, no more is kept than before."""
    road_map, panels = RoadMap(server, world.network, ("depot",)), PanelLayout(server)
    buffer = server._websock_server._broadcast_buffer

    def show(tick: int) -> None:
        time_ns = now_ns + tick * S
        names = ("avenue_east", "avenue_west") if tick % 3 else ("avenue_east",)
        states = [world.state(name, time_ns, y_e=(tick + len(name)) % 2) for name in names]
        vans = ("van-a", "van-b") if tick % 5 else ("van-b",)
        snapshot = Snapshot(
            states={(state.segment, state.rsu): state for state in states},
            rsus={name: world.health(name, time_ns) for name in names},
            plans={van: world.plan(van, tick, now_ns + tick // 7 * S) for van in vans},
            cycles=tuple(world.cycle(n, now_ns + n * S) for n in range(max(0, tick - 20), tick)),
        )
        view = build_view(snapshot, time_ns, 5.0)
        road_map.update(view)
        panels.update(view)

    def kept() -> int:
        server._run_garbage_collector()
        return len(buffer.message_from_id)

    for tick in range(60):
        show(tick)
    before = kept()
    for tick in range(60, 360):
        show(tick)
    assert kept() <= before + 5


def test_stops_at_one_junction_share_a_label_and_every_depot_is_marked(server, world, now_ns):
    """Labels of two stops at a junction would lie on top of each other; unknown depots are not."""
    road_map = RoadMap(server, world.network, ("depot", "west", "nowhere"))
    plan = world.plan("van-a", 1, now_ns)
    stops = tuple(stop.model_copy(update={"node": "c1"}) for stop in plan.stops)
    plan = plan.model_copy(update={"stops": stops})
    snapshot = Snapshot(states={}, rsus={}, plans={"van-a": plan}, cycles=())
    drawn = road_map.update(build_view(snapshot, now_ns, 5.0))
    names = sorted(stop.stop for stop in stops)
    assert len(names) == 2
    assert [mark.text for mark in drawn.marks if mark.kind == "stop"] == [" + ".join(names)]
    assert len(server.scene.get_handle_by_name("/depots").batched_positions) == 2
    depots = [mark.id for mark in drawn.marks if mark.text == "Depot"]
    assert depots == ["depot", "west"]


def test_the_server_is_replaced_after_its_updates(world, now_ns, monkeypatch):
    """After so many updates the page goes on being served at its address by a new server."""
    monkeypatch.setattr("dashboard.page.RESTART_AFTER_UPDATES", 8)
    settings = DashboardSettings(scene_port=free_port(), database_url=None)
    page = Page(settings, world.network, threading.Event(), Pictures())
    try:
        servers = []
        for _ in range(10):
            page.show(LiveData(lambda: now_ns), now_ns)
            servers.append(page._server)
            with socket.create_connection((settings.host, settings.scene_port), timeout=60):
                pass
        assert [server is servers[0] for server in servers] == [True] * 4 + [False] * 6
    finally:
        page.close()


@pytest.fixture
def page_due_for_restart(world, monkeypatch):
    """A page whose server is restarted at the next update."""
    monkeypatch.setattr("dashboard.page.RESTART_AFTER_UPDATES", 0)
    monkeypatch.setattr("dashboard.page.RETRY_AFTER_S", (0.01, 0.01, 0.3))
    stopping = threading.Event()
    settings = DashboardSettings(scene_port=free_port(), database_url=None)
    page = Page(settings, world.network, stopping, Pictures())
    yield page, settings, stopping
    page.close()


class _Refusals:
    """A server start that refuses so many times."""

    def __init__(self, refusals: int) -> None:
        self.left = refusals
        self.tries = 0

    def __call__(
        self, host: str, port: int, allowed_hosts: tuple[str, ...] = (), head: str = ""
    ) -> viser.ViserServer:
        self.tries += 1
        if self.tries <= self.left:
            raise InputError(f"{host}:{port}", "the port is taken", "stop what listens there")
        return start_server(host, port, allowed_hosts, head)


def test_a_port_that_comes_free_late_is_waited_for(page_due_for_restart, now_ns, monkeypatch):
    """A restarted server whose port is not free at once serves as soon as it is."""
    page, settings, _ = page_due_for_restart
    starts = _Refusals(2)
    monkeypatch.setattr("dashboard.page.start_server", starts)
    page.show(LiveData(lambda: now_ns), now_ns)
    assert starts.tries == 3
    with socket.create_connection((settings.host, settings.scene_port), timeout=60):
        pass


def test_a_port_that_is_lost_in_service_is_no_input_error(
    page_due_for_restart, now_ns, monkeypatch
):
    """After all tries the daemon ends with a fault after which it is started again."""
    page, _, _ = page_due_for_restart
    monkeypatch.setattr("dashboard.page.start_server", _Refusals(99))
    with pytest.raises(OSError, match="lost during a restart of the web server") as caught:
        page.show(LiveData(lambda: now_ns), now_ns)
    assert not isinstance(caught.value, InputError)


def test_a_page_that_waits_for_its_port_can_be_stopped(page_due_for_restart, now_ns, monkeypatch):
    """A service that stops does not wait for the port any longer, and closes without a fault."""
    page, _, stopping = page_due_for_restart
    starts = _Refusals(99)
    monkeypatch.setattr("dashboard.page.start_server", starts)
    stopping.set()
    page.show(LiveData(lambda: now_ns), now_ns)
    assert (starts.tries, page.clients()) == (1, 0)
    page.close()
