"""`slipstream run` as a newcomer meets it: the real processes, a real browser, real kills."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest

import storage
from slipstream.bus import free_port
from slipstream_cli.main import main
from slipstream_lab.commands.live import demo
from slipstream_lab.simulation.live.town import VANS

pytestmark = [pytest.mark.process, pytest.mark.alone, pytest.mark.timeout(1800)]


@dataclass
class Run:
    """A running `slipstream run`."""

    process: subprocess.Popen[str]
    port: int
    state: Path
    log: list[str] = field(default_factory=list)

    def says(self, condition: Callable[[str], bool], seconds: float) -> str:
        """The first log line for which the condition holds."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for line in list(self.log):
                if condition(line):
                    return line
            assert self.process.poll() is None, "\n".join(self.log)
            time.sleep(0.1)
        raise AssertionError("not said in time:\n" + "\n".join(self.log))

    def daemon(self, name: str) -> psutil.Process:
        """The process of one daemon."""
        running = [p for p in psutil.Process(self.process.pid).children() if _lives(p)]
        for child in running:
            if name in child.cmdline():
                return child
        raise AssertionError(f"no process of {name}")


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """A newcomer's state folder: nothing is in it."""
    return tmp_path / "state"


@pytest.fixture
def rendered(state: Path, made_once: Callable[..., Path]) -> None:
    """The state folder has its clips already, from an earlier run as it were."""
    clips = made_once("demo", lambda folder: demo.make_clips(folder, threading.Event()))
    shutil.copytree(clips, state / "clips")


@pytest.fixture
def short(state: Path) -> None:
    """The state folder has clips of a few seconds in their place."""
    for roadside in demo.ROADSIDES:
        scenario, *others = {*roadside.clips}
        first = state / "clips" / demo._name(roadside, scenario)
        words = ("--seconds", "5", "--fps", "15", "--segment", roadside.segment)
        assert main(["clip", "streetdrive", "--out", str(first), *words]) == 0
        for other in others:
            shutil.copytree(first, first.with_name(demo._name(roadside, other)))


@pytest.fixture
def start(state: Path) -> Iterator[Callable[..., Run]]:
    """Starts the real command; kills it at the end if the test has not ended it."""
    runs: list[Run] = []

    def go(*arguments: str) -> Run:
        port = free_port()
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "slipstream_cli", "run", "--state", str(state)),
                *("--port", str(port), *arguments),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        run = Run(process, port, state)
        assert process.stderr is not None
        stderr = process.stderr
        threading.Thread(
            target=lambda: run.log.extend(line.rstrip() for line in stderr), daemon=True
        ).start()
        runs.append(run)
        return run

    yield go
    for run in runs:
        if run.process.poll() is None:
            run.process.kill()
        run.process.wait()
        for stream in (run.process.stdout, run.process.stderr):
            if stream is not None:
                stream.close()


def _lives(process: psutil.Process) -> bool:
    return process.status() != psutil.STATUS_ZOMBIE


def left_over(state: Path) -> list[str]:
    """Command lines of processes that still work for a run in that state folder."""
    found = []
    for process in psutil.process_iter(["pid", "cmdline", "status"]):
        command = " ".join(process.info["cmdline"] or [])
        if str(state) in command and process.info["status"] != psutil.STATUS_ZOMBIE:
            found.append(command)
    return found


