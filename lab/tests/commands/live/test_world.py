"""`slipstream world`: what it refuses, in one line, and the settings that it gives its daemons."""

from __future__ import annotations

import importlib.util
import signal
import socket
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import pytest

from dashboard.settings import DashboardSettings
from dispatcher_daemon.settings import DispatcherSettings
from edge_daemon.settings import EdgeSettings
from slipstream.bus import free_port
from slipstream.config import BusSettings
from slipstream.messages import VehiclePosition
from slipstream.site import load_site
from slipstream_cli.main import main
from slipstream_cli.place.site_file import write_site
from slipstream_lab.commands.live.movement import FleetMovement
from slipstream_lab.commands.live.world import minute_line, time_of_day_s
from slipstream_lab.commands.live.world_daemons import place_of_world
from slipstream_lab.simulation.fleet.safety import FleetSafety, OthersSafety
from slipstream_lab.simulation.live.prepare import prepare_world
from slipstream_lab.simulation.live.world_spec import CameraEndpoint, WorldCounts
from slipstream_lab.simulation.sumo_view.examples import find_routes


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    """The command takes over signals; tests give them back."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


def _refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that the command ends with."""
    port = ("--port", str(free_port())) if "--port" not in arguments else ()
    assert main(["world", "--state", str(tmp_path / "state"), *port, *arguments]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "| " not in line]
    assert len(lines) == 1
    return lines[0]


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--begin", "25:00"), "--begin: '25:00' is no time of day; give HH:MM"),
        (("--begin", "noon"), "--begin: 'noon' is no time of day"),
        (("--rsus", "0"), "--rsus: 0 is out of range"),
        (("--seconds", "-1"), "--seconds: -1 is out of range"),
        (("--port", "0"), "--port: 0 is no port"),
        (("--scenario", "atlantis"), "atlantis: no such scenario"),
        (("--rsus", "13"), "troy: 12 RSUs for 13 cameras"),
        (("--begin", "00:00"), "--begin: no order is open at this time of day"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], line: str
) -> None:
    """Options out of range, an unknown scenario, more cameras than RSUs, a time without orders."""
    assert _refused(tmp_path, capsys, *arguments).startswith(f"slipstream: {line}")


@pytest.mark.long
def test_files_that_do_not_fit_each_other_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A route file of another net, and an RSU on a segment that the net has not."""
    routes = find_routes("calm")
    line = _refused(tmp_path, capsys, "--routes", str(routes))
    assert "which the net has not; give the route file of this net" in line
    rsus = tmp_path / "rsus.toml"
    rsus.write_text(
        '[[rsus]]\nid = "x"\nwatch = [{ segment = "nowhere", from_m = 0.0, to_m = 9.0 }]\n'
    )
    line = _refused(tmp_path, capsys, "--rsu-file", str(rsus))
    assert "no segment 'nowhere' in net" in line


def test_a_busy_port_is_told_before_anything_is_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page's port is tried first."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert "address already in use" in _refused(tmp_path, capsys, "--port", port)


def test_a_missing_simulator_is_told_with_its_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without libsumo the line says what to install."""
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        "slipstream_lab.simulation.live.process.find_spec",
        lambda name: None if name == "libsumo" else find_spec(name),
    )
    line = _refused(tmp_path, capsys)
    assert line == "slipstream: libsumo is not installed; pip install 'slipstream-lab'"


@pytest.mark.parametrize(("text", "seconds"), [("07:30", 27000.0), ("7:30", 27000.0), ("0:00", 0)])
def test_a_time_of_day(text: str, seconds: float) -> None:
    """Hours and minutes since midnight."""
    assert time_of_day_s(text) == seconds


