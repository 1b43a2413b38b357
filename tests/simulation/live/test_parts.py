"""The live world's parts: pace, pictures over HTTP, plans, orders, gates, where cameras hang."""

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
from simulation.live.fleet_file import FleetFile, open_since_s
from simulation.live.gates import BusGates
from simulation.live.pace import SLIP_S, Pace
from simulation.live.plans import PendingPlans, PlanQueue, in_world_time
from simulation.live.sites import camera_site
from simulation.live.stream import LatestPicture, MjpegServer
from simulation.live.world_spec import WorldSpec
from simulation.scenarios.demand.deliveries import Deliveries, FleetSettings, Order
from simulation.scenarios.perception.rsus import Rsu, Stretch
from slipstream.messages import (
    Estimate,
    KinematicFeatures,
    PlannedSegment,
    PlannedStop,
    SegmentState,
    VehiclePlan,
)
from slipstream.roads import Segment, build_network

S = 1_000_000_000
ISSUED_NS = 1_795_000_000 * S


class Clock:
    """A clock that stands until it is moved."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_steps_are_due_by_the_wall_clock() -> None:
    """At twice real time a step of 0.1 s is due each 0.05 s, whatever the ones before took."""
    clock = Clock()
    pace = Pace(0.1, 2.0, clock)
    assert pace.wait_s() == pytest.approx(0.05)
    clock.now_s += 0.05
    pace.stepped()
    assert pace.due_s == pytest.approx(100.05)
    clock.now_s += 0.03
    assert pace.wait_s() == pytest.approx(0.02)
    assert (pace.steps, pace.late, pace.slipped_s) == (1, 0, 0.0)


def test_a_short_delay_is_caught_up_with_a_long_one_is_not() -> None:
    """Late steps follow at once; a world far behind goes on from where it is, and tells so."""
    clock = Clock()
    pace = Pace(0.1, 1.0, clock)
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
    ("speed", "fps", "steps", "step_s"),
    [(1.0, 10.0, 1, 0.1), (4.0, 10.0, 4, 0.1), (0.5, 10.0, 1, 0.05), (1.5, 10.0, 2, 0.075)],
)
def test_pictures_fall_on_steps(
    speed: float, fps: float, steps: int, step_s: float, deliveries: Deliveries
) -> None:
    """Steps are 0.1 s at most, and a whole number of them lies between two pictures."""
    order = WorldSpec(
        day=None,  # type: ignore[arg-type]
        begin_s=0.0,
        speed=speed,
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
    connection = http.client.HTTPConnection("127.0.0.1", urlsplit(server.url).port or 0, timeout=5)
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


def _plan(vehicle: str, orders: list[str], cycle: int = 1, depart_s: float = 10.0) -> VehiclePlan:
    """A plan that leaves so long after its issue, ten seconds a segment and at each stop."""
    clock_ns = ISSUED_NS + round(depart_s * S)
    stops = [PlannedStop(stop="d", node="a", arrival_ns=clock_ns, departure_ns=clock_ns)]
    segments = []
    for leg, stop in enumerate([*orders, "d"]):
        segments.append(
            PlannedSegment(
                segment="ab",
                entry_ns=clock_ns,
                exit_ns=clock_ns + 10 * S,
                speed_mps=10.0,
                platoon=None,
                place=None,
                gap_m=None,
                leg=leg,
            )
        )
        clock_ns += 10 * S
        stops.append(
            PlannedStop(stop=stop, node="b", arrival_ns=clock_ns, departure_ns=clock_ns + 10 * S)
        )
        clock_ns += 10 * S
    return VehiclePlan(
        vehicle=vehicle,
        cycle=cycle,
        issued_ns=ISSUED_NS,
        valid_until_ns=ISSUED_NS + 900 * S,
        depart_ns=stops[0].departure_ns,
        stops=tuple(stops),
        segments=tuple(segments),
        distance_m=200.0,
        energy_kwh=0.1,
    )


def test_a_plans_times_count_from_its_issue_in_the_world() -> None:
    """All times of a plan move to the simulated clock, and their distances stay."""
    plan = in_world_time(_plan("van-1", ["o1"]), 27000.0)
    assert plan.depart_ns == 27010 * S
    assert [stop.arrival_ns / S for stop in plan.stops] == [27010, 27020, 27040]
    assert [(p.entry_ns / S, p.exit_ns / S) for p in plan.segments] == [
        (27010, 27020),
        (27030, 27040),
    ]
    assert plan.valid_until_ns == 27900 * S


def test_a_vehicle_takes_a_plan_only_when_it_is_free() -> None:
    """On its round it takes none; back at the depot it takes the newest that has not left yet."""
    waiting = PendingPlans({"van-1", "van-2"}, {"o1", "o2"})
    waiting.add(in_world_time(_plan("van-1", ["o1"]), 0.0))
    assert list(waiting.take({"van-2": 0.0}, set())) == []
    assert list(waiting.take({"van-1": 50.0}, set())) == []
    waiting.add(in_world_time(_plan("van-1", ["o1"], cycle=2), 60.0))
    waiting.add(in_world_time(_plan("van-1", ["o2"], cycle=3), 65.0))
    assert [plan.cycle for plan in waiting.take({"van-1": 50.0}, set())] == [3]
    assert list(waiting.take({"van-1": 50.0}, set())) == []


@pytest.mark.parametrize(
    ("vehicle", "orders", "taken"),
    [("van-9", ["o1"], []), ("van-1", ["strange"], []), ("van-1", ["o1", "o2"], ["o2"])],
)
def test_plans_that_do_not_fit_the_fleet_are_left_out(
    vehicle: str, orders: list[str], taken: list[str]
) -> None:
    """Another fleet's vehicle or order, and an order that somebody else has taken."""
    waiting = PendingPlans({"van-1"}, {"o1", "o2"})
    waiting.add(in_world_time(_plan(vehicle, orders), 0.0))
    assert list(waiting.take({"van-1": 0.0, "van-9": 0.0}, taken)) == []


