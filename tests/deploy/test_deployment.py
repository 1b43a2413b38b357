"""The installed thing: a clean Debian machine, `install.sh` as documented, the units as shipped.

The tests build on each other, in this order; `make test-deploy` runs them.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from .conftest import ROOT
from .machine import (
    CACHE,
    Machine,
    Unavailable,
    copy_checkout,
    copy_version_before,
    debian,
    wait_for,
    wheels,
)

pytestmark = [
    pytest.mark.process,
    pytest.mark.long,
    pytest.mark.alone,
    pytest.mark.timeout(1800),
]

SLIPSTREAM = "/opt/slipstream/current/bin/slipstream"
ETC = "/etc/slipstream"
DATABASE = "sqlite:////var/lib/slipstream/slipstream.db"
API = "http://127.0.0.1:8090"
PAGE = "http://127.0.0.1:8080/"
UNITS = (
    *("slipstream-router", "slipstream-edge@rsu-1", "slipstream-dispatcher"),
    *("slipstream-dashboard", "slipstream-agent@depot-1"),
)
CLUSTER = ("slipstream-scheduler", "slipstream-worker")
FILTER = "/etc/systemd/system/slipstream-dispatcher.service.d/filter.conf"
BACKUP = "/var/backups/before-upgrade.db"

VEHICLES = """
import sys, time
from pathlib import Path
from slipstream.bus import Bus
from slipstream.config import BusSettings
from slipstream.messages import VehicleSensing, sensing_key

password = Path("/etc/slipstream/bus/vehicle-depot-1")
router = ("tcp/127.0.0.1:7447",)
with Bus.open(BusSettings(connect=router, user="vehicle-depot-1", password_file=password)) as bus:
    while True:
        for vehicle in ("van-a", "van-b"):
            standing = dict(on_road=False, segment="depot_road_east", crossing=False, lane=0)
            still = dict(front_m=0.0, speed_mps=0.0, acceleration_mps2=0.0, driven_m=0.0)
            alone = dict(ahead=None, behind=None)
            now = dict(vehicle=vehicle, time_ns=time.time_ns())
            bus.put(sensing_key(vehicle), VehicleSensing(**now, **standing, **still, **alone))
        time.sleep(0.5)
"""
"""The vehicles' own part: both vans stand in their depot and sense it."""


@dataclass
class Site:
    """An installed machine, as its operator sees it.

    Attributes:
        before: the version that was installed first.
        page_s: from the end of the upgrade's install.sh to the page's first answer, s.
    """

    machine: Machine
    token: str
    before: str
    page_s: float = 0.0

    def api(self, method: str, path: str, body: Any = None) -> tuple[int, Any]:
        """(status, answer) of the dispatcher's API."""
        data = None if body is None else json.dumps(body).encode()
        status, answer = self.machine.ask(
            f"{API}{path}", method=method, body=data, token=self.token
        )
        return status, json.loads(answer) if status else None

    def cycle(self) -> Any:
        """The report of a cycle that begins after this call."""
        asked_ns = time.time_ns()

        def wanted() -> bool | None:
            # One that has begun already may end first.
            return self.api("POST", "/v1/control/cycle")[0] == 202 or None

        def stored() -> Any:
            cycles = self.api("GET", "/v1/cycles?limit=1")[1]["cycles"]
            return cycles[0] if cycles and cycles[0]["started_ns"] > asked_ns else None

        wait_for("a cycle's start", wanted)
        return wait_for("a cycle", stored)

    def solved_by(self, *solvers: str, seconds: float = 600.0) -> Any:
        """The first cycle with plans in which each of these solvers has an answer."""

        def solved() -> Any:
            report = self.cycle()
            answered = {
                run["solver"]
                for run in report["solvers"]
                if run["status"] in ("optimal", "feasible")
            }
            sound = report["status"] == "ok" and report["plans"] > 0
            return report if sound and answered >= set(solvers) else None

        return wait_for(f"a plan by {' and '.join(solvers)}", solved, seconds)

    def status(self) -> tuple[int, dict[str, str]]:
        """(exit status, what is not well) of `slipstream status`."""
        done = self.machine.run(SLIPSTREAM, "status", "--json", check=False)
        findings = json.loads(done.stdout)["findings"]
        return done.returncode, {f["name"]: f["text"] for f in findings if not f["well"]}

    def is_well(self) -> None:
        """Wait until `slipstream status` exits 0."""
        last: dict[str, str] = {}

        def well() -> bool | None:
            nonlocal last
            code, last = self.status()
            assert (code == 0) == (not last)
            return code == 0 or None

        try:
            wait_for("status", well, 180.0)
        except AssertionError as error:
            raise AssertionError(f"{error}: {last}") from None

    def names(self, subject: str, text: str) -> None:
        """Wait until `slipstream status` names a fault, with exit status 1."""
        last: Any = None

        def named() -> bool | None:
            nonlocal last
            last = code, faults = self.status()
            return (code == 1 and text in faults.get(subject, "")) or None

        try:
            wait_for("status", named)
        except AssertionError as error:
            raise AssertionError(f"{error}: {last}") from None

    def set(self, old: str, new: str) -> None:
        """Change the settings in one place, and check them."""
        text = self.machine.read(f"{ETC}/site.toml")
        assert text.count(old) == 1, old
        self.machine.write(f"{ETC}/site.toml", text.replace(old, new))
        self.machine.run(SLIPSTREAM, "check", f"{ETC}/site.toml")

    def restart_dispatcher(self) -> None:
        """With its unit read anew, however often it was started before."""
        self.machine.run("systemctl", "daemon-reload")
        self.machine.run("systemctl", "reset-failed", "slipstream-dispatcher")
        done = self.machine.run("systemctl", "restart", "slipstream-dispatcher", check=False)
        if done.returncode != 0:
            said = ("journalctl", "--unit=slipstream-dispatcher", "--lines=60", "--no-pager")
            pytest.fail(f"{done.stderr}{self.machine.run(*said).stdout}")


