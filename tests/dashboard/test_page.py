"""The real dashboard in a real browser: what a dispatcher sees, and what goes when data goes."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest

import storage
from dashboard.view import labels
from slipstream.bus import Bus, Router, free_port
from slipstream.config import BusSettings

pytestmark = [pytest.mark.process, pytest.mark.long]
START = """
import json, sys
from dashboard.daemon import run_dashboard
from dashboard.settings import DashboardSettings
run_dashboard(DashboardSettings.model_validate(json.loads(sys.argv[1])))
"""
S = 1_000_000_000
STALE_AFTER_S = 3.0


@dataclass
class Dashboard:
    """A running dashboard with what feeds it."""

    process: subprocess.Popen[str]
    address: str
    stop_sending: Callable[[], None]
    log: Path
    requests: list[str] = field(default_factory=list)


def _start(settings: dict[str, object], log: Path) -> subprocess.Popen[str]:
    with log.open("w") as file:
        return subprocess.Popen(
            [sys.executable, "-c", START, json.dumps(settings)], stderr=file, text=True
        )


@pytest.fixture
def running(tmp_path, world, make_sender) -> Iterator[Dashboard]:
    """A dashboard fed over a router of its own, with a history of twenty cycles."""
    url = f"sqlite:///{tmp_path}/slipstream.db"
    now_ns = time.time_ns()
    with storage.open_database(url) as database:
        for number in range(1, 21):
            then_ns = now_ns - (21 - number) * 30 * S
            database.record_cycle(world.cycle(number, then_ns), [], [])
    stop, port, log = threading.Event(), free_port(), tmp_path / "dashboard.log"
    with Router() as router:
        bus_settings = BusSettings(connect=(router.endpoint,))
        settings = {
            "bus": {"connect": [router.endpoint]},
            "port": free_port(),
            "scene_port": port,
            "database_url": url,
            "stale_after_s": STALE_AFTER_S,
        }
        process = _start(settings, log)

        def send() -> None:
            with Bus.open(bus_settings) as bus:
                sender, tick = make_sender(bus, world), 0
                while not stop.wait(0.5):
                    sender.put_all(time.time_ns(), cycle=21, tick=tick)
                    # The plans stay those of the first tick, so that the vans move on.
                    tick += 1

        thread = threading.Thread(target=send)
        thread.start()

        def stop_sending() -> None:
            stop.set()
            thread.join()

        try:
            yield Dashboard(process, f"http://127.0.0.1:{port}", stop_sending, log)
        finally:
            stop_sending()
            if process.poll() is None:
                process.kill()
            process.wait()


@pytest.fixture
def page(running, browser):
    """A browser page on the dashboard, 1440×900."""
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.on("request", lambda request: running.requests.append(request.url))
    _open_when_served(page, running)
    return page


def _open_when_served(page, running: Dashboard) -> None:
    until = time.monotonic() + 90
    while True:
        try:
            page.goto(running.address)
            return
        except Exception:
            assert running.process.poll() is None, running.log.read_text()
            assert time.monotonic() < until
            time.sleep(0.1)


def _pixels(page, rgb: tuple[int, int, int], shot: Path, within: int = 24) -> int:
    """How many pixels of the map, between the panels, are of about this colour."""
    page.screenshot(path=shot)
    image = cv2.imread(str(shot))[210:620, 0:890, ::-1].astype(int)
    return int((np.abs(image - np.array(rgb)).max(axis=2) <= within).sum())


def _wait_for_pixels(
    page, rgb: tuple[int, int, int], shot: Path, at_least: int, within: int = 24
) -> int:
    until = time.monotonic() + 30
    while (count := _pixels(page, rgb, shot, within)) < at_least:
        assert time.monotonic() < until, f"{count} pixels of {rgb}"
        time.sleep(0.3)
    return count


def test_what_a_dispatcher_sees(running, page, browser, tmp_path):
    """Map and panels show the demo; when all falls silent it turns unknown; SIGTERM ends it."""
    shot = tmp_path / "page.png"
    page.wait_for_selector("canvas")
    for text in (
        "Traffic is calm on 1 of 2 watched roads",
        "All is well",
        "Click a vehicle, a road or a camera",
    ):
        page.get_by_text(text).first.wait_for(timeout=30_000)
    close = page.locator(".mantine-Notification-closeButton")
    if close.count():
        close.first.click()
    _wait_for_pixels(page, labels.TRAFFIC_RGB["stable"], shot, 800)
    _wait_for_pixels(page, labels.TRAFFIC_RGB["turbulent"], shot, 400)
    # Full blue is drawn a little darker.
    _wait_for_pixels(page, labels.VEHICLE_RGB[0], shot, 60, within=40)
    _wait_for_pixels(page, labels.VEHICLE_RGB[1], shot, 60, within=40)
    # What is selected is told in a card, with the camera's picture.
    chosen = browser.new_page(viewport={"width": 1024, "height": 768})
    chosen.goto(f"{running.address}/?select=rsu/rsu-avenue_east")
    chosen.get_by_text("Roadside unit rsu-avenue_east").wait_for(timeout=60_000)
    chosen.get_by_text("18 ms").wait_for(timeout=30_000)
    chosen.wait_for_function(
        "[...document.images].some(i => i.complete && i.naturalWidth === 480)", timeout=60_000
    )
    chosen.close()
    # Edges of labels and marks are grey too. Under load viser draws coarser: counts are rough.
    grey = _pixels(page, labels.TRAFFIC_RGB["unknown"], shot)

    running.stop_sending()
    page.get_by_text("Traffic is calm on 0 of 2 watched roads").wait_for(timeout=20_000)
    page.get_by_text("nothing here is up to date").wait_for(timeout=20_000)
    _wait_for_pixels(page, labels.TRAFFIC_RGB["unknown"], shot, grey + 500)
    assert _pixels(page, labels.TRAFFIC_RGB["stable"], shot) < 50
    assert _pixels(page, labels.TRAFFIC_RGB["turbulent"], shot) < 50

    own = (running.address, "data:", "blob:")
    assert [url for url in running.requests if not url.startswith(own)] == []
    began = time.monotonic()
    running.process.terminate()
    assert running.process.wait(timeout=30) == 0
    assert time.monotonic() - began < 15
    assert "Traceback" not in running.log.read_text()
