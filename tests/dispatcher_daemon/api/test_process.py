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

from slipstream.bus import Router, free_port

from .conftest import write_tokens

WITHIN_S = 180.0


@contextmanager
def _dispatcher(folder: Path, endpoint: str, port: int) -> Iterator[subprocess.Popen[str]]:
    write_tokens(folder / "tokens.toml")
    (folder / "d.toml").write_text(
        f'database_url = "sqlite:///{folder}/d.db"\n'
        'solvers = ["exact"]\ninterval_s = 60.0\ndeadline_s = 2.0\n'
        f'[api]\nport = {port}\ntokens = "{folder}/tokens.toml"\n'
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


@pytest.mark.process
@pytest.mark.slow(long=True)
def test_a_dispatcher_serves_its_cycle_and_ends_in_time(router: Router, tmp_path: Path) -> None:
    """Ready once it runs, with the first cycle's plans; SIGTERM ends open streams, with status 0.

    What listens on the port already is bad input.
    """
    port = free_port()
    with _dispatcher(tmp_path, router.endpoint, port) as process:
        _until(lambda: _ask(port, "/readyz")[0] == 200, process)
        assert set(_ask(port, "/readyz")[1]["checks"]) == {"database", "bus", "network", "cycle"}
        _until(lambda: bool(_ask(port, "/v1/cycles", "reader")[1]["cycles"]), process)
        vehicles = _ask(port, "/v1/vehicles", "reader")[1]["vehicles"]
        assert [v["offered"]["cycle"] for v in vehicles] == [1, 1]
        assert _ask(port, "/v1/vehicles")[0] == 401
        other = (tmp_path / "d.toml").read_text().replace("/d.db", "/e.db")
        (tmp_path / "e.toml").write_text(other)
        second = subprocess.run(
            [sys.executable, "-m", "slipstream_cli", "dispatcher", "--config", "e.toml"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            timeout=WITHIN_S,
        )
        assert second.returncode == 2
        assert f"127.0.0.1:{port}: api.port: cannot serve the API" in second.stderr
        with socket.create_connection(("127.0.0.1", port), timeout=60) as stream:
            stream.sendall(
                b"GET /v1/events HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer reader\r\n\r\n"
            )
            assert stream.recv(12) == b"HTTP/1.1 200"
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=30) == 0