@pytest.fixture(scope="module")
def site(tool: Callable[[str], str], street_clips: dict[str, Path]) -> Iterator[Site]:
    """A clean machine with the version before, upgraded to this checkout; all daemons run."""
    if os.geteuid() != 0:
        pytest.skip("only root boots containers")
    mmdebstrap = tool("mmdebstrap")
    tool("systemd-nspawn")
    root = CACHE / "machine"
    shutil.rmtree(root, ignore_errors=True)
    try:
        base = debian(mmdebstrap)
        subprocess.run(["cp", "-a", "--reflink=auto", base, root], check=True)
        copy_checkout(root / "srv" / "checkout")
        before = copy_version_before(root / "srv" / "before")
        clip = street_clips["stable"]
        (root / "srv" / "clips").mkdir()
        shutil.copy(clip / "video.mp4", root / "srv" / "clips")
        machine = Machine(root, {"/srv/wheels": wheels()})
    except Unavailable as reason:
        pytest.skip(str(reason))
    try:
        site = Site(machine, "", before)
        camera = (clip / "camera.toml").read_text().replace("stable_road", "avenue_east")
        _install(site, camera)
        _upgrade(site)
        yield site
    finally:
        machine.stop()
        shutil.rmtree(root, ignore_errors=True)


def _install(site: Site, camera: str) -> None:
    """Install the version before, give it a camera and an API, start it, and order something."""
    machine = site.machine
    machine.run("sh", "/srv/before/deploy/install.sh", "all")
    machine.write(f"{ETC}/camera-rsu-1.toml", re.sub('name = ".*"', 'name = "rsu-1"', camera))
    url = re.search("^url = .*$", machine.read(f"{ETC}/site.toml"), re.MULTILINE)
    assert url is not None
    clip = 'clip = "/srv/clips/video.mp4"\nloop = true'
    site.set(f"{url[0]}\nstall_timeout_s = 5.0\n", f"{clip}\n")
    api = ("[dispatcher.api]", "port = 8090", 'tokens = "api-tokens"')
    site.set("".join(f"#{line}\n" for line in api), "".join(f"{line}\n" for line in api))
    tokens = ("--scopes", "read,orders,control", "--file", f"{ETC}/api-tokens.toml")
    site.token = machine.run(SLIPSTREAM, "token", "new", "operator", *tokens).stdout.split()[-1]
    machine.run("systemctl", "enable", "--now", *UNITS)
    assert site.api("POST", "/v1/orders", {"id": "before", "node": "c2"})[0] == 201
    site.cycle()


def _upgrade(site: Site) -> None:
    """As docs/operations.md says."""
    machine = site.machine
    machine.run(SLIPSTREAM, "db", "backup", BACKUP, "--database", DATABASE)
    machine.run("sh", "/srv/checkout/deploy/install.sh", "all")
    installed = time.monotonic()
    machine.run(SLIPSTREAM, "check", f"{ETC}/site.toml")
    machine.run("systemctl", "restart", "slipstream-*")
    wait_for("the page", lambda: machine.ask(PAGE)[0] == 200 or None)
    site.page_s = time.monotonic() - installed


def test_page_answers_soon_after_an_upgrade_that_keeps_orders_and_cycles(
    site: Site, figure: Callable[[str], None]
) -> None:
    """The new version runs within three minutes; what the one before has stored is there."""
    figure(f"page up {site.page_s:.0f} s after install.sh")
    assert site.page_s <= 180.0
    version = site.machine.run(SLIPSTREAM, "--version").stdout.split()[-1]
    assert version != site.before
    assert site.api("GET", "/v1/orders/before")[1]["order"] == "before"
    assert site.api("GET", "/v1/cycles/1")[0] == 200


