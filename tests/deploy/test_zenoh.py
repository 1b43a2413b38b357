"""The router configurations: they parse, carry our messages, and let nobody else in."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from slipstream.bus import Bus, free_port
from slipstream.bus.zenoh_config import RECEIVE_LIMIT_BYTES, TRANSMIT_QUEUE
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_ORDERS,
    ALL_PLANS,
    ALL_STATES,
    ALL_STOPPED,
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    acknowledgement_key,
    advice_key,
    bare_preview_key,
    counts_key,
    driver_key,
    order_key,
    plan_key,
    platoon_control_key,
    platoon_management_key,
    position_key,
    preview_key,
    progress_key,
    rsu_health_key,
    running_counts_key,
    sensing_key,
    signal_request_key,
    signal_status_key,
    spat_key,
    state_key,
    stopped_key,
)
from slipstream.roads.sumo_net import load_network
from slipstream_cli.daemons import router
from slipstream_cli.place.bus_files import ACCESS, access_of

from .conftest import DEPLOY

ZENOH = DEPLOY / "zenoh"
ROUTER = DEPLOY.parent / "slipstream_cli" / "daemons" / "router.py"


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


USERS = (
    *("dispatcher", "dashboard", "fleet", "signals", "edge-rsu-1", "box-1", "box-2", "van-1"),
    *("agent-depot-1", "vehicle-depot-1", "agent-van-1", "vehicle-van-1"),
    *("orders", "control", "planner-1"),
)
CREDENTIALS = "/run/credentials/slipstream-router.service"


@pytest.fixture
def users(tmp_path: Path) -> Path:
    """A folder with the router's dictionary and a password file for each user."""
    folder = tmp_path / "users"
    folder.mkdir()
    (folder / "bus-users").write_text("".join(f"{user}:secret of {user}\n" for user in USERS))
    for user in USERS:
        (folder / user).write_text(f"secret of {user}\n")
    return folder


SITES = {
    "router.json5": """
        [rsus.rsu-1]
        segments = ["avenue_east"]
        camera = "camera.toml"
        [agents.depot-1]
        vehicles = [{ id = "van-1" }, { id = "van-2" }]
    """,
    "router-server.json5": """
        [rsus.rsu-1]
        segments = ["avenue_east"]
        box = "box-1"
        [agents.van-1]
        vehicles = [{ id = "van-1" }]
        box = "van-1"
    """,
    "router-rsu.json5": """
        [rsus.rsu-1]
        segments = ["avenue_east"]
        camera = "camera.toml"
    """,
    "router-vehicle.json5": """
        [agents.van-1]
        vehicles = [{ id = "van-1" }]
    """,
}
"""What stands in the `site.toml` beside each router's configuration."""


def open_router(name: str, target: Path, replacements: dict[str, str]) -> zenoh.Session:
    """Open a router on a shipped configuration whose addresses and paths are replaced."""
    text = (ZENOH / name).read_text()
    for old, new in replacements.items():
        assert old in text
        text = text.replace(old, new)
    target.parent.mkdir()
    target.write_text(text)
    access = access_of(tomllib.loads(SITES[name]))
    target.with_name(ACCESS).write_text(json.dumps(access))
    return router.open_router(target)


def open_bus(port: int, password_file: Path | None, user: str | None = None) -> Bus:
    """A daemon's session; its user is the password file's name, or another."""
    if password_file is not None and user is None:
        user = password_file.name
    return Bus.open(
        BusSettings(connect=(f"tcp/127.0.0.1:{port}",), user=user, password_file=password_file)
    )


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


@pytest.mark.attack
@pytest.mark.parametrize("path", sorted(ZENOH.glob("*.json5")), ids=lambda path: path.name)
def test_what_a_session_sends_is_limited(path: Path) -> None:
    """Sessions and their messages are bounded, and everybody has a password."""
    config = zenoh.Config.from_file(str(path))
    assert int(config.get_json("transport/unicast/max_sessions")) == 64
    assert int(config.get_json("transport/link/rx/max_message_size")) == RECEIVE_LIMIT_BYTES
    assert {key: int(config.get_json(key)) for key in TRANSMIT_QUEUE} == TRANSMIT_QUEUE
    assert f"{CREDENTIALS}/bus-users" in config.get_json("transport/auth/usrpwd/dictionary_file")
    assert config.get_json("access_control/default_permission") == '"deny"'


