"""The front door."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import tomli_w

from slipstream_cli.commands import db
from slipstream_cli.main import main


class Done(NamedTuple):
    """What a command answered."""

    returncode: int
    stdout: str
    stderr: str


Command = Callable[..., Done]


@pytest.fixture
def slipstream(capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs the command in this process."""

    def run(*arguments: str) -> Done:
        try:
            status = main(arguments)
        except SystemExit as ended:
            status = int(ended.code or 0)
        return Done(status, *capsys.readouterr())

    return run


def one_line(result: Done | subprocess.CompletedProcess[str]) -> str:
    """The error line of a command that refused its input."""
    assert result.returncode == 2, result.stderr
    (line,) = [li for li in result.stderr.splitlines() if li.strip()]
    assert line.startswith("slipstream: ")
    return line


def test_check_accepts_sound_settings_and_names_faults(slipstream: Command, tmp_path: Path) -> None:
    """One line a file when sound; file, key and mend when not."""
    sound = tmp_path / "site.toml"
    sound.write_text(tomli_w.dumps({"dispatcher": {"interval_s": 60.0}}))
    result = slipstream("check", str(sound))
    assert (result.returncode, result.stdout) == (
        0,
        f"{sound}: valid site\n",
    )
    faulty = tmp_path / "other-site.toml"
    faulty.write_text(tomli_w.dumps({"dashboard": {"port": "8080"}}))
    assert f"{faulty}: dashboard.port: " in one_line(slipstream("check", str(sound), str(faulty)))
    other = tmp_path / "other.toml"
    other.write_text("")
    assert "--as" in one_line(slipstream("check", str(other)))


@pytest.mark.slow
def test_check_takes_fleets_and_instances_and_lists_what_nobody_can_serve(
    slipstream: Command, tmp_path: Path
) -> None:
    """A stop with too much demand is no fault of the file's, a node that is not there is one."""
    fleet: dict[str, Any] = {
        "depots": [{"node": "depot"}],
        "stops": [{"id": "s1", "node": "c1"}, {"id": "s2", "node": "c2", "demand": 5}],
        "vehicles": [{"id": "van", "capacity": 3}],
    }
    vans, whole = tmp_path / "vans.toml", tmp_path / "morning.json"
    vans.write_text(tomli_w.dumps(fleet))
    instance = {"format": "slipstream-instance/1", "name": "morning", "fleet": fleet}
    whole.write_text(json.dumps(instance | {"network": {"sumo_net": "demo"}}))
    roads = ("--network", "demo")
    result = slipstream("check", str(vans), str(whole), *roads)
    assert result.returncode == 0
    reason = "its demand of 5 is above every capacity (nearest: 3 of 'van')"
    assert result.stdout.splitlines() == [
        f"{vans}: valid fleet",
        f"{vans}: stop s2 cannot be served: {reason}",
        f"{whole}: valid instance",
        f"{whole}: stop s2 cannot be served: {reason}",
    ]
    vans.write_text(tomli_w.dumps(fleet | {"stops": []}))
    alone = slipstream("check", str(vans), *roads)
    assert alone.stdout.splitlines() == [f"{vans}: valid fleet"]
    fleet["stops"][0]["node"] = "c9"
    vans.write_text(tomli_w.dumps(fleet))
    assert f"{vans}: stops.s1.node: unknown node 'c9'" in one_line(
        slipstream("check", str(vans), *roads)
    )


@pytest.mark.slow
def test_the_database_is_made_checked_and_pruned(slipstream: Command, tmp_path: Path) -> None:
    """The three actions work on one file and report as JSON."""
    url = f"sqlite:///{tmp_path / 'a.db'}"
    assert slipstream("db", "upgrade", "--database", url).returncode == 0
    checked = slipstream("db", "check", "--url", url, "--json")
    assert checked.returncode == 0
    assert json.loads(checked.stdout)["faults"] == []
    pruned = slipstream("db", "prune", "--url", url, "--keep-days", "1", "--json")
    assert json.loads(pruned.stdout)["deleted_cycles"] == 0
    for days in ("-1", "inf"):
        assert "keep_days" in one_line(slipstream("db", "prune", "--url", url, "--keep-days", days))


def test_pruning_makes_no_database(slipstream: Command, tmp_path: Path) -> None:
    """A mistyped path is said, not filled."""
    url = f"sqlite:///{tmp_path / 'mistyped.db'}"
    assert "mistyped.db" in one_line(slipstream("db", "prune", "--url", url, "--keep-days", "1"))
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_one_line_and_no_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is nobody's bad input: exit status 1."""

    def full(_: object) -> int:
        raise OSError("database or disk is full\n(background on this error)")

    monkeypatch.setattr(db, "upgrade", full)
    assert main(["db", "upgrade"]) == 1
    error = capsys.readouterr().err
    assert error == "slipstream: database or disk is full (background on this error)\n"


