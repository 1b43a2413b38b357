"""`slipstream explain` and `slipstream replay` on a dispatcher's database."""

from __future__ import annotations

import json
import shutil
import sqlite3
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from dispatcher_daemon.fleet import load_fleet
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.service.dispatcher.reports import failed_report
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from slipstream.messages import Message
from slipstream.roads.sumo_net import load_network
from slipstream_cli.main import main
from storage import open_database


class Nowhere:
    """A bus that nobody listens to."""

    def publisher(self, key: str) -> Nowhere:
        """Itself."""
        return self

    def put(self, message: Message | bytes) -> None:
        """Lost."""


@pytest.fixture(scope="module")
def two_cycles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database with two cycles of the demo fleet."""
    path = tmp_path_factory.mktemp("stored") / "slipstream.db"
    network = load_network("demo")
    fleet, settings = load_fleet("demo", network), DispatcherSettings(solvers=("exact",))
    with open_database(f"sqlite:///{path}") as database:
        dispatcher = Dispatcher(
            settings, network, fleet, Nowhere(), database, solve_in_process([ExactSolver()])
        )
        dispatcher.run_cycle()
        dispatcher.run_cycle()
    return path


@pytest.fixture
def path(two_cycles: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copy(two_cycles, tmp_path))


Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command on the database: (status, output, errors)."""

    def call(*words: str, url: str = f"sqlite:///{path}") -> tuple[int, str, str]:
        capsys.readouterr()
        status = main([*words, "--database", url])
        return status, *capsys.readouterr()

    return call


@pytest.mark.slow
def test_explain_prints_words_and_json(run: Run) -> None:
    """Of a number, of the latest one, and of one vehicle."""
    status, text, _ = run("explain", "1")
    assert status == 0
    assert text.startswith("cycle 1: ok\n")
    assert "\nvan-a:\n  serves " in text
    assert "\nvan-b:\n" in text
    own = run("explain", "latest", "--vehicle", "van-b")[1]
    assert own.startswith("cycle 2: ok\n")
    assert "\nvan-a:\n" not in own
    data = json.loads(run("explain", "1", "--json")[1])
    assert [one["vehicle"] for one in data["vehicles"]] == ["van-a", "van-b"]
    assert data["vehicles"][0]["account"]["driven_kwh"] > 0
    assert {one["platoon"]["reason"] for one in data["refused"]} == {"unknown"}


@pytest.mark.slow
def test_replay_of_a_cycle_is_the_same_until_what_was_stored_is_changed(
    run: Run, path: Path
) -> None:
    """Then the exit status is 1, and a line says what differs."""
    status, text, _ = run("replay", "1")
    assert (status, text) == (0, "cycle 1: the same, 2 plans compared\n")
    assert json.loads(run("replay", "2", "--json")[1])["same"] is True

    connection = sqlite3.connect(path)
    query = "SELECT data FROM cycle_inputs WHERE cycle = 2"
    record = json.loads(zlib.decompress(connection.execute(query).fetchone()[0]))
    record["versions"]["pyvrp"] = "0.1"
    record["reference_delay_s"] = 12.0
    data = zlib.compress(json.dumps(record).encode())
    connection.execute("UPDATE cycle_inputs SET data = ? WHERE cycle = 2", (data,))
    connection.commit()
    connection.close()
    status, text, _ = run("replay", "2")
    assert status == 1
    assert "made by pyvrp 0.1, now " in text
    assert "van-a: the same way, leaving 2.000 s later" in text
    assert text.endswith("cycle 2: not the same, 2 plans compared\n")


@pytest.mark.parametrize("command", ["explain", "replay"])
def test_bad_input_is_one_line(run: Run, tmp_path: Path, command: str) -> None:
    """A cycle that is none, one that is not stored, and a database that is not there."""
    for words, url, said in (
        (("seven",), None, "'seven' is no cycle"),
        (("99",), None, "has no cycle 99"),
        (("1",), f"sqlite:///{tmp_path / 'none.db'}", "no database there"),
    ):
        more = {} if url is None else {"url": url}
        status, text, errors = run(command, *words, **more)
        assert (status, text) == (2, "")
        assert said in errors
        assert errors.count("\n") == 1


@pytest.mark.slow
def test_what_is_missing_is_told(run: Run, path: Path) -> None:
    """A vehicle that the cycle does not have, and inputs that are gone or of another version."""
    status, _, errors = run("explain", "1", "--vehicle", "van-z")
    assert status == 2
    assert "van-a, van-b" in errors
    connection = sqlite3.connect(path)
    data = zlib.compress(b'{"now_ns": 1}')
    connection.execute("UPDATE cycle_inputs SET data = ? WHERE cycle = 1", (data,))
    connection.commit()
    for command in ("explain", "replay"):
        status, _, errors = run(command, "1")
        assert (status, errors.count("\n")) == (2, 1)
        assert "cannot be read: KeyError" in errors
    connection.execute("DELETE FROM input_uses WHERE cycle = 1")
    connection.execute("DELETE FROM cycle_inputs WHERE cycle = 1")
    connection.commit()
    connection.close()
    status, _, errors = run("replay", "1")
    assert status == 2
    assert "inputs of cycle 1 are not stored" in errors
    assert run("explain", "1")[0] == 0


@pytest.mark.parametrize("command", ["explain", "replay"])
@pytest.mark.parametrize("cycle", ["latest", "1"])
def test_a_database_without_a_cycle_says_so(
    run: Run, tmp_path: Path, command: str, cycle: str
) -> None:
    """It is no number that is wrong."""
    url = f"sqlite:///{tmp_path / 'new.db'}"
    with open_database(url):
        pass
    status, text, errors = run(command, cycle, url=url)
    assert (status, text, errors.count("\n")) == (2, "", 1)
    assert "no cycle is stored yet" in errors


@pytest.mark.slow
def test_a_cycle_that_made_no_plan_cannot_be_made_again(run: Run, path: Path) -> None:
    """Its reason is told by both commands; inputs that were deleted are another matter."""
    report = failed_report(3, time.time_ns(), 0.1, "no open order, or no free vehicle")
    with open_database(f"sqlite:///{path}") as database:
        database.record_cycle(report, (), ())
    status, text, errors = run("replay", "latest")
    assert (status, text, errors.count("\n")) == (2, "", 1)
    assert "cycle 3 made no plan: no open order, or no free vehicle" in errors
    status, text, errors = run("explain", "latest")
    assert (status, text, errors) == (0, f"cycle 3: failed, {report.reason}\n", "")
    status, _, errors = run("explain", "3", "--vehicle", "van-a")
    assert (status, errors.count("\n")) == (2, 1)
    assert "it has none" in errors