@pytest.fixture
def machine(users: Path, tmp_path: Path) -> Iterator[int]:
    """The router of a single machine; its port."""
    port = free_port()
    replaced = {"127.0.0.1:7447": f"127.0.0.1:{port}", CREDENTIALS: str(users)}
    with open_router("router.json5", tmp_path / "machine" / "router.json5", replaced):
        yield port


def arrived(seen: Seen) -> set[str]:
    """Who said what, without when."""
    return {payload.decode().rsplit(" ", 1)[0] for payload in seen.payloads}


PROBES = {
    "state": state_key("rsu-1", "avenue_east"),
    "another segment's state": state_key("rsu-1", "avenue_west"),
    "another RSU's state": state_key("rsu-2", "avenue_east"),
    "stopped": stopped_key("rsu-1", "avenue_east"),
    "counts": counts_key("rsu-1", "avenue_east"),
    "another RSU's counts": counts_key("rsu-2", "avenue_east"),
    "running counts": running_counts_key("rsu-1", "avenue_east"),
    "another segment's stopped": stopped_key("rsu-1", "avenue_west"),
    "another RSU's stopped": stopped_key("rsu-2", "avenue_east"),
    "health": rsu_health_key("rsu-1"),
    "picture": preview_key("rsu-1"),
    "bare picture": bare_preview_key("rsu-1"),
    "plan": plan_key("van-1"),
    "another's plan": plan_key("truck"),
    "cycle": CYCLE_KEY,
    "dispatcher's health": DISPATCHER_HEALTH_KEY,
    "position": position_key("van-1"),
    "acknowledgement": acknowledgement_key("van-1"),
    "progress": progress_key("van-1"),
    "another's position": position_key("truck"),
    "another's acknowledgement": acknowledgement_key("truck"),
    "another's progress": progress_key("truck"),
    "control": platoon_control_key("avenue_west", "van-1"),
    "another's control": platoon_control_key("avenue_west", "truck"),
    "management": platoon_management_key("truck", "van-1"),
    "another's management": platoon_management_key("van-1", "truck"),
    "timing": spat_key("crossing"),
    "status": signal_status_key("crossing"),
    "request": signal_request_key("crossing", "van-1"),
    "another's request": signal_request_key("crossing", "truck"),
    "sensing": sensing_key("van-1"),
    "another's sensing": sensing_key("truck"),
    "driver": driver_key("van-1"),
    "another's driver": driver_key("truck"),
    "advice": advice_key("van-1"),
    "another's advice": advice_key("truck"),
}
KEPT = {
    *("state", "counts", "health", "cycle", "dispatcher's health", "acknowledgement", "progress"),
    *("plan", "another's plan", "another's acknowledgement", "another's progress"),
}
"""What publishers keep for subscribers that come late; the rest is of the moment."""
MAY = {
    "dispatcher": {"plan", "another's plan", "cycle", "dispatcher's health"},
    "dashboard": set(),
    "fleet": {
        *("position", "acknowledgement", "progress"),
        *("another's position", "another's acknowledgement", "another's progress"),
    },
    "edge-rsu-1": {
        *("state", "stopped", "counts", "running counts"),
        *("health", "picture", "bare picture"),
    },
    "signals": {"timing", "status"},
    "agent-depot-1": {
        *("position", "acknowledgement", "progress"),
        *("control", "management", "request", "advice"),
    },
    "vehicle-depot-1": {"sensing", "driver"},
}
HEARS = {
    "edge-rsu-1": set(),
    "signals": {"request", "another's request"},
    "agent-depot-1": {
        *("plan", "another's management", "control", "another's control"),
        *("timing", "status", "state", "sensing", "driver"),
    },
    "vehicle-depot-1": {"advice"},
}
"""Of what others may publish; dispatcher, dashboard and `fleet` hear everything."""


