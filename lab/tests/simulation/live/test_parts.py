"""The live world's parts: pace, pictures over HTTP, orders, where cameras hang."""

from __future__ import annotations

import http.client
import json
import math
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from dispatcher_daemon.fleet import Depot
from slipstream.roads import Segment, build_network
from slipstream_lab.simulation.live.fleet_file import LiveFleetFile
from slipstream_lab.simulation.live.pace import SLIP_S, WorldPace
from slipstream_lab.simulation.live.stream import LatestPicture, MjpegServer
from slipstream_lab.simulation.live.world_spec import WorldSpec
from slipstream_lab.simulation.rsus import Rsu, WatchedStretch
from slipstream_lab.simulation.scenarios.demand.deliveries import Deliveries, FleetSettings, Order
from slipstream_lab.simulation.sumo_view import camera_site


class Clock:
    """A clock that stands until it is moved."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_steps_are_due_by_the_wall_clock() -> None:
    """A step of 0.1 s is due each 0.1 s, whatever the ones before took."""
    clock = Clock()
    pace = WorldPace(0.1, clock)
    assert pace.wait_s() == pytest.approx(0.1)
    clock.now_s += 0.1
    pace.stepped()
    assert pace.due_s == pytest.approx(100.1)
    clock.now_s += 0.06
    assert pace.wait_s() == pytest.approx(0.04)
    assert (pace.steps, pace.late, pace.slipped_s) == (1, 0, 0.0)


def test_a_short_delay_is_caught_up_with_a_long_one_is_not() -> None:
    """Late steps follow at once; a world far behind goes on from where it is, and tells so."""
    clock = Clock()
    pace = WorldPace(0.1, clock)
    clock.now_s += 0.35
    assert pace.wait_s() == 0.0
    pace.stepped()
    assert (pace.late, pace.slipped_s) == (1, 0.0)
    assert pace.wait_s() == 0.0
    pace.stepped()
    clock.now_s += 5.0
    assert pace.wait_s() == 0.0
    pace.stepped()
    assert pace.slipped_s == pytest.approx(5.05)
    assert pace.slipped_s > SLIP_S
    assert pace.wait_s() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("fps", "steps", "step_s"), [(10.0, 1, 0.1), (2.5, 4, 0.1), (20.0, 1, 0.05), (4.0, 3, 0.083)]
)
def test_pictures_fall_on_steps(
    fps: float, steps: int, step_s: float, deliveries: Deliveries
) -> None:
    """Steps are 0.1 s at most, and a whole number of them lies between two pictures."""
    order = WorldSpec(
        day=None,  # type: ignore[arg-type]
        begin_s=0.0,
        rsus=(),
        deliveries=deliveries,
        fleet=Path(),
        bus=None,  # type: ignore[arg-type]
        folder=Path(),
        fps=fps,
    )
    assert (order.steps_a_frame, order.step_s) == (steps, pytest.approx(step_s))


@pytest.fixture
def camera() -> Iterator[tuple[LatestPicture, MjpegServer]]:
    """A camera that shows what it is given."""
    latest = LatestPicture()
    server = MjpegServer(latest)
    yield latest, server
    server.close()


def _get(server: MjpegServer, path: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", urlsplit(server.url).port or 0, timeout=60)
    connection.request("GET", path)
    return connection.getresponse()


def test_a_client_gets_pictures_with_their_times(
    camera: tuple[LatestPicture, MjpegServer],
) -> None:
    """The stream is multipart MJPEG; each part says how long it is and when it was taken."""
    latest, server = camera
    latest.put(b"\xff\xd8one\xff\xd9", 12.5)
    with _get(server, "/") as answer:
        assert answer.getheader("Content-Type") == "multipart/x-mixed-replace; boundary=slipstream"
        for content, taken in ((b"\xff\xd8one\xff\xd9", b"12.500000"), (b"second", b"13.000000")):
            lines = [answer.readline().strip() for _ in range(5)]
            assert lines[:4] == [
                b"--slipstream",
                b"Content-Type: image/jpeg",
                b"Content-Length: %d" % len(content),
                b"X-Timestamp: %s" % taken,
            ]
            assert answer.read(len(content) + 2) == content + b"\r\n"
            latest.put(b"second", 13.0)
    with _get(server, "/picture.jpg") as answer:
        assert answer.read() == b"second"
    with _get(server, "/elsewhere") as answer:
        assert answer.status == 404


def test_a_dead_client_holds_nobody_up(camera: tuple[LatestPicture, MjpegServer]) -> None:
    """While one client never reads, pictures go on being put at once and others get them."""
    latest, server = camera
    with socket.create_connection(("127.0.0.1", urlsplit(server.url).port or 0)) as dead:
        dead.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        dead.sendall(b"GET / HTTP/1.1\r\nHost: camera\r\n\r\n")
        began = time.monotonic()
        for number in range(30):
            latest.put(bytes(400_000), float(number))
            time.sleep(0.002)
        with _get(server, "/picture.jpg") as answer:
            assert len(answer.read()) == 400_000
        assert time.monotonic() - began < 2.0


@pytest.fixture
def deliveries() -> Deliveries:
    """One van and three orders, released at six, seven and eight."""
    settings = FleetSettings(depots=(Depot(id="d", node="a"),), vehicles=1, wave_s=3600.0)
    orders = tuple(
        Order(f"o{hour}", "b", 3600.0 * hour, 3600.0 * hour + 4000.0, 60.0, 1) for hour in (6, 7, 8)
    )
    return Deliveries(settings, {"van-1": "d"}, orders)


def test_the_order_file_follows_the_day(tmp_path: Path, deliveries: Deliveries) -> None:
    """Orders appear when they are ready and go when served, those of former waves count as served;
    a file without any says so.
    """
    path = tmp_path / "fleet.json"
    now_s = 7.5 * 3600
    file = LiveFleetFile(path, deliveries, now_s)
    assert file.write(now_s, set()) == 1
    fleet = json.loads(path.read_text())
    assert [stop["id"] for stop in fleet["stops"]] == ["o7"]
    assert fleet["stops"][0]["latest_s"] == pytest.approx(2200.0)
    assert [vehicle["id"] for vehicle in fleet["vehicles"]] == ["van-1"]
    assert file.write(now_s + 3600.0, {"o7"}) == 1
    assert [stop["id"] for stop in json.loads(path.read_text())["stops"]] == ["o8"]
    assert file.write(now_s, {"o7"}) == 0
    assert json.loads(path.read_text())["stops"] == []
    assert [found.name for found in tmp_path.iterdir()] == ["fleet.json"]


@pytest.mark.parametrize("length_m", [400.0, 100.0])
def test_a_camera_stands_to_the_right_and_looks_along_the_traffic(length_m: float) -> None:
    """Its mast is beside the carriageway, the stretch's last part is 20 to 80 m ahead of it."""
    end = (length_m * math.cos(0.5), length_m * math.sin(0.5))
    road = Segment("ab", "a", "b", length_m, 13.9, 2, ((0.0, 0.0), end))
    network = build_network("n", [road], {"a": (0.0, 0.0), "b": end})
    to_m = length_m - 60.0 if length_m > 150 else length_m
    stretch = WatchedStretch(segment="ab", from_m=0.0, to_m=to_m, from_lane=1)
    rsu = Rsu(id="rsu-01", watch=(stretch,))
    site = camera_site(rsu, network, 1280, 720)
    ahead = np.array([math.cos(0.5), math.sin(0.5)])
    mast = np.array([site.mast.x_m, site.mast.y_m])
    assert site.view.look_at_m is not None
    look = np.array(site.view.look_at_m) - mast
    assert float(mast @ np.array([ahead[1], -ahead[0]])) == pytest.approx(7.2)
    assert to_m - float(mast @ ahead) == pytest.approx(85.0)
    assert float(look @ ahead) == pytest.approx(40.0)
    assert [(watch.edge, watch.from_lane) for watch in site.watch] == [("ab", 1)]
