"""`slipstream init`: files that fit each other, explained, and daemons that start on them."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from dashboard.settings import DashboardSettings
from dispatcher_daemon.fleet import Depot, Stop, Vehicle, load_fleet
from slipstream.bus import Bus, free_port
from slipstream.config import BusSettings
from slipstream.messages import ALL_PLANS, VehiclePlan, decode
from slipstream.osm.netconvert import find_netconvert
from slipstream.roads.sumo_net import load_network
from slipstream_cli.main import main
from slipstream_cli.place.commented import commented, toml
from slipstream_cli.place.layout import lay_out
from slipstream_cli.settings_doc import sections, site_sections
from slipstream_lab.commands.live.local import http_status

TROY = Path(
    str(resources.files("slipstream_lab.simulation.scenarios") / "data/troy/troy.net.xml.gz")
)
DEADLINE_S = 240.0


def made(folder: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    """The summary of `init`."""
    assert main(["init", str(folder), *options, "--json"]) == 0
    summary: dict[str, Any] = json.loads(capsys.readouterr().out)
    return summary


@pytest.mark.slow
@pytest.mark.parametrize("net", ["demo", str(TROY)], ids=["demo", "troy"])
def test_what_init_writes_is_valid(
    net: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`check` on all files finds no fault, and every stop can be served."""
    summary = made(tmp_path, capsys, "--net", net, "--vans", "3")
    files = [str(tmp_path / name) for name in summary["files"]]
    assert sorted(files) == sorted(str(path) for path in tmp_path.glob("*.toml"))
    assert main(["check", *files]) == 0
    said = capsys.readouterr()
    assert "cannot be served" not in said.out
    assert said.err == ""
    fleet = load_fleet(tmp_path / "fleet.toml", load_network(net))
    assert [vehicle.id for vehicle in fleet.vehicles] == ["van-1", "van-2", "van-3"]
    assert [depot.node for depot in fleet.depots] == [summary["depot"]]


@pytest.mark.slow
def test_every_key_is_explained_by_the_settings_own_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each key stands behind a comment, set or at its default; the text is the model's."""
    made(tmp_path, capsys)
    text = (tmp_path / "site.toml").read_text()
    words = " ".join(line.removeprefix("# ") for line in text.splitlines())
    for section in site_sections():
        for key in section.keys if section.path in ("", "edge", "dispatcher", "dashboard") else ():
            name = key.path.rpartition(".")[2]
            assert key.description.replace("`", "") in words, name
            assert re.search(rf"^#?{name} =", text, re.MULTILINE), name
    for before, line in pairwise(text.splitlines()):
        if re.match(r"[a-z_]+ = ", line) and not line.startswith(("id = ", "type = ")):
            assert before.startswith("# "), line


def test_keys_left_at_their_defaults_are_valid_once_uncommented() -> None:
    """What is shown is TOML that the model takes."""
    values = {"bus": {"connect": ["tcp/127.0.0.1:1"]}}
    text = commented(sections(DashboardSettings), values, "The page.")
    shown = re.sub(r"^#([a-z_]+ = )", r"\1", text, flags=re.MULTILINE)
    shown = re.sub(r"^#[a-z_]+ =$", "", shown, flags=re.MULTILINE)
    assert DashboardSettings.model_validate(tomllib.loads(shown)).port == 8080


@pytest.mark.parametrize("value", [{"a b": [1, 2.5]}, {"k": ['x"y', "ü\n"]}, {"t": {"u": True}}])
def test_values_come_back_from_one_line(value: dict[str, object]) -> None:
    """Inline tables and lists, quoted where they have to be."""
    assert tomllib.loads(f"v = {toml(value)}") == {"v": value}


@pytest.mark.parametrize("model", [Stop, Vehicle, Depot, DashboardSettings])
def test_each_key_that_a_user_may_set_has_words(model: type[BaseModel]) -> None:
    """Otherwise its comment would be empty."""
    assert [name for name, field in model.model_fields.items() if not field.description] == []


