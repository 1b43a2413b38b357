"""Faults of the database cost cycles, never the dispatcher, and unstored plans are not sent."""

from __future__ import annotations

import logging
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import tomli_w
from prometheus_client import REGISTRY

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.daemon import check_health
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.service.dispatcher.reports import failed_report
from dispatcher_daemon.service.schedule import CycleScheduler
from dispatcher_daemon.service.store import CyclePruner, open_checked_database
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from slipstream.bus import Router
from slipstream.config import ServiceSettings
from slipstream.messages import CycleReport, Message, VehiclePlan
from slipstream.service import Service
from storage import Database, StorageError, open_database, open_reader
from tests.dispatcher_daemon.service.waiting import wait_for

DAY_NS = 86_400_000_000_000
SETTINGS = DispatcherSettings(solvers=("exact",))


@dataclass
class Sent:
    """A bus that keeps what is published."""

    messages: list[Message | bytes] = field(default_factory=list)

    def publisher(self, key: str) -> Sent:
        """All publishers are one."""
        return self

    def put(self, message: Message | bytes) -> None:
        """Keep it."""
        self.messages.append(message)

    def take(self) -> tuple[list[CycleReport], list[VehiclePlan]]:
        """Reports and plans since the last call."""
        taken, self.messages = self.messages, []
        return (
            [message for message in taken if isinstance(message, CycleReport)],
            [message for message in taken if isinstance(message, VehiclePlan)],
        )


def make(demo: RoutingProblem, bus: Sent, database: Database) -> Dispatcher:
    """A dispatcher on a real database."""
    solve = solve_in_process([ExactSolver()])
    return Dispatcher(SETTINGS, demo.network, demo.fleet, bus, database, solve)


def metric(name: str, **labels: str) -> float:
    """A metric's present value."""
    return REGISTRY.get_sample_value(f"slipstream_dispatcher_{name}", labels) or 0.0


def stored(path: Path) -> list[int]:
    """Numbers of the cycles in a database."""
    with open_reader(f"sqlite:///{path}") as reader:
        return [report.cycle for report in reader.cycles(limit=100_000)]


@pytest.mark.attack
@pytest.mark.long
def test_a_start_with_the_clock_ahead_deletes_nothing(
    demo: RoutingProblem,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """400 days ahead, 624 cycles stay: one warning a start, a metric, and a way to go on."""
    path = tmp_path / "cycles.db"
    url = f"sqlite:///{path}"
    real_ns = time.time_ns()
    with open_database(url) as database:
        for number in range(1, 625):
            started_ns = real_ns - (624 - number) * DAY_NS // 8
            database.record_cycle(failed_report(number, started_ns, 0.1, "of before"), [], [])
    ahead_ns = 400 * DAY_NS
    clock = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: clock() + ahead_ns)
    number = 624
    for _ in range(2):
        caplog.clear()
        with caplog.at_level(logging.WARNING), open_database(url, owned=True) as database:
            dispatcher = make(demo, Sent(), database)
            for _ in range(5):
                dispatcher.run_cycle()
                number += 1
        assert stored(path) == list(range(1, number + 1))
        (record,) = caplog.records
        assert "days ahead" in record.message
        assert metric("clock_untrusted") == 1
    # Back to the right time: what is too old goes, and only that.
    ahead_ns = 14 * DAY_NS // 8
    with open_database(url, owned=True) as database:
        dispatcher = make(demo, Sent(), database)
        dispatcher.run_cycle()
    assert metric("clock_untrusted") == 0
    assert stored(path) == list(range(1, number + 2))
    ahead_ns = 20 * DAY_NS
    with open_database(url, owned=True) as database:
        database.trust_clock(time.time_ns())
        make(demo, Sent(), database).run_cycle()
    assert stored(path)[0] == 51


def fill(database: Database, real_ns: int) -> None:
    """Cycles of 12 days, two a day."""
    for number in range(1, 25):
        started_ns = real_ns - (24 - number) * DAY_NS // 2
        database.record_cycle(failed_report(number, started_ns, 0.1, "of before"), [], [])


