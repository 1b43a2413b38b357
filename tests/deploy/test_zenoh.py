"""The router configurations: they parse, carry our messages, and let nobody else in."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from slipstream.bus import Bus, free_port
from slipstream.config import BusSettings
from slipstream.messages import ALL_PLANS, ALL_STATES, plan_key, state_key

from .conftest import DEPLOY

ZENOH = DEPLOY / "zenoh"


class Seen:
    """Collects payloads."""

    def __init__(self) -> None:
        self.payloads: list[bytes] = []

    def __call__(self, key: str, payload: bytes) -> None:
        self.payloads.append(payload)

    def wait_for(self, payload: bytes, timeout_s: float = 10.0) -> bool:
        """True once it has come."""
        deadline = time.monotonic() + timeout_s
        while payload not in self.payloads and time.monotonic() < deadline:
            time.sleep(0.02)
        return payload in self.payloads


def open_router(name: str, target: Path, replacements: dict[str, str]) -> zenoh.Session:
    """Open a router on a shipped configuration whose addresses and paths are replaced."""
    text = (ZENOH / name).read_text()
    for old, new in replacements.items():
        assert old in text
        text = text.replace(old, new)
    target.write_text(text)
    return zenoh.open(zenoh.Config.from_file(str(target)))


def open_bus(port: int) -> Bus:
    """A daemon's session."""
    return Bus.open(BusSettings(connect=(f"tcp/127.0.0.1:{port}",)))


@pytest.mark.parametrize("path", sorted(ZENOH.glob("*.json5")), ids=lambda path: path.name)
def test_every_configuration_is_private(path: Path) -> None:
    """They parse, scout for nobody, share no memory, and plain TCP is on loopback only."""
    config = zenoh.Config.from_file(str(path))
    assert config.get_json("scouting/multicast/enabled") == "false"
    assert config.get_json("scouting/gossip/enabled") == "false"
    assert config.get_json("transport/shared_memory/enabled") == "false"
    endpoints = config.get_json("listen/endpoints")
    assert "tcp/127.0.0.1:7447" in endpoints
    assert endpoints.count("tcp/") == 1


@pytest.mark.process
def test_the_service_carries_messages(tmp_path: Path) -> None:
    """router.py carries a state, and ends on SIGTERM with status 0."""
    port = free_port()
    config = tmp_path / "router.json5"
    config.write_text((ZENOH / "router.json5").read_text().replace(":7447", f":{port}"))
    process = subprocess.Popen([sys.executable, str(ZENOH / "router.py"), str(config)])
    try:
        with open_bus(port) as edge, open_bus(port) as dispatcher:
            seen = Seen()
            dispatcher.subscribe(ALL_STATES, seen)
            publisher = edge.publisher(state_key("rsu", "road"))
            publisher.put(b"state")
            assert seen.wait_for(b"state", 20)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=10) == 0
    finally:
        process.kill()
        process.wait()


@pytest.mark.process
def test_a_bad_configuration_is_one_line(tmp_path: Path) -> None:
    """Status 2, which systemd does not repeat, and the file's name."""
    broken = tmp_path / "router.json5"
    broken.write_text('{ mode: "router", nonsense: 1 }')
    for path in (broken, tmp_path / "missing.json5"):
        done = subprocess.run(
            [sys.executable, str(ZENOH / "router.py"), str(path)], capture_output=True, text=True
        )
        assert done.returncode == 2
        assert str(path) in done.stderr
        assert "Traceback" not in done.stderr