def _look_at_the_operators_page(page: Any, port: int) -> None:
    """Vans drive, cameras' flags are on their roads, a cycle and its energy are told."""
    page.goto(f"http://127.0.0.1:{port}/")
    page.wait_for_selector("html[data-map]", state="attached", timeout=60_000)
    assert page.title().endswith("Slipstream")
    assert "– Slipstream" not in page.title()
    vehicles = page.locator("#pane-vehicles tbody")
    vehicles.get_by_text("van-01", exact=True).first.wait_for(timeout=60_000)
    vehicles.get_by_text("drives").first.wait_for(timeout=60_000)
    page.click("#tab-roads")
    roads = page.locator("#pane-roads tbody")
    for name in ("avenue_east", "avenue_west"):
        roads.get_by_text(name, exact=True).first.wait_for(timeout=60_000)
    roads.locator("[data-flag=stable]:visible").first.wait_for(timeout=60_000)
    # It turns on the first avenue after 1½ minutes.
    roads.locator("[data-flag=turbulent]:visible").first.wait_for(timeout=150_000)
    page.click("#tab-cameras")
    # `wait_for_function` needs `eval`, which the page's policy refuses.
    pictures = page.locator("#pane-cameras img")
    deadline = time.monotonic() + 60
    while pictures.evaluate_all("all => all.map((one) => one.naturalWidth)") != [640, 640]:
        assert time.monotonic() < deadline, "a camera's picture is missing"
        time.sleep(0.2)
    page.click("#tab-energy")
    page.get_by_text("Since the start").wait_for(timeout=30_000)
    page.locator("#pane-energy .headline", has_text="kWh").first.wait_for(timeout=60_000)
    page.click("#tab-cycles")
    page.locator("#pane-cycles tr[data-id]").first.click()
    page.locator("#card-body").get_by_text("pyvrp").first.wait_for(timeout=30_000)
    page.click("#tab-vehicles")
    vehicles.get_by_text("van-01", exact=True).first.click()
    page.locator("#card").get_by_role("heading", name="Plan", exact=True).wait_for(timeout=60_000)


@pytest.mark.long
@pytest.mark.usefixtures("short")
def test_the_product_runs(start: Callable[..., Run]) -> None:
    """RSUs send states, cycles make plans, vehicles' agents answer them and drive, the page is up;
    Ctrl-C ends all of it.
    """
    run = start("--interval", "5", "--json")
    run.says(lambda line: "the dashboard is at" in line, 600)
    with storage.open_reader(f"sqlite:///{run.state / 'slipstream.db'}") as reader:
        deadline = time.monotonic() + 600
        while not any(r.status == "acknowledged" for r in reader.latest_plan_records()):
            assert time.monotonic() < deadline, "\n".join(run.log)
            time.sleep(0.5)
    run.process.send_signal(signal.SIGINT)
    output, _ = run.process.communicate(timeout=120)
    assert run.process.returncode == 0, "\n".join(run.log)
    figures = json.loads(output)
    assert figures["dashboard_http"] == 200
    assert figures["processes_restarted"] == 0, "\n".join(run.log)
    assert figures["segment_states"] >= 1
    assert figures["plans"] >= 1
    assert figures["energy_kwh"]["cooperative"] > 0
    assert figures["vehicles_moved"] >= 1
    assert left_over(run.state) == []


@pytest.mark.nightly
def test_the_whole_chain_shows_on_the_page_and_in_the_figures(
    start: Callable[..., Run], browser: Any, tmp_path: Path
) -> None:
    """Video becomes flags, flags gate platoons, plans go out, and the page tells all of it."""
    run = start("--interval", "10", "--json")
    line = run.says(lambda line: "the dashboard is at" in line, 600)
    for port in (run.port, run.port + 1):
        assert f"http://127.0.0.1:{port}" in line
    page = browser.new_page(viewport={"width": 1440, "height": 900}, locale="en-GB")
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    _look_at_the_operators_page(page, run.port)
    page.screenshot(path=os.environ.get("SLIPSTREAM_SCREENSHOT", str(tmp_path / "page.png")))
    page.goto(page.get_attribute("#scene", "href"))
    page.wait_for_selector("canvas", timeout=60_000)
    page.get_by_text("van-01").first.wait_for(timeout=60_000)
    assert str(run.port + 1) in page.url
    page.close()
    assert faults == []
    # A browser that draws without a GPU takes the cameras' processors. Each sees its whole clip.
    time.sleep(40.0)
    run.process.send_signal(signal.SIGINT)
    output, _ = run.process.communicate(timeout=120)
    assert run.process.returncode == 0, "\n".join(run.log)
    figures = json.loads(output)
    assert figures["dashboard_http"] == 200
    assert figures["processes_restarted"] == 0, "\n".join(run.log)
    assert set(figures["y_e"]) == {"avenue_east", "avenue_west"}
    assert all(flags["stable"] >= 20 for flags in figures["y_e"].values())
    assert figures["y_e"]["avenue_west"]["turbulent"] >= 10
    assert figures["frames"] >= 300
    assert figures["segment_states"] >= 50
    assert figures["cycles"] >= 2
    energy = figures["energy_kwh"]
    assert 0 < energy["cooperative"] <= energy["baseline"]
    # A fleet is at work: it drives by its plans, and its vehicles tell where they are.
    assert figures["plans"] >= VANS // 2
    assert figures["vehicles_moved"] >= VANS // 2
    assert figures["town"]["tours_begun"] >= VANS // 2
    assert figures["town"]["orders_served_again"] == 0
    assert left_over(run.state) == []