@pytest.mark.attack
@pytest.mark.long
@pytest.mark.process
def test_each_daemon_publishes_its_own_keys_only(
    machine: int, users: Path, figure: Callable[[str], None]
) -> None:
    """Everything by everybody: what is a user's own arrives early and live, nothing else does.

    Those that may not hear everything listen for everything too.
    """
    with ExitStack() as stack:
        publishers = {}
        for user in MAY:
            bus = stack.enter_context(open_bus(machine, users / user))
            for what, key in PROBES.items():
                publisher = bus.publisher(
                    key, best_effort=what.endswith("picture"), history=int(what in KEPT)
                )
                publisher.put(f"{user}: {what} early".encode())
                publishers[user, what] = publisher
        listening = {}
        for user in ("dashboard", *HEARS):
            bus = stack.enter_context(open_bus(machine, users / user))
            listening[user] = Seen()
            bus.subscribe("slipstream/v1/**", listening[user], every=True)
            if user != "dashboard":
                for key in (*PROBES.values(), "slipstream/v1/platoon/avenue_west/*"):
                    bus.subscribe(key, listening[user], every=True)
        seen = listening["dashboard"]
        own = [(user, what) for user, allowed in MAY.items() for what in allowed]
        for user, what in own:
            if what in KEPT:
                assert seen.wait_for(f"{user}: {what} early".encode(), 20), (user, what)
        for (user, what), publisher in publishers.items():
            publisher.put(f"{user}: {what} live".encode())
        for user, what in own:
            assert seen.wait_for(f"{user}: {what} live".encode()), (user, what)
            for listener, hears in HEARS.items():
                if what in hears:
                    found = listening[listener].wait_for(f"{user}: {what} live".encode())
                    assert found, (listener, user, what)
        time.sleep(0.5)
        assert arrived(seen) == {f"{user}: {what}" for user, what in own}
        for listener, hears in HEARS.items():
            expected = {f"{user}: {what}" for user, what in own if what in hears}
            assert arrived(listening[listener]) == expected, listener
        figure(f"{len(publishers) - len(own)} of {len(publishers)} pairs of user and key denied")


@pytest.mark.attack
@pytest.mark.process
def test_an_agent_speaks_for_no_pattern_of_names(machine: int, users: Path) -> None:
    """One message on a pattern of keys that reaches beyond its own vehicles is dropped."""
    with (
        open_bus(machine, users / "agent-depot-1") as agent,
        open_bus(machine, users / "dashboard") as dashboard,
    ):
        seen = Seen()
        dashboard.subscribe("slipstream/v1/**", seen, every=True)
        position = agent.publisher(PROBES["progress"])
        position.put(b"own")
        assert seen.wait_for(b"own", 20)
        for pattern in ("fleet/*/position", "platoon/*/*", "signal/*/request/*", "fleet/**", "**"):
            agent._session.put(f"slipstream/v1/{pattern}", b"forged")
        position.put(b"after")
        assert seen.wait_for(b"after")
        assert set(seen.payloads) == {b"own", b"after"}


