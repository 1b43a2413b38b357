"""The reverse proxy, run for real before the real page's server."""

from __future__ import annotations

import asyncio
import base64
import http.client
import json
import logging
import ssl
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin, Subprotocol

from dashboard.live import Snapshot
from dashboard.server import start_server, stop_server
from dashboard.settings import DashboardSettings
from dashboard.view.places import Places
from dashboard.web.app import make_app
from dashboard.web.hub import PageHub
from dashboard.web.services import Known, PageServices
from dashboard.web.tables.rows import Scene
from slipstream.bus import free_port
from slipstream.http.server import HttpServer
from slipstream.roads.sumo_net import load_network

from .conftest import DEPLOY

PASSWORD = "open sesame"
LOGIN = {"Authorization": "Basic " + base64.b64encode(f"anna:{PASSWORD}".encode()).decode()}


def _self_signed(openssl: str, folder: Path) -> None:
    subprocess.run(
        [
            *(openssl, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"),
            *("-nodes", "-keyout", "privkey.pem", "-out", "fullchain.pem", "-days", "2"),
            *("-subj", "/CN=localhost"),
        ],
        cwd=folder,
        check=True,
        capture_output=True,
    )


class _Echo(BaseHTTPRequestHandler):
    """The API's place: it answers with the headers that came."""

    def do_GET(self) -> None:
        body = json.dumps({name.lower(): value for name, value in self.headers.items()}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        pass


NAME = "slipstream.example.org"
"""The server name in the shipped configuration."""


@pytest.fixture(params=[(NAME,)])
def proxy(
    request: pytest.FixtureRequest, tool: Callable[[str], str], tmp_path: Path
) -> Iterator[int]:
    """Port of nginx with the shipped configuration before both pages, which allow a name."""
    nginx, openssl = tool("nginx"), tool("openssl")
    _self_signed(openssl, tmp_path)
    hashed = subprocess.run(
        [openssl, "passwd", "-apr1", PASSWORD], capture_output=True, text=True, check=True
    ).stdout.strip()
    (tmp_path / "htpasswd").write_text(f"anna:{hashed}\n")
    scene, plain, tls = free_port(), free_port(), free_port()
    page = HttpServer("the operator's page", "127.0.0.1", 0, "port")
    api = ThreadingHTTPServer(("127.0.0.1", 0), _Echo)
    text = (DEPLOY / "proxy" / "nginx.conf").read_text()
    for old, new in {
        "    listen [::]:80;\n": "",
        "    listen [::]:443 ssl http2;\n": "",
        "listen 80;": f"listen 127.0.0.1:{plain};",
        "listen 443 ": f"listen 127.0.0.1:{tls} ",
        "/etc/letsencrypt/live/slipstream.example.org": str(tmp_path),
        "/etc/nginx/slipstream.htpasswd": str(tmp_path / "htpasswd"),
        "127.0.0.1:8080": f"127.0.0.1:{page.port}",
        "127.0.0.1:8081": f"127.0.0.1:{scene}",
        "127.0.0.1:8090": f"127.0.0.1:{api.server_port}",
    }.items():
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "site.conf").write_text(text)
    main = tmp_path / "nginx.conf"
    temporary = "".join(
        f"{kind}_temp_path {tmp_path}/{kind};"
        for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    main.write_text(
        f"daemon off; master_process off; pid {tmp_path}/pid; error_log {tmp_path}/error.log;"
        f"events {{}} http {{ access_log off; {temporary} include {tmp_path}/site.conf; }}"
    )
    checked = subprocess.run([nginx, "-t", "-c", str(main)], capture_output=True, text=True)
    assert checked.returncode == 0, checked.stderr
    assert "warn" not in checked.stderr
    server = start_server("127.0.0.1", scene, request.param)
    network = load_network("demo")
    settings = DashboardSettings(allowed_hosts=request.param)
    nothing = Known(Snapshot(), {"t": 0, "seq": 0, "rsus": {}}, 0)
    services = PageServices(settings, Scene(Places(network)), lambda: nothing, PageHub())
    page.start(make_app(services))
    threading.Thread(target=api.serve_forever, daemon=True).start()
    process = subprocess.Popen([nginx, "-c", str(main)], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            try:
                _get(tls, {})
                break
            except OSError:
                time.sleep(0.05)
        yield tls
    finally:
        process.terminate()
        process.wait(timeout=60)
        stop_server(server)
        page.close()
        api.shutdown()
        api.server_close()


def _trusting() -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def _fetch(port: int, path: str, headers: dict[str, str]) -> tuple[int, bytes]:
    connection = http.client.HTTPSConnection("127.0.0.1", port, context=_trusting(), timeout=60)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def _get(port: int, headers: dict[str, str]) -> int:
    return _fetch(port, "/", headers)[0]


@pytest.mark.slow
def test_only_who_logs_in_sees_the_page(proxy: int) -> None:
    """401 without a login or with a wrong one; the page with it, its live connection included."""
    assert _get(proxy, {}) == 401
    wrong = "Basic " + base64.b64encode(b"anna:guess").decode()
    assert _get(proxy, {"Authorization": wrong}) == 401
    assert _get(proxy, {**LOGIN, "Host": NAME}) == 200
    assert _fetch(proxy, "/3d/", {**LOGIN, "Host": NAME})[0] == 200
    assert _fetch(proxy, "/3d/", {"Host": NAME})[0] == 401
    status, body = _fetch(proxy, "/api/config", {**LOGIN, "Host": NAME})
    assert (status, json.loads(body)["live"]) == (200, True)
    assert isinstance(asyncio.run(_first_message(proxy, f"https://{NAME}")), bytes)


@pytest.mark.slow
def test_the_api_gets_tokens_and_no_login_is_asked_for(proxy: int) -> None:
    """Below /v1/ the token passes, with what tells that it came through the proxy; the probes and
    metrics beside it stay behind the login, where the page is.
    """
    status, body = _fetch(proxy, "/v1/vehicles", {"Authorization": "Bearer x", "Host": NAME})
    assert status == 200
    seen = json.loads(body)
    assert seen["authorization"] == "Bearer x"
    assert (seen["x-forwarded-for"], seen["host"]) == ("127.0.0.1", NAME)
    assert [_fetch(proxy, path, {})[0] for path in ("/metrics", "/readyz")] == [401] * 2


@pytest.mark.slow
@pytest.mark.attack
def test_other_sites_are_kept_out_behind_the_proxy_too(proxy: int) -> None:
    """With a browser's login: a rebound name and a script of another site get 403."""
    assert _get(proxy, {**LOGIN, "Host": "rebound.example"}) == 403
    assert _get(proxy, {**LOGIN, "Host": NAME, "Origin": "https://foreign.example"}) == 403
    with pytest.raises(InvalidStatus, match="403"):
        asyncio.run(_first_message(proxy, "https://foreign.example"))


@pytest.mark.slow
@pytest.mark.parametrize("proxy", [()], indirect=True)
def test_a_proxy_that_is_not_allowed_is_told_which_key_is_missing(
    proxy: int, caplog: pytest.LogCaptureFixture
) -> None:
    """A page whose proxy's name is not allowed answers 403, and the log says what to set."""
    with caplog.at_level(logging.WARNING):
        assert [_get(proxy, {**LOGIN, "Host": NAME}) for _ in range(5)] == [403] * 5
    (line,) = caplog.messages
    assert f"'{NAME}'" in line
    assert "allowed_hosts" in line


async def _first_message(proxy: int, origin: str) -> str | bytes:
    """Of the 3D page's live connection.

    Not by the client with threads: two of them in one TLS connection may wait for each other.
    """
    from viser import __version__

    async with (
        asyncio.timeout(60),
        connect(
            f"wss://{NAME}/3d",
            host="127.0.0.1",
            port=proxy,
            ssl=_trusting(),
            origin=Origin(origin),
            additional_headers=LOGIN,
            subprotocols=[Subprotocol(f"viser-v{__version__}")],
            proxy=None,
        ) as page,
    ):
        return await page.recv()