def test_only_plans_for_the_fleet_come_out_of_the_mailbox() -> None:
    """Noise on the bus and other fleets' plans are dropped where they arrive."""
    mailbox = PlanQueue(["van-1"])
    mailbox.take("key", b"noise")
    mailbox.take("key", _plan("van-9", ["o1"]).to_bytes())
    mailbox.take("key", _plan("van-1", ["o1"]).to_bytes())
    assert [plan.vehicle for plan in mailbox.drain()] == ["van-1"]
    assert list(mailbox.drain()) == []


@pytest.fixture
def deliveries() -> Deliveries:
    """One van and three orders, released at six, seven and eight."""
    settings = FleetSettings(depots=(Depot(id="d", node="a"),), vehicles=1, wave_s=3600.0)
    orders = tuple(
        Order(f"o{hour}", "b", 3600.0 * hour, 3600.0 * hour + 4000.0, 60.0, 1) for hour in (6, 7, 8)
    )
    return Deliveries(settings, {"van-1": "d"}, orders)


def test_the_order_file_follows_the_day(tmp_path: Path, deliveries: Deliveries) -> None:
    """Orders appear when they are ready and go when taken; a file without any says so."""
    path = tmp_path / "fleet.json"
    file = FleetFile(path, deliveries)
    now_s = 7.5 * 3600
    assert open_since_s(deliveries, now_s) == 6.5 * 3600
    assert file.write(now_s, {"van-1": now_s - 60.0}, {"o6"}) == 1
    fleet = json.loads(path.read_text())
    assert [stop["id"] for stop in fleet["stops"]] == ["o7"]
    assert fleet["stops"][0]["latest_s"] == pytest.approx(2200.0)
    assert [vehicle["id"] for vehicle in fleet["vehicles"]] == ["van-1"]
    assert file.write(now_s, {}, {"o6", "o7"}) == 0
    assert json.loads(path.read_text())["stops"] == []
    assert [found.name for found in tmp_path.iterdir()] == ["fleet.json"]


def _state(time_ns: int, y_e: int | None) -> SegmentState:
    features = KinematicFeatures(
        mean_speed_mps=Estimate(value=12.0),
        mean_acceleration_mps2=Estimate(value=0.0),
        density_veh_per_m=Estimate(value=0.02),
        speed_std_mps=Estimate(value=0.5),
        acceleration_variance_m2ps4=Estimate(value=0.1),
    )
    return SegmentState(
        rsu="rsu-01",
        segment="ab",
        sequence=time_ns // S,
        time_ns=time_ns,
        window_s=60.0,
        features=features,
        y_e=y_e,  # type: ignore[arg-type]
        reason=None if y_e is not None else "uncertain",
        vehicles=5,
        frames=600,
        coverage=1.0,
    )


@pytest.mark.parametrize(
    ("y_e", "age_s", "is_open", "is_turbulent"),
    [(1, 1, True, False), (0, 1, False, True), (None, 1, False, False), (1, 9, False, False)],
)
def test_gates_are_what_fresh_states_say(
    y_e: int | None, age_s: int, is_open: bool, is_turbulent: bool
) -> None:
    """Open on stable, turbulent on turbulent, neither where nothing fresh is known."""
    gates = BusGates(lambda: ISSUED_NS)
    gates.take("key", b"noise")
    gates.take("key", _state(ISSUED_NS - age_s * S, y_e).to_bytes())
    assert (gates.is_open("ab"), gates.is_turbulent("ab")) == (is_open, is_turbulent)
    assert not gates.is_open("ba")


@pytest.mark.parametrize("length_m", [400.0, 100.0])
def test_a_camera_stands_to_the_right_and_looks_along_the_traffic(length_m: float) -> None:
    """Its mast is beside the carriageway, the stretch's last part is 20 to 80 m ahead of it."""
    end = (length_m * math.cos(0.5), length_m * math.sin(0.5))
    road = Segment("ab", "a", "b", length_m, 13.9, 2, ((0.0, 0.0), end))
    network = build_network("n", [road], {"a": (0.0, 0.0), "b": end})
    to_m = length_m - 60.0 if length_m > 150 else length_m
    stretch = Stretch(segment="ab", from_m=0.0, to_m=to_m, from_lane=1)
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