@pytest.mark.long
@pytest.mark.attack
@pytest.mark.process
def test_who_may_not_order_is_not_heard_by_the_dispatcher(machine: int, users: Path) -> None:
    """Nor by a pattern; who orders may not pin, nor the other way, and nobody else answers."""
    asked: list[str] = []

    def answer(key: str, payload: bytes) -> tuple[bool, bytes]:
        asked.append(f"{payload.decode()} {key.rpartition('/')[2]}")
        return True, b"taken"

    def forge(key: str, payload: bytes) -> tuple[bool, bytes]:
        return True, b"forged"

    with ExitStack() as stack:
        others = ("dashboard", "fleet", "signals", "agent-depot-1", "edge-rsu-1")
        buses = {
            user: stack.enter_context(open_bus(machine, users / user))
            for user in ("dispatcher", "orders", "control", *others)
        }
        for user in others:
            buses[user].answer(ALL_ORDERS, forge)
        buses["dispatcher"].answer(ALL_ORDERS, answer)
        key, ends = order_key("o", "submit"), time.monotonic() + 20.0
        while buses["orders"].ask(key, b"orders", 5.0) != (True, b"taken"):
            assert time.monotonic() < ends
        for user in others:
            for action in ("submit", "cancel", "pin", "release", "show"):
                assert buses[user].ask(order_key("o", action), user.encode(), 1.0) != (
                    True,
                    b"taken",
                )
            for pattern in ("slipstream/v1/order/*/submit", "slipstream/v1/**"):
                assert buses[user].ask(pattern, user.encode(), 1.0) != (True, b"taken")
        for user, action in (("orders", "cancel"), ("control", "pin"), ("control", "release")):
            answered = buses[user].ask(order_key("o", action), user.encode(), 5.0)
            assert answered == (True, b"taken"), action
        for user, actions in (("orders", ("pin", "release")), ("control", ("submit", "cancel"))):
            for action in (*actions, "*"):
                assert buses[user].ask(order_key("o", action), user.encode(), 1.0) is None
        expected = {"orders submit", "orders cancel", "control pin", "control release"}
        assert set(asked) == expected


@pytest.mark.attack
@pytest.mark.long
@pytest.mark.process
@pytest.mark.parametrize("role", ["nobody", "wrong password", "unknown user"])
def test_a_plan_without_the_dispatchers_password_is_denied(
    machine: int, users: Path, tmp_path: Path, role: str
) -> None:
    """Without a user, with a user's name and another's password, or as a new user: no session."""
    guess = tmp_path / "guess"
    guess.write_text("secret of dashboard")
    password_file, user = {
        "nobody": (None, None),
        "wrong password": (guess, "dispatcher"),
        "unknown user": (guess, "mallory"),
    }[role]
    with (
        open_bus(machine, password_file, user) as forger,
        open_bus(machine, users / "dispatcher") as dispatcher,
        open_bus(machine, users / "fleet") as fleet,
    ):
        plans, overheard = Seen(), Seen()
        fleet.subscribe(ALL_PLANS, plans)
        forger.subscribe(ALL_PLANS, overheard)
        publisher = dispatcher.publisher(plan_key("van"))
        forged = forger.publisher(plan_key("van"))
        forged.put(b"forged")
        publisher.put(b"plan")
        assert plans.wait_for(b"plan", 20)
        # The forger tries to connect once a second, if not more often.
        time.sleep(3.0)
        forged.put(b"forged")
        publisher.put(b"next plan")
        assert plans.wait_for(b"next plan")
        time.sleep(0.5)
        assert b"forged" not in plans.payloads
        assert overheard.payloads == [b"forged"] * len(overheard.payloads)


@pytest.mark.process
def test_an_identity_goes_with_a_configuration_file_too(
    machine: int, users: Path, tmp_path: Path
) -> None:
    """Settings with `config_file` need no password in that file."""
    file = tmp_path / "session.json5"
    endpoint = f"tcp/127.0.0.1:{machine}"
    file.write_text(
        f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}, '
        "scouting: {multicast: {enabled: false}}, timestamping: {enabled: true}}"
    )
    identity = {"user": "dashboard", "password_file": users / "dashboard"}
    with (
        Bus.open(BusSettings(config_file=file, **identity)) as dashboard,
        open_bus(machine, users / "edge-rsu-1") as edge,
    ):
        seen = Seen()
        dashboard.subscribe(ALL_STATES, seen)
        publisher = edge.publisher(PROBES["state"])
        publisher.put(b"state")
        assert seen.wait_for(b"state", 20)