@pytest.mark.slow
@pytest.mark.attack
def test_a_clock_that_runs_steadily_for_a_day_is_trusted(tmp_path: Path) -> None:
    """After a stop of 100 days deletion waits for it and then goes on by itself; a clock that is
    set meanwhile begins anew.
    """
    path, real_ns, running_s = tmp_path / "cycles.db", 1_800_000_000 * 10**9, 5.0
    ahead_ns = 100 * DAY_NS
    with open_database(f"sqlite:///{path}") as database:
        fill(database, real_ns)
        pruner = CyclePruner(database, 90.0, 1e6, lambda: running_s)

        def run_for(hours: float) -> None:
            nonlocal running_s
            for _ in range(round(4 * hours)):
                running_s += 900.0
                pruner.after_cycle(real_ns + ahead_ns + round(running_s * 1e9))

        run_for(19)
        assert stored(path) == list(range(1, 25))
        assert pruner.clock_fault is not None
        assert "101 days ahead" in pruner.clock_fault
        assert "in 2 h" in pruner.clock_fault
        assert metric("clock_untrusted") == 1
        # It jumps: the day begins anew.
        ahead_ns += 300 * DAY_NS
        run_for(19)
        assert stored(path) == list(range(1, 25))
        ahead_ns -= 300 * DAY_NS
        run_for(22)
        # Of 100 days ago and older all but the last cycle.
        assert stored(path) == [24]
        assert pruner.clock_fault is None
        assert metric("clock_untrusted") == 0


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.attack
def test_a_pause_moves_the_trusted_time_on(tmp_path: Path) -> None:
    """A pause of nine days with a restart each eighteen hours is no jump for the first cycle."""
    path, now_ns = tmp_path / "cycles.db", 1_800_000_000 * 10**9

    def monotonic() -> float:
        return now_ns / 1e9

    with open_database(f"sqlite:///{path}") as database:
        fill(database, now_ns)
        for _ in range(12):
            # A restart: what the process before knew of the clock is gone.
            pruner = CyclePruner(database, 90.0, 1e6, monotonic)
            for _ in range(6):
                now_ns += 3 * 3600 * 10**9
                pruner.after_cycle(now_ns)
        assert pruner.clock_fault is None
        assert database.prune(10.0, now_ns) == 21


