"""`slipstream status`: what runs, worst first, and the exit status."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zenoh

from slipstream.bus import Bus, Publisher, Router, free_port
from slipstream.bus.zenoh_config import router_config
from slipstream.config import BusSettings, ServiceSettings
from slipstream.errors import InputError
from slipstream.messages import (
    DISPATCHER_HEALTH_KEY,
    DispatcherHealth,
    Message,
    RsuHealth,
    rsu_health_key,
)
from slipstream_cli import running
from slipstream_cli.commands.status import BusHeard, Finding, of_bus, of_units
from slipstream_cli.main import main
from slipstream_cli.running import Running, command_of, router_fault
from vehicle_agent.settings import AgentSettings


def rsu(**values: Any) -> RsuHealth:
    """A healthy RSU's message."""
    now = time.time_ns()
    base: dict[str, Any] = {
        "rsu": "rsu-1",
        "time_ns": now,
        "started_ns": now,
        "source": "rtsp",
        "segments": ("a",),
        "status": "ok",
        "frames": 9,
        "frames_skipped": 0,
        "decode_errors": 0,
        "reconnects": 0,
        "states": 3,
        "fps": 14.9,
        "latency_ms_p50": 20.0,
        "latency_ms_p95": 30.0,
        "vehicles_in_view": 2,
        "rss_mb": 300.0,
    }
    return RsuHealth(**base | values)


def dispatcher(**values: Any) -> DispatcherHealth:
    """A healthy dispatcher's message."""
    now = time.time_ns()
    base: dict[str, Any] = {
        "time_ns": now,
        "started_ns": now,
        "cycles": 7,
        "cycles_failed": 0,
        "states_received": 1,
        "bad_messages": 0,
        "next_cycle_ns": None,
        "rss_mb": 200.0,
    }
    return DispatcherHealth(**base | values)


def publish(bus: Bus, messages: dict[str, Message]) -> list[Publisher]:
    """Publish each on its key; as long as the publishers are held, who comes late gets it too."""
    publishers = []
    for key, message in messages.items():
        publisher = bus.publisher(key, history=1)
        publisher.put(message)
        publishers.append(publisher)
    return publishers


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> list[Running]:
    """A machine on which nothing runs but what a test adds."""
    found: list[Running] = []
    monkeypatch.setattr(running, "processes", lambda: found)
    monkeypatch.setattr(running, "units", lambda: iter(()))
    return found


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("/opt/bin/python /opt/bin/slipstream edge --config e.toml", ("edge", "--config e.toml")),
        ("python -m slipstream_cli dispatcher --config=d.toml", ("dispatcher", "--config=d.toml")),
        ("python /opt/slipstream/share/router.py r.json5", ("router", "--config r.json5")),
        ("vim slipstream", None),
        ("slipstream check edge", None),
        ("slipstream_cli edge", None),
        ("", None),
    ],
)
def test_daemons_are_known_by_their_command_lines(
    line: str, expected: tuple[str, str] | None
) -> None:
    """However they are started; other programs are none."""
    found = command_of(line.split())
    assert (None if found is None else (found[0], " ".join(found[1]))) == expected


def test_a_router_that_another_refuses_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A connection that stays is a link; a router that connects nowhere needs none."""
    monkeypatch.setattr(running, "_LINK_S", 0.01)
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        path = tmp_path / "router.json5"
        path.write_text(json.dumps({"mode": "router", "connect": {"endpoints": [endpoint]}}))
        router = Running("router", os.getpid(), 0.0, path, None)
        refused = router_fault(router) or ""
        assert refused.startswith(f"a router listens at {endpoint} and does not let it in")
        with socket.create_connection(server.getsockname()):
            assert router_fault(router) is None
    assert router_fault(router) == f"no router answers at {endpoint}"
    path.write_text('{mode: "router"}')
    assert router_fault(router) is None
    assert router_fault(replace(router, config=None)) is None


def test_nothing_that_runs_is_a_fault(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit status 1, one line."""
    assert main(["status", "--seconds", "0.1"]) == 1
    assert capsys.readouterr().out == "FAULT  slipstream  nothing of it runs on this machine\n"