def test_the_minutes_line_has_accidents_apart() -> None:
    """Nothing of them where there are none; blocked roads only above one in a hundred trips."""
    names = [field.name for field in fields(WorldCounts)]
    nothing = {"safety": FleetSafety(), "others": OthersSafety(trips=300)}
    calm = WorldCounts(**dict.fromkeys(names, 0) | nothing)
    assert minute_line(calm).endswith("; 0 pictures")
    busy = replace(calm, safety=FleetSafety(collisions=1), others=OthersSafety(0, 2, 3, 300))
    assert minute_line(busy).endswith(
        "; fleet: 1 collision; others: 2 emergency stops, 3 teleports"
    )
    blocked = replace(calm, others=OthersSafety(teleports=4, trips=300))
    assert minute_line(blocked).endswith("4 teleports, above 1% of 300 trips: BLOCKED ROADS")


def test_daemons_are_set_for_the_world(tmp_path: Path) -> None:
    """Edges watch the cameras' addresses, the dispatcher plans the world's orders on its net, the
    page draws it; each settings file is one that its daemon takes. A route file of one's own need
    not know the fleet's vehicle.
    """
    routes = tmp_path / "mine.rou.xml"
    routes.write_text(
        '<routes><vehicle id="1" depart="0"><route edges="4th_adams-4th_liberty"/></vehicle>'
        "</routes>"
    )
    order = prepare_world(
        "troy",
        tmp_path,
        BusSettings(),
        routes=(routes,),
        begin_s=27000.0,
        cameras=2,
        fps=10.0,
        priority=True,
        seed=1,
    )
    keeping = tuple(rsu.model_copy(update={"keep_s": 90.0 * n}) for n, rsu in enumerate(order.rsus))
    order = replace(order, rsus=keeping)
    cameras = [
        CameraEndpoint(rsu.id, ("s",), f"http://127.0.0.1:{8000 + n}/", tmp_path / f"{rsu.id}.toml")
        for n, rsu in enumerate(order.rsus)
    ]
    place = place_of_world(
        tmp_path,
        order,
        cameras,
        bus_endpoint="tcp/127.0.0.1:1",
        dashboard_port=8080,
        interval_s=30.0,
    )
    path = tmp_path / "site.toml"
    daemons = write_site(path, place)
    assert sorted(daemons) == ["dashboard", "dispatcher", "rsu-01", "rsu-02", "vans"]
    assert daemons["rsu-02"] == ("edge", "--config", str(path), "--rsu", "rsu-02")
    edge = load_site(path, "edge", EdgeSettings, "rsu-02")
    assert (edge.source.url, edge.camera) == ("http://127.0.0.1:8001/", tmp_path / "rsu-02.toml")
    assert edge.stability.keep_s == 90.0
    dispatcher = load_site(path, "dispatcher", DispatcherSettings)
    assert dispatcher.network == str(order.day.net)
    assert Path(dispatcher.fleet).is_file()
    assert dispatcher.advice.eco_approach
    assert dispatcher.advice.signal_priority
    dashboard = load_site(path, "dashboard", DashboardSettings)
    assert (dashboard.network, dashboard.fleet) == (str(order.day.net), Path(dispatcher.fleet))
    assert (order.day.begin_s, order.day.routes) == (26700.0, (routes,))
    (types,) = order.day.additional
    assert 'id="cav"' in types.read_text()


def test_a_vehicle_has_moved_when_it_is_elsewhere() -> None:
    """Positions are counted, and vehicles that were seen at two places; noise is left out."""
    movement = FleetMovement()

    def tell(vehicle: str, segment: str, share: float) -> None:
        position = VehiclePosition(
            vehicle=vehicle,
            time_ns=0,
            segment=segment,
            share=share,
            speed_mps=1.0,
            on_road=True,
            cycle=1,
            leg=0,
        )
        movement.take("key", position.to_bytes())

    movement.take("key", b"noise")
    for place in (("van-1", "a", 0.5), ("van-1", "a", 0.6), ("van-2", "a", 0.1)):
        tell(*place)
    tell("van-2", "a", 0.1)
    assert movement.summary() == {"positions": 4, "vehicles_moved": 1}