def test_a_file_that_is_no_database_is_one_line_and_untouched(
    slipstream: Command, tmp_path: Path
) -> None:
    """The user's file is not overwritten."""
    path = tmp_path / "notes.txt"
    path.write_text("my notes, long enough to be no empty database " * 40)
    before = path.read_bytes()
    for action in ("upgrade", "check"):
        assert "notes.txt" in one_line(slipstream("db", action, "--url", f"sqlite:///{path}"))
    assert path.read_bytes() == before


def test_run_refuses_a_taken_port_and_a_shared_state(slipstream: Command, tmp_path: Path) -> None:
    """Before anything is rendered or started."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        line = one_line(slipstream("run", "--state", str(tmp_path), "--port", str(port)))
    assert f"127.0.0.1:{port}" in line
    assert "--port" in line
    assert not (tmp_path / "clips").exists()
    file = tmp_path / "file"
    file.touch()
    assert str(file) in one_line(slipstream("run", "--state", str(file)))


@pytest.mark.parametrize(
    "arguments",
    [
        ("--port", "0"),
        ("--interval", "0"),
        ("--seconds", "-1"),
        ("--seconds", "nan"),
        ("--hardware", "boston"),
    ],
)
def test_run_refuses_numbers_that_make_no_sense(
    slipstream: Command, arguments: tuple[str, str]
) -> None:
    """The line names the option."""
    assert arguments[0] in one_line(slipstream("run", *arguments))


@pytest.mark.parametrize("arguments", [(), ("fly",), ("run", "--sekonds", "3"), ("edge",)])
def test_a_wrong_command_line_is_one_line(slipstream: Command, arguments: tuple[str, ...]) -> None:
    """It says what is wrong and where to read on."""
    assert "--help" in one_line(slipstream(*arguments))


@pytest.mark.long
@pytest.mark.process
def test_a_missing_extra_is_named() -> None:
    """Without its packages a daemon says what to install."""
    code = (
        "import sys\n"
        "class Absent:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] == 'viser':\n"
        "            raise ModuleNotFoundError(f'No module named {name}', name=name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        "from slipstream_cli.main import main\n"
        "sys.exit(main(['dashboard', '--config', '/dev/null']))\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=os.environ
    )
    assert "slipstream[dashboard]" in one_line(result)


@pytest.mark.parametrize(
    ("module", "mend"),
    [
        ("osmium", "name osm in --extras of {deploy}/install.sh"),
        ("viser", "run {deploy}/install.sh server"),
        ("qiskit_ibm_catalog", "pip install 'slipstream[iskay]'"),
    ],
)
def test_a_release_on_a_machine_is_mended_by_its_installer(
    module: str, mend: str, slipstream: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not by pip, of whose work the next upgrade knows nothing; where a lock has the package."""
    deploy = tmp_path / "source" / "deploy"
    shutil.copytree(Path(__file__).parents[2] / "deploy", deploy)

    def missing(_: object) -> int:
        raise ModuleNotFoundError(name=module)

    monkeypatch.setattr(db, "upgrade", missing)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    line = one_line(slipstream("db", "upgrade"))
    assert line == f"slipstream: {module} is not installed; {mend.format(deploy=deploy)}"


NOISY = """
import ctypes, os, subprocess, sys
from dispatcher_daemon.service import vroom
from slipstream_cli.main import main

sound = vroom.solve_vroom

def noisy(*arguments, **options):
    os.write(1, b"by its number\\n")
    ctypes.CDLL(None).puts(b"by the C library, which keeps it until the end")
    subprocess.run(["echo", "by a process"])
    return sound(*arguments, **options)

vroom.solve_vroom = noisy
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.process
@pytest.mark.long
@pytest.mark.parametrize("out", [(), ("--out", "/dev/stdout")])
def test_no_library_writes_to_the_standard_output(tmp_path: Path, out: tuple[str, ...]) -> None:
    """Whatever compiled code and started processes print, a command's output is its answer."""
    request = tmp_path / "request.json"
    request.write_text(
        '{"vehicles": [{"id": 1, "start_index": 0}], "jobs": [{"id": 1, "location_index": 1}],'
        ' "matrix": [[0, 7], [7, 0]]}'
    )
    done = subprocess.run(
        [sys.executable, "-c", NOISY, "solve", "--vroom", str(request), "--json", *out],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["summary"]["cost"] == 7
    assert sorted(done.stderr.splitlines()) == [
        "by a process",
        "by its number",
        "by the C library, which keeps it until the end",
    ]