@pytest.mark.long
def test_what_is_wrong_comes_first(router: Router, capsys: pytest.CaptureFixture[str]) -> None:
    """A camera without a signal, before the dispatcher and the RSU that are well."""
    with Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        sent = {rsu_health_key(h.rsu): h for h in (rsu(), rsu(rsu="rsu-2", status="no_signal"))}
        kept = publish(bus, {**sent, DISPATCHER_HEALTH_KEY: dispatcher()})
        assert main(["status", "--bus", router.endpoint, "--seconds", "2", "--json"]) == 1
        assert len(kept) == 3
    answer = json.loads(capsys.readouterr().out)
    assert answer["well"] is False
    first, *others = answer["findings"]
    assert (first["name"], first["text"]) == ("RSU rsu-2", "no signal from its camera")
    assert {f["name"] for f in others} == {"bus", "RSU rsu-1", "dispatcher (bus)"}
    assert all(f["well"] for f in others)


@pytest.mark.long
@pytest.mark.slow
def test_a_message_of_another_version_is_one_line(
    router: Router, capfd: pytest.CaptureFixture[str]
) -> None:
    """An RSU that was upgraded before this machine: neither a traceback nor silence."""
    newer = json.loads(rsu().model_dump_json()) | {"of_tomorrow": 1}
    key = rsu_health_key("rsu-1")
    with Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        publisher = bus.publisher(key, history=1)
        publisher.put(json.dumps(newer).encode())
        assert main(["status", "--bus", router.endpoint, "--seconds", "2"]) == 1
    said = capfd.readouterr()
    assert said.err == ""
    first, *others = said.out.splitlines()
    assert first.startswith(f"FAULT  {key}  not a RsuHealth")
    assert len(others) == 1


def test_an_expected_rsu_that_cannot_be_read_is_told_once() -> None:
    """Not also as one of which nothing was heard."""
    heard = BusHeard(True, unreadable={rsu_health_key("a"): "not a RsuHealth"})
    found = _found(heard, "a", "b")
    assert set(found) == {"bus", rsu_health_key("a"), "RSU b"}
    assert not found[rsu_health_key("a")].well


@pytest.mark.long
def test_all_well_is_exit_status_0(router: Router, capsys: pytest.CaptureFixture[str]) -> None:
    """One line each."""
    with Bus.open(BusSettings(connect=(router.endpoint,))) as bus:
        kept = publish(bus, {DISPATCHER_HEALTH_KEY: dispatcher()})
        assert main(["status", "--bus", router.endpoint, "--seconds", "2"]) == 0
        assert len(kept) == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("ok ") for line in lines)


