"""The reverse proxy, run for real before the real page's server."""

from __future__ import annotations

import base64
import http.client
import ssl
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from dashboard.server import start_server, stop_server
from slipstream.bus import free_port

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


@pytest.fixture
def proxy(tool: Callable[[str], str], tmp_path: Path) -> Iterator[int]:
    """Port of nginx with the shipped configuration before a viser server."""
    nginx, openssl = tool("nginx"), tool("openssl")
    _self_signed(openssl, tmp_path)
    hashed = subprocess.run(
        [openssl, "passwd", "-apr1", PASSWORD], capture_output=True, text=True, check=True
    ).stdout.strip()
    (tmp_path / "htpasswd").write_text(f"anna:{hashed}\n")
    page, plain, tls = free_port(), free_port(), free_port()
    text = (DEPLOY / "proxy" / "nginx.conf").read_text()
    for old, new in {
        "    listen [::]:80;\n": "",
        "    listen [::]:443 ssl http2;\n": "",
        "listen 80;": f"listen 127.0.0.1:{plain};",
        "listen 443 ": f"listen 127.0.0.1:{tls} ",
        "/etc/letsencrypt/live/slipstream.example.org": str(tmp_path),
        "/etc/nginx/slipstream.htpasswd": str(tmp_path / "htpasswd"),
        "127.0.0.1:8080": f"127.0.0.1:{page}",
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
    server = start_server("127.0.0.1", page)
    process = subprocess.Popen([nginx, "-c", str(main)], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 10
        while time.monotonic() < deadline:
            try:
                _get(tls, {})
                break
            except OSError:
                time.sleep(0.05)
        yield tls
    finally:
        process.terminate()
        process.wait(timeout=10)
        stop_server(server)


def _trusting() -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def _get(port: int, headers: dict[str, str]) -> int:
    connection = http.client.HTTPSConnection("127.0.0.1", port, context=_trusting(), timeout=10)
    try:
        connection.request("GET", "/", headers=headers)
        answer = connection.getresponse()
        answer.read()
        return answer.status
    finally:
        connection.close()


def test_only_who_logs_in_sees_the_page(proxy: int) -> None:
    """401 without a login or with a wrong one; the page with it, its live connection included."""
    assert _get(proxy, {}) == 401
    wrong = "Basic " + base64.b64encode(b"anna:guess").decode()
    assert _get(proxy, {"Authorization": wrong}) == 401
    assert _get(proxy, LOGIN) == 200
    from viser import __version__

    with connect(
        f"wss://127.0.0.1:{proxy}",
        ssl=_trusting(),
        additional_headers=LOGIN,
        subprotocols=[Subprotocol(f"viser-v{__version__}")],
        proxy=None,
    ) as socket:
        assert isinstance(socket.recv(timeout=10), bytes)