@pytest.mark.long
@pytest.mark.process
def test_the_service_carries_messages(tmp_path: Path, users: Path) -> None:
    """router.py carries a state, and ends on SIGTERM with status 0."""
    port = free_port()
    config = tmp_path / "router.json5"
    text = (ZENOH / "router.json5").read_text().replace(":7447", f":{port}")
    config.write_text(text.replace(CREDENTIALS, str(users)))
    access = access_of(tomllib.loads(SITES["router.json5"]))
    config.with_name(ACCESS).write_text(json.dumps(access))
    process = subprocess.Popen([sys.executable, str(ROUTER), str(config)])
    try:
        with (
            open_bus(port, users / "edge-rsu-1") as edge,
            open_bus(port, users / "dispatcher") as dispatcher,
        ):
            seen = Seen()
            dispatcher.subscribe(ALL_STATES, seen)
            publisher = edge.publisher(PROBES["state"])
            publisher.put(b"state")
            assert seen.wait_for(b"state", 20)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=10) == 0
    finally:
        process.kill()
        process.wait()


@pytest.mark.long
@pytest.mark.process
def test_a_bad_configuration_is_one_line(tmp_path: Path) -> None:
    """Status 2, which systemd does not repeat, and the file's name."""
    broken = tmp_path / "router.json5"
    broken.write_text('{ mode: "router", nonsense: 1 }')
    shutil.copy(ZENOH / "router.json5", tmp_path / "sound.json5")
    (tmp_path / ACCESS).write_text('{"rules": 1}')
    for path in (broken, tmp_path / "missing.json5", tmp_path / "sound.json5"):
        done = subprocess.run(
            [sys.executable, str(ROUTER), str(path)], capture_output=True, text=True
        )
        assert done.returncode == 2
        named = tmp_path / ACCESS if path.name == "sound.json5" else path
        assert str(named) in done.stderr
        assert "Traceback" not in done.stderr


BOXES = {
    "box-1": "router-rsu.json5",
    "box-2": "router-rsu.json5",
    "van-1": "router-vehicle.json5",
}


@pytest.fixture
def certificates(tool: Callable[[str], str], tmp_path: Path) -> Path:
    """A folder with a certificate authority, the server's and three boxes' certificates."""
    folder = tmp_path / "tls"
    folder.mkdir()
    openssl = tool("openssl")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-keyout")

    def run(*arguments: str) -> None:
        subprocess.run([openssl, *arguments], cwd=folder, check=True, capture_output=True)

    run("req", "-x509", *key, "ca.key", "-out", "ca.pem", "-days", "2", "-subj", "/CN=test ca")
    for name in ("server", "planner-1", *BOXES):
        host = "localhost" if name == "server" else name
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
def sites(certificates: Path, users: Path, tmp_path: Path) -> Iterator[dict[str, int]]:
    """Routers of the server, two RSUs' and a vehicle's box over mutual TLS; their local ports."""
    ports = {name: free_port() for name in ("server", *BOXES)}
    tls = free_port()
    with ExitStack() as stack:
        server = open_router(
            "router-server.json5",
            tmp_path / "server" / "router.json5",
            {
                f"{CREDENTIALS}/router.key": str(certificates / "server.key"),
                CREDENTIALS: str(users),
                "/etc/slipstream/tls/router.pem": str(certificates / "server.pem"),
                "/etc/slipstream/tls": str(certificates),
                "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{ports['server']}",
                "tls/0.0.0.0:7448": f"tls/127.0.0.1:{tls}",
            },
        )
        stack.callback(server.close)
        for box, file in BOXES.items():
            name = "van-1" if box == "van-1" else "box-1"
            opened = open_router(
                file,
                tmp_path / box / "router.json5",
                {
                    f"{CREDENTIALS}/router.key": str(certificates / f"{box}.key"),
                    CREDENTIALS: str(users),
                    "/etc/slipstream/tls/router.pem": str(certificates / f"{box}.pem"),
                    "/etc/slipstream/tls": str(certificates),
                    "tcp/127.0.0.1:7447": f"tcp/127.0.0.1:{ports[box]}",
                    "tls/SERVER:7448": f"tls/localhost:{tls}",
                    f'user: "{name}"': f'user: "{box}"',
                    'password: "PASSWORD"': f'password: "secret of {box}"',
                },
            )
            stack.callback(opened.close)
        yield {**ports, "tls": tls}


