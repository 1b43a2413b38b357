"""What the wheel contains is what its commands need, with each role's libraries and no others."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import zipfile
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from .conftest import DEPLOY, ROOT

pytestmark = [pytest.mark.long, pytest.mark.process]

PACKAGES = {
    *("slipstream", "slipstream_cli", "edge_daemon", "vehicle_agent"),
    *("dispatcher_daemon", "dashboard", "storage"),
}
CALLS = {
    "edge": "--config site.toml --rsu rsu-1",
    "dispatcher": "--config none.toml",
    "agent": "--config none.toml",
    "dashboard": "--database sqlite:///none.db",
    "scheduler": "--config none.toml",
    "worker": "--config none.toml",
    "router": "--config none.json5",
    "init": "--osm none.osm",
    "import": "osm none.osm --out nets",
    "net": "show --net none.net.xml",
    "rsu": "remove none --config site.toml",
    "calibrate": "--image none.png --out camera.toml",
    "track": "none.mp4 --camera none.toml",
    "check": "site.toml",
    "status": "--seconds 0.1",
    "token": "new me --scopes read --file tokens.toml",
    "orders": "list --database sqlite:///none.db",
    "completion": "bash",
    "export": "cycles --database sqlite:///none.db --out cycles",
    "feed": "datex2 --database sqlite:///none.db --out feed.xml",
    "explain": "1 --database sqlite:///none.db",
    "replay": "1 --database sqlite:///none.db",
    "db": "check --database sqlite:///none.db",
}
"""Of each command a call that gets as far as what it needs, and has nothing to do then."""
OWN = {
    "agent": {"agent", "router", "check", "status"},
    "edge": {"edge", "router", "check", "status", "calibrate", "track"},
    "worker": {"worker", "check", "status"},
    "server": CALLS.keys() - {"edge", "calibrate", "track"},
    "all": CALLS.keys(),
}
"""By role the commands that its libraries are for."""
MISSING = re.compile(r"slipstream: \S+ is not installed; pip install 'slipstream\[(\w+)\]'\n")
_EACH = """
import json, os, sys
from slipstream_cli.main import COMMANDS, laboratory, main, parser
calls = json.load(sys.stdin)
assert not laboratory.commands()
told = {}
for command, arguments in calls.items():
    for line in ([command, "--help"], [command, *arguments.split()]):
        child = os.fork()
        if child == 0:
            os.dup2(os.open("out", os.O_CREAT | os.O_TRUNC | os.O_WRONLY), 1)
            os.dup2(os.open("err", os.O_CREAT | os.O_TRUNC | os.O_WRONLY), 2)
            try:
                status = main(line)
            except SystemExit as end:
                status = end.code or 0
            except BaseException as error:
                print("Traceback", repr(error), file=sys.stderr)
                status = 70
            sys.stderr.flush()
            os._exit(status)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        told[" ".join(line)] = status, open("err").read()
json.dump({"listed": [*COMMANDS], "told": told}, open("told.json", "w"))
"""
"""Calls each command in a process of its own, which need not read the program again."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The product's wheel, as it is released."""
    folder = tmp_path_factory.mktemp("wheel")
    built = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, ROOT],
        capture_output=True,
        text=True,
    )
    if built.returncode != 0 and "hatchling" in built.stderr:
        pytest.skip(f"hatchling cannot be had: {built.stderr.strip()[-200:]}")
    assert built.returncode == 0, built.stderr
    (path,) = folder.glob("slipstream-*.whl")
    return path


def environment(role: str, wheel: Path, folder: Path) -> Path:
    """A Python with the wheel and the libraries of a role's lock, linked from this one's."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(packages)
    for name in re.findall(r"^([\w.-]+)==", (DEPLOY / "locks" / f"{role}.txt").read_text(), re.M):
        try:
            library = distribution(name)
        except PackageNotFoundError:
            continue  # for another Python
        for top in {file.parts[0] for file in library.files or () if file.parts[0] != ".."}:
            if not (packages / top).exists():
                (packages / top).symlink_to(Path(str(library.locate_file(top))))
    return folder / "bin" / "python"


def test_the_wheel_has_the_product_and_its_data_only(wheel: Path) -> None:
    """Nothing of the laboratory or the tests; weights, pages and migrations are in it."""
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == PACKAGES
    tracked = subprocess.run(
        ["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    assert set(tracked) <= names
    assert not [name for name in names if "/tests/" in name or name.endswith(".pyc")]


@pytest.mark.parametrize("role", OWN)
def test_each_command_of_a_role_works_or_names_its_extra(
    role: str, wheel: Path, tmp_path: Path
) -> None:
    """Each listed command has its help; what a role is not for is refused in one line that names
    the extra.
    """
    python = environment(role, wheel, tmp_path / "venv")
    work = tmp_path / "work"
    work.mkdir()
    site = "site" if role == "all" else f"site-{role}"
    (work / "site.toml").write_bytes((DEPLOY / "config" / f"{site}.toml").read_bytes())
    subprocess.run(
        [python, "-I", "-c", _EACH], cwd=work, input=json.dumps(CALLS), text=True, check=True
    )
    found = json.loads((work / "told.json").read_text())
    assert set(found["listed"]) == CALLS.keys()
    for line, (status, stderr) in found["told"].items():
        command = line.split()[0]
        assert status in ((0,) if line.endswith("--help") else (0, 1, 2)), (line, stderr)
        assert "Traceback" not in stderr, (line, stderr)
        assert "usage" not in stderr, (line, stderr)
        assert "see slipstream" not in stderr, (line, stderr)  # a slip of this test's
        if "is not installed" in stderr:
            assert MISSING.fullmatch(stderr), (line, stderr)
            assert status == 2, line
            assert command not in OWN[role], (line, stderr)