def _overwrite(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(4096)
        file.write(bytes(range(256)) * 16 * 40)


def _replace_by_text(path: Path) -> None:
    text = path.with_name("text")
    text.write_text("Dear diary" * 1000)
    text.replace(path)


def _replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.long
@pytest.mark.attack
@pytest.mark.slow
@pytest.mark.parametrize("spoil", [_overwrite, _replace_by_text, _replace_by_folder])
def test_a_spoiled_database_costs_cycles_until_it_is_restored(
    demo: RoutingProblem, tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    """Plans stop, the reason is published and counted, and a backup put in place ends it."""
    path, backup, bus = tmp_path / "cycles.db", tmp_path / "backup.db", Sent()
    with open_database(f"sqlite:///{path}", owned=True) as database:
        dispatcher = make(demo, bus, database)
        for _ in range(12):
            dispatcher.run_cycle()
        with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(backup)) as copy:
            source.backup(copy)
        with database._raw() as cursor:
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            # Pages in memory would hide what is on the disk.
            cursor.execute("PRAGMA cache_size = 1")
            cursor.execute("PRAGMA shrink_memory")
        bus.take()
        lost = metric("cycles_total", status="lost")
        spoil(path)
        for _ in range(4):
            dispatcher.run_cycle()
        reports, plans = bus.take()
        assert [report.cycle for report in reports] == [13, 14, 15, 16]
        unstored = [report.cycle for report in reports if report.status == "failed"]
        assert unstored[-3:] == [14, 15, 16]
        assert all("not stored" in (report.reason or "") for report in reports[-3:])
        assert {plan.cycle for plan in plans}.isdisjoint(unstored)
        assert dispatcher.delivery.failed == len(unstored)
        assert metric("cycles_total", status="lost") == lost + len(unstored)
        if path.is_dir():
            path.rmdir()
        backup.replace(path)
        dispatcher.run_cycle()
        dispatcher.run_cycle()
        reports, plans = bus.take()
        assert reports[-1].status != "failed"
        assert {plan.cycle for plan in plans} == {18}
    assert stored(path) == [*range(1, 13), 18]


@pytest.mark.attack
@pytest.mark.slow
def test_a_deleted_database_costs_one_cycle(demo: RoutingProblem, tmp_path: Path) -> None:
    """No plan is sent of it; then cycles are stored at the path again, with their own numbers."""
    path, bus = tmp_path / "state" / "cycles.db", Sent()
    with open_database(f"sqlite:///{path}", owned=True) as database:
        dispatcher = make(demo, bus, database)
        dispatcher.run_cycle()
        for number in (2, 5):
            bus.take()
            if number == 2:
                path.unlink()
            else:
                shutil.rmtree(path.parent)
            for _ in range(3):
                dispatcher.run_cycle()
            reports, plans = bus.take()
            assert [report.status == "failed" for report in reports] == [True, False, False]
            assert {plan.cycle for plan in plans} == {number + 1, number + 2}
            assert stored(path) == [number + 1, number + 2]
        assert dispatcher.delivery.failed == 2


@pytest.mark.attack
@pytest.mark.slow
def test_a_full_disk_costs_cycles_until_there_is_room(demo: RoutingProblem, tmp_path: Path) -> None:
    """Cycles are lost one by one while it is full; the first after it is stored."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16m", "none", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("no file system can be mounted here")
    path, bus = disk / "cycles.db", Sent()
    try:
        with open_database(f"sqlite:///{path}", owned=True) as database:
            dispatcher = make(demo, bus, database)
            dispatcher.run_cycle()
            with suppress(OSError), (disk / "other.log").open("wb", buffering=0) as other:
                while other.tell() < 2**25:
                    other.write(bytes(512))
            # What was allocated to the log is still there for some cycles.
            ends = time.monotonic() + 60
            while failed_cycles(dispatcher) < 3 and time.monotonic() < ends:
                dispatcher.run_cycle()
            assert failed_cycles(dispatcher) == 3
            reports, plans = bus.take()
            failed = {report.cycle for report in reports if report.status == "failed"}
            assert {plan.cycle for plan in plans}.isdisjoint(failed)
            (disk / "other.log").unlink()
            dispatcher.run_cycle()
            (report,), _ = bus.take()
            assert report.status != "failed"
        assert set(stored(path)) == set(range(1, report.cycle + 1)) - failed
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_dispatcher_whose_database_another_one_writes_ends(
    demo: RoutingProblem, tmp_path: Path
) -> None:
    """It writes nothing over the other's rows, and ends so that systemd starts it again."""
    path, bus = tmp_path / "cycles.db", Sent()
    with open_database(f"sqlite:///{path}", owned=True) as database:
        dispatcher = make(demo, bus, database)
        dispatcher.run_cycle()
        path.with_name("cycles.db-lock").unlink()
        with open_database(f"sqlite:///{path}", owned=True) as other:
            other.record_cycle(failed_report(2, time.time_ns(), 0.1, "the other's"), [], [])
            bus.take()
            dispatcher.run_cycle()
            (report,), plans = bus.take()
            assert (report.status, plans) == ("failed", [])
            assert dispatcher.delivery.stopping.is_set()
            scheduler = CycleScheduler(dispatcher.run_cycle, 30.0, lambda _: None)
            # Not an InputError: status 2 would keep systemd from starting it again.
            with pytest.raises(StorageError, match="another dispatcher has taken over"):
                check_health(dispatcher, scheduler, Service("dispatcher", ServiceSettings()))
    with open_reader(f"sqlite:///{path}") as reader:
        assert [report.reason for report in reader.cycles(9)][1:] == ["the other's"]


def failed_cycles(dispatcher: Dispatcher) -> int:
    """Cycles that its health calls failed."""
    return dispatcher.delivery.failed


def test_systemd_waits_for_the_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The start of a large database is given an hour, and the rest of the start its usual time."""
    url = f"sqlite:///{tmp_path}/cycles.db"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(10)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        open_checked_database(url).close()
        heard = [manager.recv(100).decode() for _ in range(2)]
    assert heard == ["EXTEND_TIMEOUT_USEC=3600000000", "EXTEND_TIMEOUT_USEC=180000000"]
    unit = Path(__file__).parents[3] / "deploy" / "systemd" / "slipstream-dispatcher.service"
    assert "TimeoutStartSec=180\n" in unit.read_text()


@pytest.fixture
def config(tmp_path: Path) -> Iterator[Path]:
    """Settings of a real dispatcher with a router of its own."""
    with Router() as router:
        path = tmp_path / "dispatcher.toml"
        path.write_text(
            tomli_w.dumps(
                {
                    "bus": {"connect": [router.endpoint]},
                    "database_url": f"sqlite:///{tmp_path / 'cycles.db'}",
                    "dispatcher": {
                        "solvers": ["exact"],
                        "interval_s": 2.0,
                        "deadline_s": 1.0,
                    },
                }
            )
        )
        yield path


def start(config: Path) -> subprocess.Popen[str]:
    """A real dispatcher."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    command = [sys.executable, "-m", "slipstream_cli", "dispatcher", "--config", str(config)]
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)


@pytest.mark.attack
@pytest.mark.process
@pytest.mark.long
def test_a_second_dispatcher_ends_at_once(
    config: Path, full_size: bool, figure: Callable[[str], None]
) -> None:
    """It says so in one line, exit status 2; the first goes on, and its death frees the file."""
    path = config.with_name("cycles.db")
    with start(config) as first:
        assert wait_for(lambda: path.exists() and len(stored(path)) >= 1)
        began = time.monotonic()
        second = start(config)
        _, line = second.communicate(timeout=60)
        took_s = time.monotonic() - began
        assert second.returncode == 2
        assert line.count("\n") == 1
        assert f"{path}: is written by another dispatcher (process {first.pid})" in line
        count = len(stored(path))
        assert wait_for(lambda: len(stored(path)) > count + 1)
        first.kill()
        first.communicate()
    with start(config) as third:
        count = len(stored(path))
        assert wait_for(lambda: len(stored(path)) > count)
        third.terminate()
        _, log = third.communicate(timeout=60)
    assert third.returncode == 0
    assert "Traceback" not in log
    assert stored(path) == list(range(1, len(stored(path)) + 1))
    figure(f"the second one ended after {took_s:.1f} s")
    assert took_s < (5 if full_size else 60)