def test_orders_become_plans_by_each_solver(site: Site) -> None:
    """By exact, with LC-QAOA's answer beside it; then by LC-QAOA alone."""
    # Else it waits for others for up to five minutes. The site's file has no such key.
    api = "[dispatcher.api]\n"
    at_once = f"[dispatcher.orders]\nbundle_s = 0.0\n\n{api}"
    site.set(api, at_once)
    site.restart_dispatcher()
    status, order = site.api("POST", "/v1/orders", {"id": "after", "node": "c4"})
    assert (status, order["order"]) == (201, "after")
    report = site.solved_by("exact", "lc-qaoa")
    assert report["solver"] == "exact"
    assert site.api("GET", "/v1/orders/after")[1]["state"] != "open"
    both = "[dispatcher]\n"
    alone = f'{both}solvers = ["lc-qaoa"]\n'
    site.set(both, alone)
    site.restart_dispatcher()
    assert site.solved_by("lc-qaoa")["solver"] == "lc-qaoa"
    site.set(alone, both)
    site.set(at_once, api)
    site.restart_dispatcher()


def test_callers_fleets_are_planned(site: Site) -> None:
    """`/v1/solve` by the solvers, `/v1/vroom` by its own search."""
    fleet = tomllib.loads((ROOT / "dispatcher_daemon" / "data" / "demo_fleet.toml").read_text())
    status, job = site.api("POST", "/v1/solve?deadline_s=20", fleet)
    assert status == 202, job

    def ended() -> Any:
        answer = site.api("GET", f"/v1/solve/{job['id']}")[1]
        return answer if answer["state"] not in ("waiting", "running") else None

    answer = wait_for("a caller's fleet", ended, 300.0)
    assert answer["state"] == "done", answer
    request = {
        "vehicles": [{"id": 1, "start_index": 0, "end_index": 0}],
        "jobs": [{"id": 1, "location_index": 1}, {"id": 2, "location_index": 2}],
        "matrices": {"car": {"durations": [[0, 60, 90], [60, 0, 40], [90, 40, 0]]}},
    }
    status, answer = site.api("POST", "/v1/vroom?deadline_s=5", request)
    assert (status, answer["summary"]["cost"], answer["unassigned"]) == (200, 190, [])


def test_flags_of_the_rsu_open_a_gate(site: Site) -> None:
    """A calm clip before the camera: the state is admitted, and platoons may form there."""

    def gate() -> Any:
        segment = site.api("GET", "/v1/segments/avenue_east")[1]
        return segment if segment["gate"]["open"] else None

    segment = wait_for("an open gate", gate)
    assert segment["gate"]["y_e"] == 1
    assert [state["rsu"] for state in segment["states"]] == ["rsu-1"]


def test_vehicles_take_their_plans(site: Site) -> None:
    """Agents answer for the vans that sense; the dispatcher knows what they have accepted."""
    site.machine.write("/srv/vehicles.py", VEHICLES)
    python = "/opt/slipstream/current/bin/python"
    site.machine.run("systemd-run", "--unit=vehicles", python, "/srv/vehicles.py")

    def accepted() -> bool | None:
        site.cycle()
        vehicles = site.api("GET", "/v1/vehicles")[1]["vehicles"]
        return all(v["reports"] and v["accepted"] for v in vehicles) or None

    wait_for("accepted plans", accepted)


def test_page_shows_the_vans(site: Site, tool: Callable[[str], str], tmp_path: Path) -> None:
    """A browser on that machine draws them."""
    chromium = tool("chromium")
    sync_api = pytest.importorskip("playwright.sync_api")
    inside = tmp_path / "chromium"
    inside.write_text(
        f'#!/bin/sh\nexec nsenter --net=/proc/{site.machine.pid}/ns/net {chromium} "$@"\n'
    )
    inside.chmod(0o755)
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=inside, args=["--no-sandbox", "--disable-gpu"], timeout=120_000
        )
        page = browser.new_page()
        page.set_default_timeout(120_000)
        faults: list[object] = []
        page.on("pageerror", lambda error: faults.append(error))
        page.goto(PAGE)
        page.get_by_text("van-a").first.wait_for()
        browser.close()
    assert faults == []


def test_status_is_well_on_a_healthy_machine(site: Site) -> None:
    """Exit status 0: units, processes, bus, the RSU and the dispatcher."""
    site.is_well()


