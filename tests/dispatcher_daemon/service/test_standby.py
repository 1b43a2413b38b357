"""A standby waits without taking part, and takes over soon after the active dispatcher's death."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import tomli_w
from sqlalchemy import create_engine, text

from dispatcher_daemon.service.store import open_in_turn
from slipstream.bus import Router, free_port
from slipstream.config import ServiceSettings
from slipstream.errors import InputError
from slipstream.service import Service
from storage import StorageError, open_database, open_reader
from storage.engine import parse_url
from storage.ownership import _ADVISORY_LOCK
from tests.dispatcher_daemon.service.waiting import wait_for

MAX_TAKEOVER_S = 10.0


def test_a_standby_opens_what_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits as long as another one writes and says so to a probe, ends when it is stopped, and
    refuses a bad URL.
    """
    monkeypatch.setattr("dispatcher_daemon.service.store.TURN_PERIOD_S", 0.01)
    url = f"sqlite:///{tmp_path}/cycles.db"
    port = free_port()

    def told() -> tuple[int, str]:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/readyz", timeout=60) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()

    service = Service("dispatcher", ServiceSettings(metrics_port=port))
    active = open_database(url, owned=True)
    taken = []
    waiting = threading.Thread(target=lambda: taken.append(open_in_turn(url, service)))
    with service:
        waiting.start()
        assert wait_for(lambda: told() == (503, "standby\n"))
        waiting.join(0.2)
        assert waiting.is_alive()
        active.close()
        waiting.join(60)
        assert told() == (503, "starting\n")
    (database,) = taken
    assert database is not None
    with database:
        service.stopping.set()
        assert open_in_turn(url, service) is None
    with pytest.raises(InputError, match="is a directory"):
        open_in_turn(f"sqlite:///{tmp_path}", service)


@contextmanager
def dispatcher(config: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A real dispatcher, which does not outlive the block; its lines go to a file."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    command = [sys.executable, "-m", "slipstream_cli", "dispatcher", "--config", str(config)]
    log = config.with_name(f"dispatcher{''.join(options)}.log")
    with (
        log.open("w") as lines,
        subprocess.Popen([*command, *options], env=environment, stderr=lines, text=True) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


def numbers(url: str) -> list[int]:
    """Numbers of the cycles stored."""
    try:
        with open_reader(url) as reader:
            return [report.cycle for report in reader.cycles(limit=1000)]
    except StorageError:
        return []  # Its writer is being replaced.


@pytest.mark.attack
@pytest.mark.process
@pytest.mark.long
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_standby_takes_over(
    kind: str,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    full_size: bool,
    figure: Callable[[str], None],
) -> None:
    """SIGKILL of the active one: the standby's first cycle is stored soon, numbered on."""
    url = (
        f"sqlite:///{tmp_path / 'cycles.db'}"
        if kind == "sqlite"
        else request.getfixturevalue("postgres_url")
    )
    config = tmp_path / "dispatcher.toml"
    with Router() as router:
        config.write_text(
            tomli_w.dumps(
                {
                    "bus": {"connect": [router.endpoint]},
                    "database_url": url,
                    "dispatcher": {
                        "solvers": ["exact"],
                        "interval_s": 2.0,
                        "deadline_s": 1.0,
                    },
                }
            )
        )
        with dispatcher(config) as active, dispatcher(config, "--standby") as standby:
            log = tmp_path / "dispatcher--standby.log"
            assert wait_for(lambda: "standby: waiting" in log.read_text())
            assert wait_for(lambda: len(numbers(url)) >= 2)
            assert standby.poll() is None
            active.send_signal(signal.SIGKILL)
            active.wait()
            killed = time.monotonic()
            before = numbers(url)
            assert wait_for(lambda: len(numbers(url)) > len(before))
            took_s = time.monotonic() - killed
            standby.terminate()
            assert standby.wait(60) == 0
    after = numbers(url)
    assert after == list(range(1, len(after) + 1))
    assert "active one now" in log.read_text()
    assert "Traceback" not in log.read_text()
    figure(f"{kind}: the first cycle {took_s:.1f} s after the death, at one cycle in 2 s")
    assert took_s < (MAX_TAKEOVER_S if full_size else 60.0)


_LOCK_HOLDER = text(
    "SELECT pid FROM pg_locks WHERE locktype = 'advisory' AND granted AND objsubid = 1"
    " AND (classid::bigint << 32 | objid::bigint) = :key"
)


def cut_lock(url: str) -> int:
    """End the session that holds a database's lock; the server's process that it was."""
    engine = create_engine(parse_url(url))
    try:
        with engine.begin() as connection:
            (process,) = connection.scalars(_LOCK_HOLDER, {"key": _ADVISORY_LOCK}).all()
            assert connection.scalar(text("SELECT pg_terminate_backend(:pid)"), {"pid": process})
    finally:
        engine.dispose()
    return int(process)


@pytest.mark.attack
@pytest.mark.process
@pytest.mark.long
def test_a_dispatcher_that_lost_its_lock_ends_and_writes_nothing_more(
    tmp_path: Path, postgres_url: str
) -> None:
    """Its session is ended by the server, it lives on: the standby takes the lock, and what the
    first one plans then is neither stored nor sent.
    """
    config = tmp_path / "dispatcher.toml"
    with Router() as router:
        config.write_text(
            tomli_w.dumps(
                {
                    "bus": {"connect": [router.endpoint]},
                    "database_url": postgres_url,
                    "dispatcher": {
                        "solvers": ["exact"],
                        "interval_s": 10.0,
                        "deadline_s": 1.0,
                    },
                }
            )
        )
        first, second = tmp_path / "dispatcher.log", tmp_path / "dispatcher--standby.log"
        with dispatcher(config) as active, dispatcher(config, "--standby") as standby:
            assert wait_for(lambda: "standby: waiting" in second.read_text())
            assert wait_for(lambda: bool(numbers(postgres_url)))
            before = len(numbers(postgres_url))
            # Right after a cycle: the standby asks each second, the next cycle is 10 s away.
            assert wait_for(lambda: len(numbers(postgres_url)) > before)
            before = len(numbers(postgres_url))
            assert wait_for(lambda: first.read_text().count(" plans by ") == before)
            cut_lock(postgres_url)
            assert wait_for(lambda: "active one now" in second.read_text())
            assert active.wait(60) != 0
            assert wait_for(lambda: len(numbers(postgres_url)) >= before + 2)
            standby.terminate()
            assert standby.wait(60) == 0
    after = numbers(postgres_url)
    assert after == list(range(1, len(after) + 1))
    lines = first.read_text()
    assert "another dispatcher has taken over; this one ends" in lines
    assert lines.count(" plans by ") == before
    assert second.read_text().count(" plans by ") == len(after) - before