@pytest.fixture
def certificates(tool: Callable[[str], str], tmp_path: Path) -> Path:
    """A folder with a certificate authority, the server's and two boxes' certificates."""
    folder = tmp_path / "tls"
    folder.mkdir()
    openssl = tool("openssl")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-keyout")

    def run(*arguments: str) -> None:
        subprocess.run([openssl, *arguments], cwd=folder, check=True, capture_output=True)

    run("req", "-x509", *key, "ca.key", "-out", "ca.pem", "-days", "2", "-subj", "/CN=test ca")
    for name, host in (("server", "localhost"), ("box-1", "box-1"), ("box-2", "box-2")):
        (folder / "extensions").write_text(
            f"subjectAltName=DNS:{host}\nextendedKeyUsage=serverAuth,clientAuth\n"
        )
        run("req", *key, f"{name}.key", "-out", "request", "-subj", f"/CN={name}")
        run(
            *("x509", "-req", "-in", "request", "-CA", "ca.pem", "-CAkey", "ca.key"),
            *("-CAcreateserial", "-days", "2", "-extfile", "extensions", "-out", f"{name}.pem"),
        )
    return folder


@pytest.fixture
def sites(certificates: Path, tmp_path: Path) -> Iterator[dict[str, int]]:
    """Routers of the server and two boxes over mutual TLS; the local port of each."""
    ports = {name: free_port() for name in ("server", "box-1", "box-2")}
    tls = free_port()
    with ExitStack() as stack:
        server = open_router(
            "router-server.json5",
            tmp_path / "server.json5",
            {
                "/etc/slipstream/tls": str(certificates),
                "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{ports['server']}",
                "tls/0.0.0.0:7448": f"tls/127.0.0.1:{tls}",
            },
        )
        stack.callback(server.close)
        for box in ("box-1", "box-2"):
            router = open_router(
                "router-rsu.json5",
                tmp_path / f"{box}.json5",
                {
                    "/etc/slipstream/tls/box": str(certificates / box),
                    "/etc/slipstream/tls": str(certificates),
                    "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{ports[box]}",
                    "tls/SERVER:7448": f"tls/localhost:{tls}",
                },
            )
            stack.callback(router.close)
        yield ports


@pytest.mark.slow(long=True)
@pytest.mark.process
def test_a_box_publishes_its_own_keys_only(sites: dict[str, int]) -> None:
    """Its states arrive, early and live; another's name, a plan, or an unknown box's do not."""
    with (
        open_bus(sites["box-1"]) as box,
        open_bus(sites["box-2"]) as stranger,
        open_bus(sites["server"]) as server,
    ):
        state = box.publisher(state_key("rsu-1", "road"))
        state.put(b"before anybody listened")
        forged_state = box.publisher(state_key("rsu-9", "road"))
        forged_plan = box.publisher(plan_key("van"))
        unknown_box = stranger.publisher(state_key("rsu-1", "road"))
        states, plans, plans_at_box = Seen(), Seen(), Seen()
        server.subscribe(ALL_STATES, states)
        server.subscribe(ALL_PLANS, plans)
        box.subscribe(ALL_PLANS, plans_at_box)
        assert states.wait_for(b"before anybody listened", 15)
        for publisher in (forged_state, forged_plan, unknown_box):
            publisher.put(b"forged")
        server.publisher(plan_key("van")).put(b"plan")
        state.put(b"live")
        assert states.wait_for(b"live")
        assert plans.wait_for(b"plan")
        time.sleep(0.5)
        assert b"forged" not in states.payloads + plans.payloads
        assert b"plan" not in plans_at_box.payloads


@pytest.mark.slow(long=True)
@pytest.mark.process
def test_pictures_are_asked_for_through_the_wall(sites: dict[str, int]) -> None:
    """An RSU behind TLS and access control knows whether somebody looks at its pictures."""
    with open_bus(sites["box-1"]) as box, open_bus(sites["server"]) as server:
        pictures = box.publisher("slipstream/v1/rsu/rsu-1/preview", best_effort=True)
        assert not pictures.has_subscribers()
        seen = Seen()
        server.subscribe("slipstream/v1/rsu/*/preview", seen, history=False)
        deadline = time.monotonic() + 10
        while not pictures.has_subscribers() and time.monotonic() < deadline:
            time.sleep(0.05)
        pictures.put(os.urandom(50_000))
        deadline = time.monotonic() + 10
        while not seen.payloads and time.monotonic() < deadline:
            time.sleep(0.05)
        assert [len(payload) for payload in seen.payloads] == [50_000]
