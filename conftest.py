"""Fixtures that several packages' tests share."""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings

from slipstream.bus import Bus, Router
from slipstream.config import BusSettings

# Shared machines are slow at times, and a suite has to say the same thing twice.
settings.register_profile(
    "slipstream",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
# For `make mutants`: a change is found by some examples or not, and nobody reads the smallest one.
settings.register_profile(
    "mutants",
    settings.get_profile("slipstream"),
    max_examples=20,
    phases=[Phase.explicit, Phase.generate],
    database=None,
)
settings.load_profile("slipstream")


def pytest_configure() -> None:
    """Temporary files lie in memory where the machine has such a folder: `fsync` costs nothing,
    and a process that is killed loses no more there than on a disk.
    """
    if Path("/dev/shm").is_dir() and shutil.disk_usage("/dev/shm").free > 2**31:
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", "/dev/shm")


@pytest.fixture(autouse=True)
def root_level() -> Iterator[None]:
    """Puts back the level of the root logger, which daemons that run in a test's process set."""
    before = logging.getLogger().level
    yield
    logging.getLogger().setLevel(before)


@pytest.fixture
def router() -> Iterator[Router]:
    """A zenoh router on a free loopback port."""
    with Router() as running:
        yield running


@pytest.fixture
def bus(router: Router) -> Iterator[Bus]:
    """A session connected to the router."""
    with Bus.open(BusSettings(connect=(router.endpoint,))) as session:
        yield session


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with the real clip and the COCO weights, where the machine has it."""
    folder = Path(__file__).resolve().parents[1] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no shared data beside the checkout")
    return folder


@pytest.fixture(scope="session")
def made_once(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str, Callable[[Path], object]], Path]:
    """Makes a folder of a name once for all pytest-xdist workers of a run, and returns it.

    The first caller fills it while the others wait. Tests only read it.
    """
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    shared.mkdir(exist_ok=True)

    def make(name: str, fill: Callable[[Path], object]) -> Path:
        folder, complete = shared / name, shared / f"{name}.complete"
        with (shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not complete.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                complete.touch()
        return folder

    return make


class _StreetClips(dict[str, Path]):
    """Renders a clip when it is first asked for."""

    def __init__(self, made_once: Callable[[str, Callable[[Path], object]], Path]) -> None:
        self._made_once = made_once

    def __missing__(self, scenario: str) -> Path:
        from slipstream_lab.simulation.streetdrive.clip import ClipSettings, render_clip

        seed = {"stable": 31, "turbulent": 32}[scenario]
        settings = ClipSettings(
            seconds=14, fps=15, scenario=scenario, seed=seed, segment_id=f"{scenario}_road"
        )
        self[scenario] = self._made_once(scenario, partial(render_clip, settings))
        return self[scenario]


@pytest.fixture(scope="session")
def street_clips(
    made_once: Callable[[str, Callable[[Path], object]], Path],
) -> dict[str, Path]:
    """Folders of a calm and a stop-and-go clip: 14 s at 15 frames a second, seeds of their own."""
    return _StreetClips(made_once)


FULL_SIZE = "ATTACK_FULL_SIZE"
"""Set by `make attack`: tests marked `attack` then take the size that the aim names."""
_FIGURES = pytest.StashKey[list[str]]()


@pytest.fixture(scope="session")
def full_size() -> bool:
    """True in `make attack`; elsewhere an attack is shorter or smaller, and otherwise the same."""
    return FULL_SIZE in os.environ


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Adds a line with a measured figure to the end of the run's report."""

    def add(line: str) -> None:
        request.config.stash.setdefault(_FIGURES, []).append(f"{request.node.name}: {line}")

    return add


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Show the figures that tests have measured."""
    if lines := terminalreporter.config.stash.get(_FIGURES, []):
        terminalreporter.section("figures")
        for line in lines:
            terminalreporter.line(line)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What a test uses marks it: a browser is a process, clips and traffic take their time."""
    for item in items:
        fixtures = getattr(item, "fixturenames", ())
        if "browser" in fixtures:
            item.add_marker("process")
        if {"street_clips", "morning"}.intersection(fixtures):
            item.add_marker("slow")
        # The tiers lie in each other: nightly is long, long is slow.
        for tier, wider in (("nightly", "long"), ("long", "slow")):
            if item.get_closest_marker(tier):
                item.add_marker(wider)


REQUIRED = "CI_REQUIRES"
"""Programs, by name, that have to be there: without them tests fail instead of being skipped."""


@pytest.fixture(scope="session")
def tool() -> Callable[[str], str]:
    """Path of a program; without it the test is skipped, or fails if it is `REQUIRED`."""

    def find(name: str) -> str:
        path = shutil.which(name) or shutil.which(name, path="/usr/sbin:/sbin")
        if name == "postgresql":
            from slipstream_lab.benchmarks.postgres_server import find_pg_ctl

            path = find_pg_ctl()
        if path is None and name in os.environ.get(REQUIRED, "").split():
            pytest.fail(f"{name} is not installed, but {REQUIRED} names it")
        if path is None:
            pytest.skip(f"{name} is not installed")
        return path

    return find


@pytest.fixture(scope="session")
def postgres(tool: Callable[[str], str]) -> Iterator[Any]:
    """A server for all tests of a session."""
    from slipstream_lab.benchmarks.postgres_server import PostgresServer

    pg_ctl = tool("postgresql")
    pytest.importorskip("psycopg")
    server = PostgresServer(pg_ctl)
    try:
        yield server
        server.stop()
    finally:
        server.remove()


@pytest.fixture
def postgres_url(postgres: Any) -> str:
    """An empty database of the server."""
    return postgres.new_database()


CHROMIUM_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@pytest.fixture(scope="module")
def browser(tool: Callable[[str], str]) -> Iterator[Any]:
    """A headless Chromium that draws WebGL in software; one for a module, as playwright allows no
    other event loop while it runs.
    """
    chromium = tool("chromium")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium, args=CHROMIUM_ARGUMENTS)
        yield running
        running.close()