@pytest.mark.slow
def test_the_depot_is_nearest_to_the_place_or_in_the_middle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By coordinates of a junction; without them some junction inside."""
    network = load_network(TROY)
    assert network.projection is not None
    junction = "hoosick_5th"
    ((lat, lon),) = network.projection.degrees([network.junctions[junction]])
    summary = made(tmp_path / "a", capsys, "--net", str(TROY), "--at", f"{lat},{lon}")
    assert summary["depot"] == junction
    assert "Hoosick St" in summary["street"]
    x, y = network.junctions[lay_out(network, None).depot]
    x_min, y_min, x_max, y_max = network.bounds_m()
    assert x_min + 0.25 * (x_max - x_min) < x < x_max - 0.25 * (x_max - x_min)
    assert y_min + 0.25 * (y_max - y_min) < y < y_max - 0.25 * (y_max - y_min)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--net", str(TROY), "--at", "48.8,2.3"], "--at: the nearest road for a depot is"),
        (["--at", "here"], "--at: 'here' is no place"),
        (["--vans", "0"], "--vans: 0 is out of range"),
        (["--net", "none.net.xml"], "none.net.xml: no such file"),
        (["--osm", "none.osm"], "none.osm: no such file"),
        (["--rsu", "a/b"], "--rsu: 'a/b' is no name of a file"),
        (["--port", "9464"], "--port: 9464 is another daemon's"),
        (["--port", "9463"], "--port: 9464 is another daemon's"),
        (["--port", "65535"], "--port: 65535 is no port"),
    ],
)
def test_bad_input_writes_nothing(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit status 2."""
    folder = tmp_path / "new"
    assert main(["init", str(folder), *options]) == 2
    assert said in capsys.readouterr().err
    assert not folder.exists() or not list(folder.iterdir())


@pytest.mark.slow
def test_what_cannot_be_written_whole_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A disk that is full at the third file: none is left, so that `init` can be run again."""
    whole = Path.write_text
    names: list[str] = []

    def write(path: Path, *arguments: Any, **options: Any) -> int:
        names.append(path.name)
        if len(names) == 3:
            whole(path, "half of it")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return whole(path, *arguments, **options)

    monkeypatch.setattr(Path, "write_text", write)
    assert main(["init", str(tmp_path)]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_folder_that_is_not_empty_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is overwritten, and no second time either."""
    made(tmp_path, capsys)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert main(["init", str(tmp_path)]) == 2
    assert "not empty" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@contextmanager
