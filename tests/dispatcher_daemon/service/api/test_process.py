"""The API of the real dispatcher's process."""

from __future__ import annotations

import http.client
import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from slipstream.bus import Bus, Router, free_port
from slipstream.messages import (
    ALARMS_KEY,
    ALL_PLANS,
    Alarms,
    SegmentState,
    VehiclePlan,
    decode,
    rsu_health_key,
    state_key,
)
from storage import open_reader
from tests.dispatcher_daemon.service.feeds.states import health as rsu_health

from .conftest import write_tokens

WITHIN_S = 180.0


@contextmanager
def _dispatcher(folder: Path, endpoint: str, port: int) -> Iterator[subprocess.Popen[str]]:
    write_tokens(folder / "tokens.toml")
    (folder / "d.toml").write_text(
        f'database_url = "sqlite:///{folder}/d.db"\n'
        '[dispatcher]\nsolvers = ["exact"]\ninterval_s = 60.0\ndeadline_s = 2.0\n'
        f'[dispatcher.api]\nport = {port}\ntokens = "{folder}/tokens.toml"\n'
        f"[bus]\nconnect = [{json.dumps(endpoint)}]\n"
    )
    command = [sys.executable, "-m", "slipstream_cli", "dispatcher", "--config"]
    process = subprocess.Popen(
        [*command, str(folder / "d.toml")], stderr=subprocess.PIPE, text=True, cwd=folder
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate(timeout=30)


def _ask(port: int, path: str, token: str | None = None, body: Any = None) -> tuple[int, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    headers = {"Content-Type": "application/json"}
    if token is not None:
        headers["Authorization"] = f"Bearer {token}"
    try:
        method = "GET" if body is None else "POST"
        connection.request(method, path, None if body is None else json.dumps(body), headers)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


def _until(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline:
        assert process.poll() is None, process.communicate()[1]
        try:
            if condition():
                return
        except OSError:
            pass
        time.sleep(0.1)
    raise AssertionError("it did not come about in time")


@pytest.mark.long
@pytest.mark.process
def test_a_dispatcher_turns_states_into_plans_serves_them_and_ends_in_time(
    router: Router, bus: Bus, state: Callable[..., SegmentState], tmp_path: Path
) -> None:
    """States in and plans out over the bus, each stored and told over HTTP; SIGTERM ends open
    streams, with status 0.
    """
    port, sent = free_port(), list[VehiclePlan]()
    bus.subscribe(ALL_PLANS, lambda key, data: sent.append(decode(VehiclePlan, data, key)))
    segments = ("avenue_east", "avenue_west")
    outlets = {s: bus.publisher(state_key(f"rsu-{s}", s)) for s in segments}
    broken = bus.publisher(state_key("rsu-broken", "avenue_east"))

    def last() -> dict[str, Any]:
        (report, *_) = _ask(port, "/v1/cycles", "reader")[1]["cycles"] or [None]
        return (
            {} if report is None else dict(_ask(port, f"/v1/cycles/{report['cycle']}", "reader")[1])
        )

    def is_calm() -> bool:
        broken.put(b"not a state")
        for segment, outlet in outlets.items():
            outlet.put(state(segment, 1, time_ns=time.time_ns()))
        found = last()
        if found and [g["segment"] for g in found["report"]["gates"] if g["open"]] == [*segments]:
            return True
        _ask(port, "/v1/control/cycle", "controller", {})
        return False

    with _dispatcher(tmp_path, router.endpoint, port) as process:
        _until(lambda: _ask(port, "/readyz")[0] == 200, process)
        assert set(_ask(port, "/readyz")[1]["checks"]) == {
            *("database", "bus", "network", "cycle", "solvers", "rsus", "vehicles")
        }
        _until(is_calm, process)
        found = last()
        assert found["report"]["status"] == "ok"
        _until(lambda: {p.cycle for p in sent} >= {found["report"]["cycle"]}, process)
        told = [p.model_dump(mode="json") for p in sent if p.cycle == found["report"]["cycle"]]
        assert sorted(told, key=lambda plan: plan["vehicle"]) == found["plans"]
        assert {plan["vehicle"] for plan in told} == {"van-a", "van-b"}
        assert _ask(port, "/v1/vehicles")[0] == 401
        with socket.create_connection(("127.0.0.1", port), timeout=60) as stream:
            stream.sendall(
                b"GET /v1/events HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer reader\r\n\r\n"
            )
            assert stream.recv(12) == b"HTTP/1.1 200"
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=30) == 0


@pytest.mark.nightly
@pytest.mark.process
def test_a_pause_and_alarms_outlive_the_process(router: Router, bus: Bus, tmp_path: Path) -> None:
    """An RSU without a picture and a pause are alarms on the bus and over HTTP; SIGKILL, and the
    next process is paused and has both, with who acknowledged what.
    """
    port, told = free_port(), list[Alarms]()
    bus.subscribe(ALARMS_KEY, lambda key, data: told.append(decode(Alarms, data, key)))
    health = rsu_health("rsu-a", status="no_signal")
    publisher = bus.publisher(rsu_health_key("rsu-a"))

    def alarms() -> dict[str, dict[str, Any]]:
        publisher.put(health)
        found = _ask(port, "/v1/alarms", "reader")[1]["alarms"]
        return {alarm["kind"]: alarm for alarm in found if alarm["ended_ns"] is None}

    with _dispatcher(tmp_path, router.endpoint, port) as process:
        _until(lambda: bool(_ask(port, "/v1/cycles", "reader")[1]["cycles"]), process)
        _until(lambda: _ask(port, "/v1/control/cycle", "controller", {})[0] == 202, process)
        _until(lambda: len(_ask(port, "/v1/cycles", "reader")[1]["cycles"]) == 2, process)
        assert _ask(port, "/v1/control/pause", "controller", {})[1]["paused"]
        _until(lambda: {"paused", "rsu_no_signal"} <= set(alarms()), process)
        before = alarms()
        path = f"/v1/alarms/{before['rsu_no_signal']['id']}/acknowledge"
        before["rsu_no_signal"] = _ask(port, path, "controller", {"by": "Ada"})[1]
        kinds = {"paused", "rsu_no_signal"}
        _until(lambda: {alarm.kind for alarm in told[-1].alarms} == kinds, process)
        _until(lambda: len(_ask(port, "/v1/log", "reader")[1]["entries"]) >= 5, process)
        process.kill()
        process.wait(timeout=30)
    with _dispatcher(tmp_path, router.endpoint, port) as process:
        _until(lambda: _ask(port, "/readyz")[1]["paused"], process)
        assert {kind: alarm["id"] for kind, alarm in alarms().items()} == {
            kind: alarm["id"] for kind, alarm in before.items()
        }
        assert alarms()["rsu_no_signal"]["acknowledged_by"] == "Ada"
        assert len(_ask(port, "/v1/cycles", "reader")[1]["cycles"]) == 2
        assert _ask(port, "/v1/control/resume", "controller", {})[0] == 200
        _until(lambda: len(_ask(port, "/v1/cycles", "reader")[1]["cycles"]) == 3, process)
        _until(lambda: "paused" not in alarms(), process)
    with open_reader(f"sqlite:///{tmp_path}/d.db") as reader:
        log = {(event.kind, event.actor) for event in reader.events(0, 2**62, limit=100)}
    assert {("pause", "controller"), ("resume", "controller"), ("cycle", "controller")} <= log
    assert {("acknowledge", "controller"), ("rsu_no_signal", None), ("paused", None)} <= log
