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
from tests.dashboard.web.browser import SIZES, geometry_faults

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


def test_an_operator_in_a_browser(ports: Ports, browser: Any) -> None:
    """Past moments by the slider and played, a card that a reload keeps."""
    api, page = ports
    while (before := _cycles(api)) < 4:
        _until(lambda: _ask(api, "/v1/control/cycle", {})[0] == 202)
        _until(lambda before=before: _cycles(api) > before)
    _until(lambda: _ask(page, "/api/past")[1]["last"] is not None)
    tab = browser.new_page(viewport={"width": 1440, "height": 900})
    tab.set_default_timeout(1000 * WITHIN_S)
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))

    def until(condition: str) -> None:
        # The page's own policy forbids what `wait_for_function` does.
        _until(lambda: bool(tab.evaluate(condition)))

    tab.goto(f"http://127.0.0.1:{page}/?tab=cycles")
    tab.wait_for_selector("#pane-cycles tr[data-id='1']")
    live = tab.locator("#pane-cycles tr[data-id]").count()

    # The first moment that is kept has fewer cycles, played on there are more.
    tab.focus("#time-slider")
    tab.keyboard.press("Home")
    until("document.documentElement.dataset.time === 'past'")
    until(f"document.querySelectorAll('#pane-cycles tr[data-id]').length < {live}")
    begin = float(tab.url.partition("t=")[2])
    tab.select_option("#time-rate", "5")
    tab.click("#time-play")
    tab.wait_for_selector("#pane-cycles tr[data-id='2']")
    moment = "new URLSearchParams(location.search).get('t')"
    until(f"document.documentElement.dataset.time === 'live' || {moment} > {begin + 3000}")
    if tab.get_attribute("html", "data-time") == "past":
        tab.click("#time-live")
    until("document.documentElement.dataset.time === 'live'")

    # A card by its address, which is still there after a reload, with its plan.
    vehicle = _ask(api, "/v1/vehicles")[1]["vehicles"][0]["id"]
    tab.goto(f"http://127.0.0.1:{page}/#van/{vehicle}")
    for _ in range(2):
        until(f"document.getElementById('card-title').textContent === {json.dumps(vehicle)}")
        tab.wait_for_selector("#card-body .timeline")
        until("document.getElementById('card-body').textContent.includes('in the baseline')")
        tab.reload()
    tab.click("#pane-vehicles tr[data-id] >> nth=1")
    assert "#van/" in tab.url
    assert faults == []


def test_an_operators_actions_in_a_browser(ports: Ports, browser: Any) -> None:
    """A token is asked for; the dispatcher pauses, resumes, solves, lets a stop go and drops it.

    Each question keeps to its place at every width.
    """
    api, port = ports
    van = _ask(api, "/v1/vehicles")[1]["vehicles"][0]["id"]
    assert _ask(api, "/v1/orders", {"id": "o-2", "node": "c2"})[0] == 201
    tab = browser.new_page()
    tab.set_default_timeout(60_000)
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))

    def until(condition: str) -> None:
        _until(lambda: bool(tab.evaluate(condition)))

    def act(button: str, vehicle: str | None = None) -> None:
        if button.startswith("#control"):
            tab.click("#control summary")
        tab.click(button)
        if vehicle is not None:
            tab.select_option("#action-vehicle", vehicle)
        tab.fill("#action-reason", "road works")
        if tab.is_visible("#action-token"):
            tab.fill("#action-token", "operator")
        for width, height in SIZES.items():
            tab.set_viewport_size({"width": width, "height": height})
            assert geometry_faults(tab) == [], (button, width)
        tab.click("#action-send")
        until("document.getElementById('action-answer').dataset.level === 'ok'")
        until("document.getElementById('action-send').hidden")
        tab.click("#action-close")

    tab.goto(f"http://127.0.0.1:{port}/?tab=orders#order/o-2")
    tab.wait_for_selector("html[data-map]", state="attached")
    act("#control #pause")
    assert _ask(api, "/readyz")[1]["paused"]
    until("document.getElementById('next').textContent === 'dispatcher paused'")
    until("document.title.startsWith('(')")
    act("#control #resume")
    assert not _ask(api, "/readyz")[1]["paused"]
    before = _cycles(api)
    act("#control [data-action=solve]")
    _until(lambda: _cycles(api) > before)
    until("document.getElementById('card-title').textContent === 'o-2'")
    act("#card [data-action=pin]", van)
    _until(lambda: _ask(api, "/v1/orders/o-2")[1]["pinned"] == van)
    act("#card [data-action=release]")
    _until(lambda: _ask(api, "/v1/orders/o-2")[1]["pinned"] is None)
    act("#card [data-action=cancel]")
    _until(lambda: _ask(api, "/v1/orders/o-2")[1]["state"] == "cancelled")
    assert faults == []
