"""The operator's page and the real dispatcher: each action reaches it, with the caller's token."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from dispatcher_daemon.service.api import token_hash
from slipstream.bus import Router, free_port

pytestmark = [pytest.mark.process, pytest.mark.long]
WITHIN_S = 180.0
SCOPES = {"reader": ["read"], "operator": ["read", "orders", "control"]}
"""A token of each name; its text is its name."""


def _ask(port: int, path: str, body: Any = None, token: str = "operator") -> tuple[int, Any]:
    """GET, or POST of a body."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    try:
        method = "GET" if body is None else "POST"
        connection.request(method, path, None if body is None else json.dumps(body), headers)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline:
        try:
            if condition():
                return
        except OSError:
            pass
        time.sleep(0.2)
    raise AssertionError("it did not come about in time")


Ports = tuple[int, int]


@pytest.fixture(scope="module")
def ports(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ports]:
    """Ports of a dispatcher that has run its first cycle, and of its page."""
    folder, api, page = tmp_path_factory.mktemp("obeys"), free_port(), free_port()
    (folder / "tokens.toml").write_text(
        "".join(
            f'[[tokens]]\nname = "{name}"\nsha256 = "{token_hash(name.encode())}"\n'
            f"scopes = {json.dumps(scopes)}\n"
            for name, scopes in SCOPES.items()
        )
    )
    with Router() as router:
        common = (
            f'database_url = "sqlite:///{folder}/d.db"\n'
            f"[bus]\nconnect = [{json.dumps(router.endpoint)}]\n"
        )
        settings = {
            "dispatcher": f'{common}[dispatcher]\nsolvers = ["exact"]\ninterval_s = 600.0\n'
            "deadline_s = 2.0\n"
            f'[dispatcher.api]\nport = {api}\ntokens = "{folder}/tokens.toml"\n',
            "dashboard": f"{common}[dashboard]\nport = {page}\nscene_port = {free_port()}\n"
            f'dispatcher_api = "http://127.0.0.1:{api}"\n',
        }
        running = []
        try:
            for name, more in (("dispatcher", ()), ("dashboard", ("--allow-control",))):
                file = folder / f"{name}.toml"
                file.write_text(settings[name])
                command = [sys.executable, "-m", "slipstream_cli", name, "--config", str(file)]
                running.append(subprocess.Popen([*command, *more], cwd=folder))
            _until(lambda: _cycles(api) >= 1)
            _until(lambda: _ask(page, "/api/config")[0] == 200)
            yield api, page
        finally:
            for process in running:
                process.kill()
                process.wait()


def _cycles(api: int) -> int:
    return len(_ask(api, "/v1/cycles")[1]["cycles"])


def test_the_dispatcher_does_what_an_operator_asks_for_on_the_page(ports: Ports) -> None:
    """Pause, a cycle, resume, pin, release, cancel, acknowledge; a reader's token does nothing."""
    api, page = ports

    def act(action: str, subject: str, **more: str) -> str:
        body = {"action": action, "subject": subject, **more}
        status, document = _ask(page, "/api/actions", body)
        assert status == 200, document
        return str(document["text"])

    def order(name: str) -> dict[str, Any]:
        found: dict[str, Any] = _ask(api, f"/v1/orders/{name}")[1]
        return found

    def paused() -> bool:
        return bool(_ask(api, "/readyz")[1]["paused"])

    def alarms() -> dict[str, dict[str, Any]]:
        found = _ask(api, "/v1/alarms")[1]["alarms"]
        return {alarm["kind"]: alarm for alarm in found if alarm["ended_ns"] is None}

    pause = {"action": "pause", "subject": "dispatcher"}
    assert _ask(page, "/api/actions", pause, "reader")[0] == 403
    assert _ask(page, "/api/actions", pause, "nobody")[0] == 401
    assert not paused()

    before = _cycles(api)
    act("solve", "dispatcher")
    _until(lambda: _cycles(api) > before)
    assert "paused" in act("pause", "dispatcher", reason="road works")
    assert paused()
    _until(lambda: "paused" in alarms())
    act("acknowledge", f"alarm/{alarms()['paused']['id']}")
    assert alarms()["paused"]["acknowledged_by"] == "operator"
    act("resume", "dispatcher")
    assert not paused()

    vehicles = [row["id"] for row in _ask(api, "/v1/vehicles")[1]["vehicles"]]
    stop = "o-1"
    assert _ask(api, "/v1/orders", {"id": stop, "node": "c2"})[0] == 201
    act("pin", f"order/{stop}", vehicle=vehicles[0])
    assert order(stop)["pinned"] == vehicles[0]
    act("release", f"order/{stop}")
    assert order(stop)["pinned"] is None
    act("cancel", f"order/{stop}")
    assert order(stop)["state"] == "cancelled"