@pytest.mark.attack
@pytest.mark.long
@pytest.mark.process
def test_a_certificate_orders_only_with_the_right(
    sites: dict[str, int], users: Path, certificates: Path
) -> None:
    """A client over TLS that may order orders and does no more; one without the right is denied."""
    asked: list[str] = []

    def answer(key: str, payload: bytes) -> tuple[bool, bytes]:
        asked.append(f"{payload.decode()} {key}")
        return True, b"answered"

    def client(name: str) -> zenoh.Session:
        config = zenoh.Config()
        for key, value in {
            "mode": "client",
            "connect/endpoints": [f"tls/localhost:{sites['tls']}"],
            "scouting/multicast/enabled": False,
            "transport/link/tls/root_ca_certificate": str(certificates / "ca.pem"),
            "transport/link/tls/enable_mtls": True,
            "transport/link/tls/connect_certificate": str(certificates / f"{name}.pem"),
            "transport/link/tls/connect_private_key": str(certificates / f"{name}.key"),
            "transport/auth/usrpwd/user": name,
            "transport/auth/usrpwd/password": f"secret of {name}",
        }.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)

    def ask(name: str, action: str) -> bytes | None:
        replies = list(sessions[name].get(order_key("o", action), payload=name, timeout=3.0))
        found = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        return found[0] if found else None

    with ExitStack() as stack:
        dispatcher = stack.enter_context(open_bus(sites["server"], users / "dispatcher"))
        dispatcher.answer(ALL_ORDERS, answer)
        sessions = {
            name: stack.enter_context(client(name)) for name in ("planner-1", "box-1", "van-1")
        }
        ends = time.monotonic() + 20.0
        while ask("planner-1", "submit") != b"answered":
            assert time.monotonic() < ends
        denied = [("planner-1", "pin"), ("planner-1", "settle")]
        denied += [(name, action) for name in ("box-1", "van-1") for action in ("submit", "pin")]
        for name, action in denied:
            assert ask(name, action) is None, (name, action)
    assert set(asked) == {f"planner-1 {order_key('o', 'submit')}"}


@pytest.mark.attack
@pytest.mark.long
@pytest.mark.process
def test_a_box_publishes_its_own_keys_only(
    sites: dict[str, int], users: Path, tmp_path: Path, figure: Callable[[str], None]
) -> None:
    """Its states arrive, early and live, and who stands; others' names, plans, or an unknown box's
    do not.

    The box is in a thief's hands: its router passes everything on, with its certificate and its
    password.
    """
    stolen = free_port()
    text = (
        (tmp_path / "box-1" / "router.json5")
        .read_text()
        .replace(f":{sites['box-1']}", f":{stolen}")
    )
    open_access = text.replace('default_permission: "deny"', 'default_permission: "allow"')
    assert open_access != text
    (tmp_path / "stolen.json5").write_text(open_access)
    with (
        zenoh.open(zenoh.Config.from_file(str(tmp_path / "stolen.json5"))),
        open_bus(stolen, users / "edge-rsu-1") as box,
        open_bus(sites["box-1"], users / "edge-rsu-1") as honest,
        open_bus(sites["box-2"], users / "edge-rsu-1") as stranger,
        open_bus(sites["server"], users / "dispatcher") as server,
    ):
        state = box.publisher(PROBES["state"])
        state.put(b"before anybody listened")
        stopped = honest.publisher(PROBES["stopped"], history=0)
        others = load_network("demo").segments.keys() - {"avenue_east"}
        forged = [
            *(box.publisher(state_key("rsu-1", segment)) for segment in others),
            box.publisher(PROBES["another RSU's state"]),
            *(box.publisher(stopped_key("rsu-1", segment), history=0) for segment in others),
            box.publisher(PROBES["another RSU's stopped"], history=0),
            box.publisher(plan_key("van")),
            box.publisher(CYCLE_KEY),
            stranger.publisher(PROBES["state"]),
            stranger.publisher(PROBES["stopped"], history=0),
        ]
        for publisher in forged:
            publisher.put(b"forged early")
        everything, plans_at_box = Seen(), Seen()
        for key_expression in (ALL_STATES, ALL_STOPPED, ALL_PLANS, CYCLE_KEY):
            server.subscribe(key_expression, everything)
        box.subscribe(ALL_PLANS, plans_at_box)
        assert everything.wait_for(b"before anybody listened", 15)
        for publisher in forged:
            publisher.put(b"forged")
        # One message for all segments at once.
        for pattern in ("slipstream/v1/rsu/rsu-1/segment/*/state", "slipstream/v1/**"):
            box._session.put(pattern, b"forged")
        plan = server.publisher(plan_key("van"))
        plan.put(b"plan")
        state.put(b"live")
        stopped.put(b"stopped")
        assert everything.wait_for(b"live")
        assert everything.wait_for(b"stopped")
        assert everything.wait_for(b"plan")
        time.sleep(0.5)
        expected = {b"before anybody listened", b"live", b"stopped", b"plan"}
        assert set(everything.payloads) == expected
        assert b"plan" not in plans_at_box.payloads
        figure(f"with a box's keys 1 of {1 + len(others)} segments gets its states")