@pytest.mark.nightly
@pytest.mark.usefixtures("rendered")
def test_killed_daemons_come_back_and_nothing_stored_is_lost(start: Callable[..., Run]) -> None:
    """SIGKILL of an RSU and of the dispatcher; then Ctrl-C ends all within 10 s."""
    run = start("--interval", "5")
    run.says(lambda line: "dispatcher" in line and "cycle" in line and " ok" in line, 600)
    url = f"sqlite:///{run.state / 'slipstream.db'}"
    with storage.open_reader(url) as reader:
        before = reader.latest_cycle()
    assert before is not None
    run.daemon("rsu-west").kill()
    run.daemon("dispatcher").kill()
    for name in ("rsu-west", "dispatcher"):
        run.says(lambda line, n=name: n in line and "ended with status -9" in line, 60)
    with storage.open_reader(url) as reader:
        deadline = time.monotonic() + 90
        while (now := reader.latest_cycle()) is None or now.cycle <= before.cycle:
            assert time.monotonic() < deadline, "\n".join(run.log)
            time.sleep(0.5)
        numbers = [report.cycle for report in reader.cycles(1000)]
    assert before.cycle in numbers
    assert len(numbers) == len(set(numbers))
    assert storage.check(url).ok
    began = time.monotonic()
    os.kill(run.process.pid, signal.SIGINT)
    run.process.wait(timeout=30)
    assert time.monotonic() - began < 10
    assert run.process.returncode == 0
    assert left_over(run.state) == []


@pytest.mark.attack
@pytest.mark.nightly
@pytest.mark.usefixtures("rendered")
def test_a_stopped_daemon_is_started_again_within_30_s(
    start: Callable[..., Run], figure: Callable[[str], None], full_size: bool
) -> None:
    """SIGSTOP, as a fault that leaves the process there; the other daemons are left alone."""
    run = start("--json")
    run.says(lambda line: "the dashboard is at" in line, 600)
    for name in ("rsu-east", "dispatcher", "dashboard") if full_size else ("rsu-east",):
        run.says(lambda line, n=name: f" {n} " in line and line.endswith("INFO ready"), 600)
        stopped = run.daemon(name)
        began = time.monotonic()
        stopped.send_signal(signal.SIGSTOP)
        run.says(lambda line, n=name: f" {n} " in line and "no progress for" in line, 60)
        deadline = began + 60
        while stopped.is_running() or not _is_up(run, name):
            assert time.monotonic() < deadline, "\n".join(run.log)
            time.sleep(0.1)
        took_s = time.monotonic() - began
        figure(f"{name} stopped by SIGSTOP: started again after {took_s:.1f} s")
        assert took_s < 30
    os.kill(run.process.pid, signal.SIGINT)
    output, _ = run.process.communicate(timeout=120)
    assert json.loads(output)["processes_restarted"] == (3 if full_size else 1), "\n".join(run.log)


def _is_up(run: Run, name: str) -> bool:
    try:
        return run.daemon(name).is_running()
    except (AssertionError, psutil.NoSuchProcess):
        return False


@pytest.mark.nightly
@pytest.mark.usefixtures("rendered")
def test_a_killed_supervisor_leaves_nothing_behind(start: Callable[..., Run]) -> None:
    """Not even kill -9 leaves daemons running."""
    run = start()
    run.says(lambda line: "the dashboard is at" in line, 600)
    run.process.kill()
    run.process.wait()
    deadline = time.monotonic() + 10
    while left_over(run.state) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert left_over(run.state) == []
