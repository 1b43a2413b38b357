"""A real agent behind the router that is shipped, with its example settings."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import tomllib
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path

import pytest

from slipstream.bus import Bus, free_port
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_ACKNOWLEDGEMENTS,
    ALL_POSITIONS,
    ALL_PROGRESS,
    advice_key,
    plan_key,
    platoon_controls_on,
    sensing_key,
)
from slipstream_cli.daemons import router
from slipstream_cli.place.bus_files import ACCESS, access_of
from tests.vehicle_agent.tours import plan, sensing

from .conftest import DEPLOY

VAN = "van-a"
KINDS = ("acknowledgement", "progress", "position", "advice", VAN)
"""Last chunks of the keys that an agent is heard on; platoon control ends with its vehicle."""


@pytest.mark.long
@pytest.mark.process
def test_the_examples_carry_a_vehicles_plan_and_advice(etc: Path, tmp_path: Path) -> None:
    """Plan and sensing in, answer, progress, position, advice and platoon control out."""
    port, passwords = free_port(), tmp_path / "bus"
    passwords.mkdir()
    users = ("dispatcher", "dashboard", "vehicle-depot-1", "agent-depot-1")
    (passwords / "bus-users").write_text("".join(f"{user}:secret of {user}\n" for user in users))
    for user in users:
        (passwords / user).write_text(f"secret of {user}\n")
    text = (DEPLOY / "zenoh" / "router.json5").read_text()
    for old, new in {
        "127.0.0.1:7447": f"127.0.0.1:{port}",
        "/run/credentials/slipstream-router.service": str(passwords),
    }.items():
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "router.json5").write_text(text)
    settings = etc / "site-agent.toml"
    access = access_of(tomllib.loads(settings.read_text()))
    (tmp_path / ACCESS).write_text(json.dumps(access))
    toml = settings.read_text().replace(":7447", f":{port}")
    toml = toml.replace('"bus-password"', f'"{passwords / "agent-depot-1"}"')
    settings.write_text(toml.replace("metrics_port = 9467", "metrics_port = 0"))

    heard: dict[str, int] = defaultdict(int)

    def hear(key: str, payload: bytes) -> None:
        heard[key.rpartition("/")[2]] += 1

    with ExitStack() as stack:
        stack.enter_context(router.open_router(tmp_path / "router.json5"))
        dispatcher, dashboard, vehicle = (
            stack.enter_context(
                Bus.open(
                    BusSettings(
                        connect=(f"tcp/127.0.0.1:{port}",),
                        user=user,
                        password_file=passwords / user,
                    )
                )
            )
            for user in users[:3]
        )
        for key in (ALL_ACKNOWLEDGEMENTS, ALL_PROGRESS, ALL_POSITIONS):
            dispatcher.subscribe(key, hear)
        dashboard.subscribe(platoon_controls_on("out1"), hear, history=False)
        vehicle.subscribe(advice_key(VAN), hear, history=False)
        now_ns = time.time_ns()
        ends_ns = now_ns + 600 * 10**9
        plans = dispatcher.publisher(plan_key(VAN))
        plans.put(plan(vehicle=VAN, issued_ns=now_ns, valid_until_ns=ends_ns, depart_ns=now_ns))
        senses = vehicle.publisher(sensing_key(VAN), history=0)
        command = [sys.executable, "-m", "slipstream_cli", "agent", "--config", str(settings)]
        process = subprocess.Popen(command)
        stack.callback(process.wait)
        stack.callback(process.kill)
        deadline = time.monotonic() + 40
        while time.monotonic() < deadline and not all(heard[kind] for kind in KINDS):
            on_road = heard["acknowledgement"] > 0
            now_ns = time.time_ns()
            senses.put(sensing(0, on_road=on_road, vehicle=VAN, time_ns=now_ns))
            time.sleep(0.1)
        assert {kind: heard[kind] > 0 for kind in KINDS} == dict.fromkeys(KINDS, True)
