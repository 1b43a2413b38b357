"""`slipstream dashboard --database`: a finished run, served by the real process."""

from __future__ import annotations

import http.client
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from slipstream.bus import free_port
from slipstream_cli.main import main
from tests.dashboard.web.past.stored import S, store_run

BEGIN_NS = 1_790_000_040 * S


def ask(port: int, path: str) -> tuple[int, Any]:
    """Status and JSON of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


@pytest.mark.long
@pytest.mark.process
def test_a_finished_run_is_shown_without_bus_and_settings(tmp_path: Path, world: Any) -> None:
    """The page opens at its last moment, follows nothing, and changes nothing."""
    database = tmp_path / "run.db"
    store_run(f"sqlite:///{database}", world, BEGIN_NS)
    stored = database.read_bytes()
    port = free_port()
    command = [sys.executable, "-m", "slipstream_cli", "dashboard"]
    process = subprocess.Popen(
        [*command, "--database", f"sqlite:///{database}", "--port", str(port)],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        deadline = time.monotonic() + 60
        while True:
            try:
                status, config = ask(port, "/api/config")
                break
            except OSError:
                assert process.poll() is None, process.communicate()[1]
                assert time.monotonic() < deadline
                time.sleep(0.1)
        assert status == 200
        assert (config["live"], config["history"], config["control"]) == (False, True, False)
        assert config["scene_url"] is None
        _, span = ask(port, "/api/past")
        assert span["last"] == BEGIN_NS // 10**6 + 600_000
        status, moment = ask(port, f"/api/at?t={span['last']}")
        assert (status, moment["vehicles"]["van-a"]["cycle"]) == (200, 3)
        assert ask(port, "/api/vehicles/van-a")[1]["cycle"] == 3
        assert ask(port, "/api/live")[0] == 404
    finally:
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 0, errors
    assert database.read_bytes() == stored


@pytest.mark.slow
def test_what_cannot_be_shown_is_one_line(
    tmp_path: Path, world: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """No database, another network, options that contradict; status 2."""
    url = f"sqlite:///{tmp_path / 'run.db'}"
    for arguments, told in (
        ([], "give --config or --database"),
        (["--database", url], "no cycle is stored there"),
        (["--database", url, "--allow-control"], "a finished run obeys nobody"),
        (["--database", "nowhere"], "not a database URL"),
        (["--database", url, "--port", "70000"], "port"),
    ):
        assert main(["dashboard", *arguments]) == 2, arguments
        errors = capsys.readouterr().err
        assert told in errors
        assert len(errors.splitlines()) == 1