def test_status_names_a_stopped_unit(site: Site) -> None:
    """One that is enabled and does not run."""
    unit = "slipstream-agent@depot-1.service"
    site.machine.run("systemctl", "stop", unit)
    site.names(unit, "inactive")
    site.machine.run("systemctl", "start", unit)
    site.is_well()


def test_status_names_a_dead_bus(site: Site) -> None:
    """The router is gone, and the daemons wait for it."""
    site.machine.run("systemctl", "stop", "slipstream-router")
    site.names("bus", "no router answers")
    site.machine.run("systemctl", "start", "slipstream-router")
    site.is_well()


def test_status_names_a_wrong_password(site: Site) -> None:
    """The router does not let the dispatcher in; install.sh gives it its password again."""
    site.machine.write(f"{ETC}/bus/dispatcher", "wrong\n")
    site.restart_dispatcher()
    site.names("dispatcher", "does not let it in")
    site.machine.run("sh", "/srv/checkout/deploy/install.sh", "--no-venv", "all")
    site.restart_dispatcher()
    site.is_well()


def test_a_filter_that_forbids_what_solvers_need_is_noticed(site: Site) -> None:
    """Their processes die at `getppid` while the daemon lives: no plan by a solver, and status says
    so. A worker of a cluster, under its own unit, then solves in their place.
    """
    site.machine.write(FILTER, "[Service]\nSystemCallFilter=~getppid\n")
    site.restart_dispatcher()
    with pytest.raises(AssertionError, match="a plan by exact"):
        site.solved_by("exact", seconds=20.0)
    site.names("dispatcher", "no solver works")

    text = site.machine.read(f"{ETC}/site.toml")
    for line in ("[cluster]", 'address = "tcp://127.0.0.1:8786"', "[scheduler]", "[worker]"):
        assert text.count(f"#{line}\n") == 1
        text = text.replace(f"#{line}\n", f"{line}\n")
    site.machine.write(f"{ETC}/site.toml", text)
    site.machine.run(SLIPSTREAM, "check", f"{ETC}/site.toml")
    site.machine.run("systemctl", "enable", "--now", *CLUSTER)
    site.restart_dispatcher()
    site.solved_by("exact")

    (site.machine.root / FILTER.removeprefix("/")).unlink()
    site.restart_dispatcher()
    site.is_well()


def test_memory_of_each_unit_is_below_its_limit(site: Site, figure: Callable[[str], None]) -> None:
    """What its processes hold, counted as systemd does not where it has no memory controller."""
    for unit in (*UNITS, *CLUSTER):
        shown = site.machine.run("systemctl", "show", "--value", "-p", "MemoryHigh", unit)
        high_mb, held_mb = int(shown.stdout) / 1e6, 0.0
        for process in site.machine.processes(unit):
            rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
            held_mb += sum(map(int, re.findall(r"^Pss: +(\d+) kB$", rollup, re.MULTILINE))) / 1e3
        figure(f"{unit}: {held_mb:.0f} of {high_mb:.0f} MB")
        assert 0 < held_mb < high_mb, unit


def test_the_way_back(site: Site) -> None:
    """The version before again, with its units and with the backup of before the upgrade."""
    machine = site.machine
    machine.run("systemctl", "stop", "slipstream-dispatcher")
    machine.run(SLIPSTREAM, "db", "restore", BACKUP, "--database", DATABASE)
    machine.run("sh", "/srv/checkout/deploy/install.sh", "use", site.before)
    machine.run("sh", "/srv/before/deploy/install.sh", "--no-venv", "all")
    machine.run("systemctl", "restart", *UNITS)
    assert machine.run(SLIPSTREAM, "--version").stdout.split()[-1] == site.before
    wait_for("the page", lambda: machine.ask(PAGE)[0] == 200 or None)
    assert site.api("GET", "/v1/orders/before")[0] == 200
    assert site.api("GET", "/v1/orders/after")[0] == 404
    site.cycle()


def test_removal_keeps_data_unless_told(site: Site) -> None:
    """Units, processes and releases go; settings and database with `--data` only."""
    machine = site.machine

    def there(*paths: str) -> list[str]:
        return [path for path in paths if (machine.root / path).exists()]

    data = (
        "etc/slipstream/site.toml",
        "etc/slipstream/bus/users",
        "var/lib/slipstream/slipstream.db",
    )
    machine.run("sh", "/srv/checkout/deploy/install.sh", "remove")
    shown = machine.run("systemctl", "list-units", "--all", "--plain", "slipstream-*").stdout
    assert "slipstream-dispatcher" not in shown
    assert not any(machine.processes(unit) for unit in UNITS)
    assert there("opt/slipstream", *data) == [*data]
    machine.run("sh", "/srv/checkout/deploy/install.sh", "remove", "--data")
    assert there(*data, "etc/slipstream", "var/lib/slipstream") == []