def test_a_daemon_is_asked_for_its_health(
    alone: list[Running], capsys: pytest.CaptureFixture[str]
) -> None:
    """A metrics port that nobody answers, and a router that is not there."""
    port = free_port()
    settings = AgentSettings.model_validate(
        {
            "vehicles": [{"id": "v"}],
            "service": ServiceSettings(metrics_port=port),
            "bus": {"connect": [f"tcp/127.0.0.1:{port}"]},
        }
    )
    alone.append(Running("agent", os.getpid(), time.time(), Path("/x/a.toml"), settings))
    assert main(["status", "--seconds", "0.2"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert any("health: no answer" in line for line in lines)
    assert any("no router answers" in line for line in lines)


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[str]:
    """The endpoint of a router that lets in who knows the password of `dispatcher`."""
    (tmp_path / "users").write_text("dispatcher:right\n")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = router_config(endpoint)
    key = "transport/auth/usrpwd/dictionary_file"
    config.insert_json5(key, json.dumps(str(tmp_path / "users")))
    session = zenoh.open(config)
    yield endpoint
    session.close()


def installed(folder: Path, endpoint: str, password: str | None) -> Running:
    """A daemon whose unit has handed it its settings and its password in a folder."""
    folder.mkdir(exist_ok=True)
    if password is not None:
        (folder / "bus-password").write_text(f"{password}\n")
    bus = {"connect": [endpoint], "user": "dispatcher", "password_file": "bus-password"}
    settings = AgentSettings.model_validate({"vehicles": [{"id": "v"}], "bus": bus})
    return Running("agent", os.getpid(), time.time(), folder / "a.toml", settings)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("by_environment", [True, False])
def test_a_sound_installation_is_exit_status_0(
    alone: list[Running],
    guarded: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    by_environment: bool,
) -> None:
    """The password is looked for where systemd has put it for the daemon, not for this command."""
    daemon = installed(tmp_path / "credentials", guarded, "right")
    if by_environment:
        found = {"CREDENTIALS_DIRECTORY": str(tmp_path / "credentials")}
        monkeypatch.setattr("psutil.Process.environ", lambda process: found)
        daemon = replace(daemon, config=Path("/elsewhere/a.toml"))
    alone.append(daemon)
    assert main(["status", "--seconds", "2"]) == 0
    assert f"connected to {guarded}" in capsys.readouterr().out
    assert main(["status", "--bus", guarded, "--seconds", "2"]) == 0


@pytest.mark.long
def test_a_wrong_password_is_told_apart_from_a_dead_router(
    alone: list[Running], guarded: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each has another mend."""
    alone.append(installed(tmp_path / "credentials", guarded, "wrong"))
    assert main(["status", "--seconds", "0.5"]) == 1
    assert f"a router listens at {guarded} and does not let it in" in capsys.readouterr().out
    dead = f"tcp/127.0.0.1:{free_port()}"
    alone[:] = [installed(tmp_path / "credentials", dead, None)]
    assert main(["status", "--seconds", "0.5"]) == 1
    assert f"FAULT  bus    no router answers at {dead}".split() in [
        line.split() for line in capsys.readouterr().out.splitlines()
    ]


def test_what_cannot_be_read_is_unknown_and_not_well(
    alone: list[Running], guarded: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A password, and settings, that root alone may read: with the mend, and exit status 1."""
    alone.append(installed(tmp_path / "credentials", guarded, None))
    unread = InputError(Path("/run/credentials/d.toml"), "Permission denied", "check the path")
    alone.append(Running("dispatcher", 1, time.time(), Path("/x/d.toml"), None, unread))
    assert main(["status", "--seconds", "0.2", "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    found = {f["name"]: f for f in answer["findings"]}
    assert answer["well"] is None
    assert (found["bus"]["well"], found["dispatcher"]["well"]) == (None, None)
    assert "bus-password cannot be read (no such file); run it as root" in found["bus"]["text"]
    assert "Permission denied" in found["dispatcher"]["text"]
    alone[:] = alone[1:]
    assert main(["status", "--bus", guarded, "--seconds", "0.2", "--json"]) == 1
    bus = {f["name"]: f for f in json.loads(capsys.readouterr().out)["findings"]}["bus"]
    assert (bus["well"], "run it as root" in bus["text"]) == (None, True)


def _found(heard: BusHeard, *expected: str) -> dict[str, Finding]:
    found = of_bus(heard, BusSettings(), {*expected}, time.time_ns(), needed=True)
    return {finding.name: finding for finding in found}


def test_what_the_bus_tells_is_judged_by_age_and_content() -> None:
    """Silence, a camera's fault, an RSU that was never heard, a damaged database."""
    old = time.time_ns() - 60 * 10**9
    heard = BusHeard(
        True,
        {
            "a": rsu(rsu="a", time_ns=old),
            "b": rsu(rsu="b", fault="camera_moved"),
            "c": rsu(rsu="c", status="ended"),
            "d": rsu(rsu="d"),
        },
        dispatcher(database_set_aside="x.db"),
    )
    found = _found(heard, "d", "e")
    assert "silent for 6" in found["RSU a"].text
    assert "camera moved" in found["RSU b"].text
    assert "ended" in found["RSU c"].text
    assert "nothing heard" in found["RSU e"].text
    assert "x.db" in found["dispatcher (bus)"].text
    assert {name for name, finding in found.items() if finding.well} == {"bus", "RSU d"}
    silent = _found(BusHeard(True, {}, dispatcher(time_ns=old)))["dispatcher (bus)"]
    assert (silent.well, "silent for 6" in silent.text) == (False, True)
    fault = "no solver works (exact: BrokenProcessPool: All workers expired)"
    unsolved = _found(BusHeard(True, {}, dispatcher(solver_fault=fault)))["dispatcher (bus)"]
    assert (unsolved.well, unsolved.text.partition(";")[0]) == (False, fault)
    bus, now = BusSettings(), time.time_ns()
    unheard = {
        f.name: f for f in of_bus(BusHeard(True), bus, set(), now, needed=True, has_dispatcher=True)
    }
    assert unheard["dispatcher (bus)"].well is False
    paused = _found(BusHeard(True, {}, dispatcher(paused=True)))["dispatcher (bus)"]
    assert (paused.well, paused.text.partition(";")[0]) == (False, "paused: no cycle runs")


def test_units_are_told_unless_nobody_wants_them() -> None:
    """Failed ones, enabled ones that do not run; disabled ones are left out."""
    units = [
        {"Id": "slipstream-a", "ActiveState": "active", "SubState": "running"},
        {"Id": "slipstream-b", "ActiveState": "failed", "SubState": "failed", "Result": "oom"},
        {"Id": "slipstream-c", "ActiveState": "inactive", "UnitFileState": "enabled"},
        {"Id": "slipstream-d", "ActiveState": "inactive", "UnitFileState": "disabled"},
    ]
    found = {finding.name[-1]: finding.well for finding in of_units(units)}
    assert found == {"a": True, "b": False, "c": False}