def running(commands: dict[str, list[str]], folder: Path) -> Iterator[dict[str, Path]]:
    """Sub-commands in processes of their own; yields their logs."""
    logs = {name: folder / f"{name}.log" for name in commands}
    processes = []
    try:
        for name, words in commands.items():
            with logs[name].open("wb") as log:
                processes.append(
                    subprocess.Popen(
                        [sys.executable, "-m", "slipstream_cli", *words],
                        stdout=log,
                        stderr=subprocess.STDOUT,
                        cwd=folder,
                    )
                )
        yield logs
    finally:
        for process in processes:
            process.send_signal(signal.SIGTERM)
        for process in processes:
            try:
                process.wait(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait_for(condition: Callable[[], object], what: str, logs: dict[str, Path]) -> None:
    """Until it holds."""
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        if time.monotonic() > deadline:
            said = {name: log.read_text()[-2000:] for name, log in logs.items()}
            pytest.fail(f"no {what}: {said}")
        time.sleep(0.1)


def started(summary: dict[str, Any], capsys: pytest.CaptureFixture[str], browser: Any) -> None:
    """Start what `init` made, on free ports, until a plan from its depot is on its page; `status`
    then knows all of it, and that the camera is not there.
    """
    folder = Path(summary["folder"])
    ports = {old: free_port() for old in (7447, 8080, 8081, 9464, 9465, 9466, 9467)}
    for name in summary["files"]:
        text = (folder / name).read_text()
        for old, new in ports.items():
            text = re.sub(rf"\b{old}\b", str(new), text)
        text = text.replace("#interval_s = 30.0", "interval_s = 4.0")
        (folder / name).write_text(text.replace("#deadline_s = 10.0", "deadline_s = 1.5"))
    commands = {words[1]: words[1:] for words in (line.split() for line in summary["start"])}
    commands["router"] += ["--port", str(ports[7447])]
    del commands["edge"], commands["agent"]
    endpoint = f"tcp/127.0.0.1:{ports[7447]}"
    plans: list[VehiclePlan] = []
    with (
        running(commands, folder) as logs,
        Bus.open(BusSettings(connect=(endpoint,))) as bus,
    ):
        bus.subscribe(ALL_PLANS, lambda key, data: plans.append(decode(VehiclePlan, data, key)))
        page = f"http://127.0.0.1:{ports[8080]}/"
        wait_for(lambda: http_status(page) == 200, "page", logs)
        wait_for(lambda: plans, "plan", logs)
        with urllib.request.urlopen(f"{page}api/network", timeout=30) as answer:
            depots = json.load(answer)["depots"]
        assert [depot["id"] for depot in depots] == ["depot"]
        shown = browser.new_page(viewport={"width": 1440, "height": 900})
        shown.goto(page)
        stop = next(s.stop for s in plans[0].stops if s.stop != "depot")
        shown.get_by_text(stop).filter(visible=True).first.wait_for(timeout=120_000)
        shown.close()
        main(["status", "--bus", endpoint, "--seconds", "5", "--json"])
        findings = json.loads(capsys.readouterr().out)["findings"]
        told = {f["name"]: f for f in findings}
        assert told["bus"]["well"]
        assert told["dispatcher (bus)"]["well"]
        assert not told["RSU rsu-1"]["well"]
        own = [f for f in findings if str(ports[9465]) in f["text"] or "process" in f["text"]]
        assert {"router", "dispatcher", "dashboard"} <= {f["name"] for f in own}
    assert plans[0].stops[0].node == summary["depot"]


def extract() -> str:
    """A quarter of 6 by 6 crossings with street names, as OpenStreetMap has it."""
    count = 6
    nodes = "".join(
        f'<node id="{i * count + j + 1}" lat="{48.86 + 0.0016 * i:.5f}" '
        f'lon="{2.33 + 0.0022 * j:.5f}" version="1"/>'
        for i in range(count)
        for j in range(count)
    )
    ways = ""
    for k in range(count):
        row = [k * count + j + 1 for j in range(count)]
        column = [i * count + k + 1 for i in range(count)]
        for name, refs in ((f"Rue {k + 1}", row), (f"Avenue {k + 1}", column)):
            inner = "".join(f'<nd ref="{ref}"/>' for ref in refs)
            tags = f'<tag k="highway" v="residential"/><tag k="name" v="{name}"/>'
            ways += f'<way id="{len(ways) + 1}" version="1">{inner}{tags}</way>'
    return f'<osm version="0.6">{nodes}{ways}</osm>'


@pytest.mark.process
@pytest.mark.long
def test_from_an_extract_to_a_plan(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    tool: Callable[[str], str],
    browser: Any,
) -> None:
    """The net stands beside the files, its streets have names, and vans are dispatched on it."""
    if find_netconvert() is None:
        tool("netconvert")
    (tmp_path / "quarter.osm").write_text(extract())
    folder = tmp_path / "site"
    osm = ["--osm", str(tmp_path / "quarter.osm"), "--at"]
    assert main(["init", str(folder), *osm, "40,2"]) == 2
    assert not folder.exists()
    summary = made(folder, capsys, *osm, "48.8632,2.3344")
    assert summary["street"] == "Avenue 3, Rue 3"
    assert main(["check", *(str(folder / name) for name in summary["files"])]) == 0
    capsys.readouterr()
    started(summary, capsys, browser)