@pytest.mark.attack
@pytest.mark.long
@pytest.mark.process
def test_a_box_is_known_by_certificate_and_password(
    sites: dict[str, int], users: Path, tmp_path: Path
) -> None:
    """Its certificate with another's password, and the reverse, carry nothing; both carry it."""
    texts = {box: (tmp_path / box / "router.json5").read_text() for box in ("box-1", "box-2")}
    mixed = {}
    for box, other in (("box-1", "box-2"), ("box-2", "box-1")):
        mixed[box] = free_port()
        text = texts[box].replace(f":{sites[box]}", f":{mixed[box]}")
        text = text.replace(f'user: "{box}"', f'user: "{other}"')
        (tmp_path / box / "mixed.json5").write_text(
            text.replace(f"secret of {box}", f"secret of {other}")
        )
    with ExitStack() as stack:
        seen, publishers = Seen(), []
        server = stack.enter_context(open_bus(sites["server"], users / "dispatcher"))
        server.subscribe(ALL_STATES, seen)
        for box, port in mixed.items():
            stack.enter_context(router.open_router(tmp_path / box / "mixed.json5"))
            bus = stack.enter_context(open_bus(port, users / "edge-rsu-1"))
            publishers.append(bus.publisher(PROBES["state"]))
            publishers[-1].put(b"forged")
        box = stack.enter_context(open_bus(sites["box-1"], users / "edge-rsu-1"))
        own = box.publisher(PROBES["state"])
        own.put(b"own")
        assert seen.wait_for(b"own", 15)
        # The mixed routers try to connect once a second at first.
        time.sleep(3.0)
        assert seen.payloads == [b"own"]


