"""The operator's page and the real dispatcher: each action reaches it, with the caller's token."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from dispatcher_daemon.service.api import token_hash
from slipstream.bus import Router, free_port
from tests.dashboard.web.browser import SIZES, geometry_faults

pytestmark = [pytest.mark.process, pytest.mark.slow(long=True)]
WITHIN_S = 180.0
SCOPES = {"reader": ["read"], "operator": ["read", "orders", "control"]}
"""A token of each name; its text is its name."""


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Callable[..., None]]:
    """Starts `slipstream NAME --config FILE`; the process ends with the test."""
    running = []

    def start(name: str, settings: str, *more: str) -> None:
        file = tmp_path / f"{name}.toml"
        file.write_text(settings)
        command = [sys.executable, "-m", "slipstream_cli", name, "--config", str(file), *more]
        running.append(subprocess.Popen(command, cwd=tmp_path))

    yield start
    for process in running:
        process.kill()
        process.wait()


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


@pytest.fixture
def daemons(
    router: Router, tmp_path: Path, started: Callable[..., None]
) -> Callable[[float], Ports]:
    """Starts a dispatcher with so many seconds between cycles and its page; their ports."""

    def start(interval_s: float) -> Ports:
        api, page = free_port(), free_port()
        (tmp_path / "tokens.toml").write_text(
            "".join(
                f'[[tokens]]\nname = "{name}"\nsha256 = "{token_hash(name.encode())}"\n'
                f"scopes = {json.dumps(scopes)}\n"
                for name, scopes in SCOPES.items()
            )
        )
        common = (
            f'database_url = "sqlite:///{tmp_path}/d.db"\n'
            f"[bus]\nconnect = [{json.dumps(router.endpoint)}]\n"
        )
        started(
            "dispatcher",
            f'{common}[dispatcher]\nsolvers = ["exact"]\ninterval_s = {interval_s}\n'
            f"deadline_s = 2.0\n[dispatcher.api]\nport = {api}\n"
            f'tokens = "{tmp_path}/tokens.toml"\n',
        )
        started(
            "dashboard",
            f"{common}[dashboard]\nport = {page}\nscene_port = {free_port()}\n"
            f'dispatcher_api = "http://127.0.0.1:{api}"\n',
            "--allow-control",
        )
        return api, page

    return start


def test_the_dispatcher_does_what_an_operator_asks_for_on_the_page(
    daemons: Callable[[float], Ports],
) -> None:
    """Pause, a cycle, resume, pin, release, cancel, acknowledge; a reader's token does nothing."""
    api, page = daemons(600.0)

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

    def cycles() -> int:
        return len(_ask(api, "/v1/cycles")[1]["cycles"])

    def alarms() -> dict[str, dict[str, Any]]:
        found = _ask(api, "/v1/alarms")[1]["alarms"]
        return {alarm["kind"]: alarm for alarm in found if alarm["ended_ns"] is None}

    _until(lambda: cycles() >= 1)
    _until(lambda: _ask(page, "/api/config")[0] == 200)
    pause = {"action": "pause", "subject": "dispatcher"}
    assert _ask(page, "/api/actions", pause, "reader")[0] == 403
    assert _ask(page, "/api/actions", pause, "nobody")[0] == 401
    assert not paused()

    before = cycles()
    act("solve", "dispatcher")
    _until(lambda: cycles() > before)
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


def test_an_operator_in_a_browser(daemons: Callable[[float], Ports], browser: Any) -> None:
    """Past moments by the slider and played, a card that a reload keeps."""
    api, page = daemons(4.0)
    _until(lambda: len(_ask(api, "/v1/cycles")[1]["cycles"]) >= 4)
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


@pytest.mark.parametrize("width", SIZES)
def test_an_operators_actions_in_a_browser(
    daemons: Callable[[float], Ports], browser: Any, width: int
) -> None:
    """A token is asked for; the dispatcher pauses, resumes, solves, lets a stop go and drops it."""
    api, port = daemons(600.0)
    _until(lambda: len(_ask(api, "/v1/cycles")[1]["cycles"]) >= 1)
    _until(lambda: _ask(port, "/api/config")[0] == 200)
    van = _ask(api, "/v1/vehicles")[1]["vehicles"][0]["id"]
    assert _ask(api, "/v1/orders", {"id": "o-1", "node": "c2"})[0] == 201
    tab = browser.new_page(viewport={"width": width, "height": SIZES[width]})
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
        assert geometry_faults(tab) == [], button
        tab.click("#action-send")
        until("document.getElementById('action-answer').dataset.level === 'ok'")
        until("document.getElementById('action-send').hidden")
        tab.click("#action-close")

    tab.goto(f"http://127.0.0.1:{port}/?tab=orders#order/o-1")
    tab.wait_for_selector("html[data-map]", state="attached")
    act("#control #pause")
    assert _ask(api, "/readyz")[1]["paused"]
    until("document.getElementById('next').textContent === 'dispatcher paused'")
    until("document.title.startsWith('(')")
    act("#control #resume")
    assert not _ask(api, "/readyz")[1]["paused"]
    before = len(_ask(api, "/v1/cycles")[1]["cycles"])
    act("#control [data-action=solve]")
    _until(lambda: len(_ask(api, "/v1/cycles")[1]["cycles"]) > before)
    until("document.getElementById('card-title').textContent === 'o-1'")
    act("#card [data-action=pin]", van)
    _until(lambda: _ask(api, "/v1/orders/o-1")[1]["pinned"] == van)
    act("#card [data-action=release]")
    _until(lambda: _ask(api, "/v1/orders/o-1")[1]["pinned"] is None)
    act("#card [data-action=cancel]")
    _until(lambda: _ask(api, "/v1/orders/o-1")[1]["state"] == "cancelled")
    assert faults == []
