"""`slipstream rsu` and `agent add`: one more, with all that belongs to it, or nothing at all."""

from __future__ import annotations

import json
import os
import shutil
import stat
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from slipstream_cli.commands import instances
from slipstream_cli.commands.instances import without_table
from slipstream_cli.main import main
from slipstream_cli.place.bus_files import prepare

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
URL = "rtsp://192.168.1.21/stream1"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """The shipped site, installed below a folder, and a second camera's calibration."""
    folder = tmp_path / "etc"
    folder.mkdir()
    for name in ("site.toml", "camera-rsu-1.toml"):
        text = (DEPLOY / "config" / name).read_text().replace("/etc/slipstream", str(folder))
        (folder / name).write_text(text)
    camera = (folder / "camera-rsu-1.toml").read_text()
    (folder / "camera-north.toml").write_text(camera.replace("avenue_east", "avenue_west"))
    # What the second process of agents takes over.
    path = folder / "site.toml"
    path.write_text(path.read_text().replace('\n[[agents.depot-1.vehicles]]\nid = "van-b"\n', "\n"))
    path.chmod(0o640)
    prepare(path, tmp_path)
    return path


@pytest.fixture
def call(site: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Runs a command on the site; `NORTH` is the second camera's calibration."""
    # It takes seconds to load, and is checked elsewhere.
    monkeypatch.setattr("edge_daemon.detection.open_detector", lambda settings: None)
    north = str(site.parent / "camera-north.toml")

    def run(*words: str) -> int:
        return main([*(north if w == "NORTH" else w for w in words), "--config", str(site)])

    return run


@pytest.fixture
def systemd(site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The site is the installed one, of a machine whose systemd writes down what it is asked."""
    program, asked = tmp_path / "bin" / "systemctl", tmp_path / "asked"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\n[ "$1" = cat ] || echo "$*" >>{asked}\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    monkeypatch.setattr(instances, "_INSTALLED", site)
    monkeypatch.setattr(instances, "_UNITS", tmp_path)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    return asked


def users_of(site: Path) -> set[str]:
    """The router's users."""
    lines = (site.parent / "bus" / "users").read_text().splitlines()
    return {line.partition(":")[0] for line in lines}


def files_of(site: Path) -> dict[str, str]:
    """All files of the folder."""
    return {str(p): p.read_text() for p in site.parent.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_a_camera_gets_table_password_and_rules(site: Path, call: Callable[..., int]) -> None:
    """The file's text and mode stay; segments are the calibration's, the port is a free one."""
    before = site.read_text()
    assert call("rsu", "add", "north", "--camera", "NORTH", "--url", URL) == 0
    after = site.read_text()
    assert after.startswith(before.rstrip())
    assert stat.S_IMODE(site.stat().st_mode) == 0o640
    table = tomllib.loads(after)["rsus"]["north"]
    assert (table["segments"], table["source"]["url"]) == (["avenue_west"], URL)
    assert table["metrics_port"] not in {9464, 9465, 9466, 9467, 8080, 8081}
    assert "edge-north" in users_of(site)
    access = json.loads((site.parent / "access.json").read_text())
    (rule,) = (rule for rule in access["rules"] if rule["id"] == "keys of north")
    assert "slipstream/v1/rsu/north/segment/avenue_west/state" in rule["key_exprs"]
    assert call("rsu", "remove", "north") == 0
    assert site.read_text() == before
    assert "edge-north" not in users_of(site)
    assert not (site.parent / "bus" / "edge-north").exists()


@pytest.mark.slow
def test_agents_get_table_passwords_and_rules(site: Path, call: Callable[..., int]) -> None:
    """Users for them and for what brings the vehicles' sensing, of these vehicles only."""
    assert call("agent", "add", "south", "--vehicles", "van-b", "--type", "van") == 0
    table = tomllib.loads(site.read_text())["agents"]["south"]
    assert table["vehicles"] == [{"id": "van-b", "type": {"preset": "van"}}]
    assert {"agent-south", "vehicle-south"} < users_of(site)
    rules = json.loads((site.parent / "access.json").read_text())["rules"]
    own = [rule for rule in rules if rule["id"].endswith("-south")]
    assert len(own) == 4
    assert all("van-b" in key for rule in own for key in rule["key_exprs"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("rsu add rsu-1 --camera NORTH --url rtsp://c/", "rsus.rsu-1: there is one of this name"),
        ("rsu add no.rth --camera NORTH --url rtsp://c/", "'no.rth' is no name"),
        (f"rsu add {'n' * 26} --camera NORTH --url rtsp://c/", "is no name"),
        ("rsu add north --camera missing.toml --url rtsp://c/", "missing.toml: no such file"),
        ("rsu add north --camera NORTH --url c", "rsus.north.source.url"),
        ("rsu add north --camera NORTH --clip missing.mp4", "missing.mp4"),
        ("rsu add north --camera NORTH --url rtsp://c/ --segments nowhere", "no segment nowhere"),
        ("rsu add north --camera NORTH", "give --camera and --url or --clip"),
        ("rsu add north --box box-1", "give --segments alone"),
        ("rsu add north --box a/b --segments avenue_west", "rsus.north.box"),
        ("rsu remove north", "there are: rsu-1; give one of them"),
        ("agent add south --vehicles van-z", "the fleet has no such vehicle"),
        ("agent add south --vehicles van-a", "agents.depot-1 has an agent of it too"),
        ("agent add south --vehicles van-b --type hovercraft", "agents.south.vehicles"),
    ],
)
def test_bad_input_is_one_line_and_changes_nothing(
    site: Path,
    call: Callable[..., int],
    words: str,
    named: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit status 2, and the files are as they were."""
    before = files_of(site)
    assert call(*words.split()) == 2
    told = capsys.readouterr().err
    assert (told.count("\n"), named in told) == (1, True), told
    assert ".candidate" not in told
    assert files_of(site) == before


@pytest.mark.slow
def test_the_server_is_told_of_a_box_and_the_box_of_the_server(
    site: Path, call: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    """Each prints the command for the other; no unit of the server's own is meant."""
    assert call("rsu", "add", "west", "--box", "box-1", "--segments", "avenue_west") == 0
    told = capsys.readouterr().out
    assert "on box-1: slipstream rsu add west --camera FILE --url URL" in told
    assert f"{site.parent / 'bus' / 'box-1'}; it stands in router.json5" in told
    assert "box-1" in users_of(site)
    assert "edge-west" not in users_of(site)
    assert call("agent", "add", "far", "--box", "van-9", "--vehicles", "van-9") == 0
    assert "on van-9: slipstream agent add far --vehicles van-9" in capsys.readouterr().out
    assert call("rsu", "remove", "west") == call("agent", "remove", "far") == 0
    shutil.copy(DEPLOY / "zenoh" / "router-rsu.json5", site.parent / "router.json5")
    capsys.readouterr()
    assert call("rsu", "add", "north", "--camera", "NORTH", "--url", URL) == 0
    words = "on the server: slipstream rsu add north --box box-1 --segments avenue_west"
    assert words in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("well", [True, False])
def test_an_installed_machine_is_brought_up_to_it(
    call: Callable[..., int],
    systemd: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    well: bool,
) -> None:
    """The router first, then who reads the file, then the new unit; status has the last word."""
    found = [("ok", "edge north", "ready"), ("ok" if well else "FAULT", "RSU north", "told")]
    monkeypatch.setattr(instances, "_findings", lambda kind, name: iter(found))
    monkeypatch.setattr(instances, "_GREEN_WITHIN_S", 0.5)
    assert call("rsu", "add", "north", "--camera", "NORTH", "--url", URL) == (0 if well else 1)
    assert systemd.read_text().splitlines() == [
        "daemon-reload",
        "restart slipstream-router",
        "try-restart slipstream-dispatcher slipstream-dashboard",
        "enable --now slipstream-edge@north",
    ]
    assert f"{'ok' if well else 'FAULT'}  RSU north  told" in capsys.readouterr().out
    systemd.unlink()
    assert call("rsu", "apply") == 0
    assert not systemd.exists()


@pytest.mark.slow
def test_a_file_that_the_unit_cannot_read_is_refused(
    site: Path, call: Callable[..., int], systemd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The mend is the command that puts it where it can be read."""
    (site.parent / "camera-north.toml").chmod(0o600)
    before = files_of(site)
    assert call("rsu", "add", "north", "--camera", "NORTH", "--url", URL) == 2
    assert "install -m 640 -g slipstream" in capsys.readouterr().err
    assert (files_of(site), systemd.exists()) == (before, False)


def test_who_is_not_root_is_told_so(
    call: Callable[..., int],
    systemd: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Before anything is read that only root may read."""
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert call("rsu", "add", "north", "--camera", "NORTH", "--url", URL) == 2
    assert "only root may change what is installed; run it with sudo" in capsys.readouterr().err


def test_a_table_goes_without_its_neighbours() -> None:
    """Comments before the next table are the next one's; a name that begins alike is another."""
    text = (
        "# of all\na = 1\n\n# of it\n[rsus.north]  # here\nb = 2\n\n[rsus.north.source]\nc = 3\n"
        "\n# of the next\n[rsus.north-1]\nd = 4\n\n[[agents.x.vehicles]]\ne = 5\n"
    )
    assert without_table(text, ("rsus", "north")) == (
        "# of all\na = 1\n\n# of it\n\n# of the next\n[rsus.north-1]\nd = 4\n\n"
        "[[agents.x.vehicles]]\ne = 5\n"
    )
    assert tomllib.loads(without_table(text, ("agents", "x"))).keys() == {"a", "rsus"}