@pytest.mark.attack
@pytest.mark.long
@pytest.mark.process
def test_a_vehicles_box_speaks_for_its_vehicle_only(
    sites: dict[str, int], users: Path, tmp_path: Path
) -> None:
    """Its agent gets plan, roads and signals; the server gets the agent's answers and no sensing.

    Then the box is in a thief's hands: its router passes everything on, both ways.
    """
    stolen = free_port()
    text = (
        (tmp_path / "van-1" / "router.json5")
        .read_text()
        .replace(f":{sites['van-1']}", f":{stolen}")
    )
    open_access = text.replace('default_permission: "deny"', 'default_permission: "allow"')
    assert open_access != text
    (tmp_path / "stolen.json5").write_text(open_access)
    comes = ("plan", "another's management", "another's control", "timing", "status", "state")
    goes = ("position", "acknowledgement", "progress", "control", "management", "request")
    with ExitStack() as stack:
        opened = [
            stack.enter_context(open_bus(sites["server"], users / user))
            for user in ("dispatcher", "signals", "fleet")
        ]
        stack.enter_context(zenoh.open(zenoh.Config.from_file(str(tmp_path / "stolen.json5"))))
        thief = stack.enter_context(open_bus(stolen, users / "agent-van-1"))
        agent = stack.enter_context(open_bus(sites["van-1"], users / "agent-van-1"))
        vehicle = stack.enter_context(open_bus(sites["van-1"], users / "vehicle-van-1"))
        rsu = stack.enter_context(open_bus(sites["box-1"], users / "edge-rsu-1"))
        server, driven, heard, overheard = Seen(), Seen(), Seen(), Seen()
        opened[0].subscribe("slipstream/v1/**", server, every=True)
        for what in goes:
            opened[0].subscribe(PROBES[what], server, every=True)
        vehicle.subscribe(PROBES["advice"], driven, history=False)
        for key in ("slipstream/v1/**", *PROBES.values()):
            thief.subscribe(key, overheard, every=True)
        for what in (*comes, "sensing", "driver"):
            agent.subscribe(PROBES[what], heard, history=what == "plan", every=True)
        sent = {what: agent.publisher(PROBES[what], history=int(what in KEPT)) for what in goes}
        advice = agent.publisher(PROBES["advice"], history=0)
        sensing = vehicle.publisher(PROBES["sensing"], history=0)
        given = {
            "plan": opened[0].publisher(PROBES["plan"]),
            "another's plan": opened[0].publisher(PROBES["another's plan"]),
            "timing": opened[1].publisher(PROBES["timing"], history=0),
            "status": opened[1].publisher(PROBES["status"], history=0),
            "another's position": opened[2].publisher(PROBES["another's position"]),
            "state": rsu.publisher(PROBES["state"]),
        }
        forged = {
            what: thief.publisher(key, history=int(what in KEPT))
            for what, key in PROBES.items()
            if what not in goes
        }
        deadline = time.monotonic() + 20
        wanted = {what.encode() for what in given.keys() & set(comes)} | {b"sensing"}
        while time.monotonic() < deadline:
            for publishers in (sent, given, {"advice": advice, "sensing": sensing}):
                for what, publisher in publishers.items():
                    publisher.put(what.encode())
            for publisher in forged.values():
                publisher.put(b"forged")
            if (
                wanted <= set(heard.payloads)
                and {what.encode() for what in goes} <= set(server.payloads)
                and driven.payloads
            ):
                break
            time.sleep(0.2)
        time.sleep(0.5)
        assert set(heard.payloads) == wanted
        assert set(driven.payloads) == {b"advice"}
        assert set(server.payloads) == {what.encode() for what in (*goes, *given)}
        # At the thief's ears too: of others what all vehicles on the road hear.
        heard_by_all = {what.encode() for what in (*comes, "control")}
        assert set(overheard.payloads) - {b"forged"} <= heard_by_all


@pytest.mark.long
@pytest.mark.process
@pytest.mark.parametrize("key", [preview_key("rsu-1"), bare_preview_key("rsu-1")])
def test_pictures_are_asked_for_through_the_wall(
    sites: dict[str, int], users: Path, key: str
) -> None:
    """An RSU behind TLS and access control knows whether somebody looks at its pictures."""
    with (
        open_bus(sites["box-1"], users / "edge-rsu-1") as box,
        open_bus(sites["server"], users / "dashboard") as server,
    ):
        pictures = box.publisher(key, best_effort=True)
        assert not pictures.has_subscribers()
        seen = Seen()
        server.subscribe(key, seen, history=False)
        deadline = time.monotonic() + 60
        while not pictures.has_subscribers() and time.monotonic() < deadline:
            time.sleep(0.05)
        pictures.put(os.urandom(50_000))
        deadline = time.monotonic() + 60
        while not seen.payloads and time.monotonic() < deadline:
            time.sleep(0.05)
        assert [len(payload) for payload in seen.payloads] == [50_000]
