"""`slipstream router`: the router of this machine, with or without rules."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from slipstream.bus import Bus, free_port
from slipstream.bus.zenoh_config import read_config
from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream_cli.main import main


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.process
def test_programs_of_this_machine_talk_through_it() -> None:
    """Without a configuration; it ends on SIGTERM with status 0."""
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-m", "slipstream_cli", "router", "--port", str(port)]
    )
    settings = BusSettings(connect=(f"tcp/127.0.0.1:{port}",))
    try:
        with Bus.open(settings) as sender, Bus.open(settings) as receiver:
            seen = threading.Event()
            receiver.subscribe("slipstream/v1/test", lambda *_: seen.set())
            publisher = sender.publisher("slipstream/v1/test")
            publisher.put(b"x")
            assert seen.wait(60)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) == 0
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--config", "none.json5"], "none.json5: no such file"),
        (["--config", "none.json5", "--port", "7000"], "--port: is in the configuration"),
        (["--port", "0"], "--port: 0 is no port"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 2."""
    assert main(["router", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


@pytest.mark.parametrize("name", ["router.json5", "ROUTER.JSON5"])
def test_a_configuration_is_read_from_any_systems_editor(name: str, tmp_path: Path) -> None:
    """With a byte order mark, lines that end in CRLF, and its name in capitals."""
    path = tmp_path / name
    path.write_bytes(b'\xef\xbb\xbf// ours\r\n{\r\nmode: "router",\r\n}\r\n')
    assert read_config(path).get_json("mode") == '"router"'
    path.write_bytes('{mode: "router"}'.encode("utf-16"))
    with pytest.raises(InputError, match="UTF-16"):
        read_config(path)


def test_a_taken_port_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """It names the address."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["router", "--port", str(port)]) == 2
    assert f"127.0.0.1:{port}" in capsys.readouterr().err
