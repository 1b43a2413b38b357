"""The installer, as far as it goes without root."""

from __future__ import annotations

import json
import re
import shutil
import signal
import stat
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from .conftest import DEPLOY

SCRIPT = DEPLOY / "install.sh"


def install(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the installer."""
    return subprocess.run(
        ["sh", str(SCRIPT), *map(str, arguments)], capture_output=True, text=True, timeout=60
    )


def tree(folder: Path) -> dict[str, tuple[str, int]]:
    """Content and permissions of every file."""
    return {
        str(path.relative_to(folder)): (path.read_text(), stat.S_IMODE(path.stat().st_mode))
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.slow
def test_shellcheck_has_nothing_to_say(tool: Callable[[str], str]) -> None:
    """The script is clean."""
    done = subprocess.run([tool("shellcheck"), str(SCRIPT)], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.slow
def test_each_role_gets_what_it_runs(tmp_path: Path) -> None:
    """Units, settings and nothing of the other role; settings are not for everybody's eyes."""
    assert install("--root", tmp_path / "box", "edge").returncode == 0
    assert install("--root", tmp_path / "server", "server").returncode == 0
    assert install("--root", tmp_path / "vehicle", "agent").returncode == 0
    units = "etc/systemd/system/slipstream-"
    box, server = tree(tmp_path / "box"), tree(tmp_path / "server")
    vehicle = tree(tmp_path / "vehicle")
    assert {name for name in vehicle if name.startswith(units)} == {
        f"{units}agent@.service",
        f"{units}router.service",
    }
    assert "etc/slipstream/site.toml" in vehicle
    assert "opt/slipstream/share/examples/router-vehicle.json5" in vehicle
    assert f"{units}agent@.service" not in box.keys() | server.keys()
    assert f"{units}edge@.service" in box
    assert f"{units}dispatcher.service" not in box
    assert {f"{units}dispatcher.service", f"{units}dashboard.service"} < server.keys()
    assert f"{units}edge@.service" not in server
    assert install("--root", tmp_path / "worker", "worker").returncode == 0
    worker = tree(tmp_path / "worker")
    assert {name for name in worker if name.startswith(units)} == {f"{units}worker.service"}
    assert {name for name in worker if name.startswith("etc/slipstream/")} == {
        "etc/slipstream/site.toml"
    }
    for files in (box, server, vehicle):
        assert f"{units}router.service" in files
        assert files["etc/slipstream/router.json5"][1] == 0o600
        assert "opt/slipstream/share/doc/operations.md" in files
        # What the router's unit runs is there.
        assert "opt/slipstream/share/router.py" in files


@pytest.mark.attack
def test_only_root_reads_what_is_secret(tmp_path: Path) -> None:
    """Settings, router file and passwords are root's alone; a calibration is the daemons'."""
    assert install("--root", tmp_path, "all").returncode == 0
    etc = tmp_path / "etc" / "slipstream"
    shared = {name for name, (_, mode) in tree(etc).items() if mode & 0o077}
    assert shared == {"camera-rsu-1.toml"}
    assert stat.S_IMODE((etc / "bus").stat().st_mode) == 0o700
    assert stat.S_IMODE(etc.stat().st_mode) == 0o750


@pytest.mark.slow
def test_every_daemon_gets_a_password_of_its_own(tmp_path: Path) -> None:
    """Long and different ones; a camera that is added gets its own, others keep theirs."""
    assert install("--root", tmp_path, "all").returncode == 0
    etc = tmp_path / "etc" / "slipstream"

    def users() -> dict[str, str]:
        lines = (etc / "bus" / "users").read_text().splitlines()
        return dict(line.split(":", 1) for line in lines)

    before = users()
    server = {"dispatcher", "dashboard", "fleet", "signals"}
    assert before.keys() == server | {"edge-rsu-1", "agent-depot-1", "vehicle-depot-1"}
    assert len(set(before.values())) == len(before)
    assert min(map(len, before.values())) >= 32
    with (etc / "bus" / "users").open("a") as file:
        file.write("box-1:given:by hand\n")
    with (etc / "site.toml").open("a") as file:
        for name in ("north", '"n.rth"', "a-name-that-is-too-long-for-a-user"):
            file.write(f"[rsus.{name}]\n[rsus.{name}.source]\n")
        file.write('[agents."d.2"]\n')
    assert install("--root", tmp_path, "edge").returncode == 0
    after = users()
    assert before.items() < after.items()
    assert after["box-1"] == "given:by hand"
    for user in after.keys() - {"box-1"}:
        assert (etc / "bus" / user).read_text() == after[user] + "\n"
    assert after.keys() >= {"edge-north", "agent-d.2", "vehicle-d.2"}
    # A unit's user is edge-NAME or agent-NAME; where that is no user's name, it has a drop-in.
    units = tmp_path / "etc" / "systemd" / "system"
    drop_ins = {path.parent.name: path.read_text() for path in units.glob("*.d/user.conf")}
    assert drop_ins.keys() == {
        "slipstream-edge@n.rth.service.d",
        "slipstream-edge@a-name-that-is-too-long-for-a-user.service.d",
        "slipstream-agent@d.2.service.d",
    }
    for unit, text in drop_ins.items():
        daemon = unit.removeprefix("slipstream-").split("@")[0]
        assert re.fullmatch(rf"\[Service\]\nUser={daemon}-\d+\n", text)
    assert len(set(drop_ins.values())) == 3
    # What the router lets them do comes along.
    access = json.loads((etc / "access.json").read_text())
    assert {s["id"] for s in access["subjects"]} == after.keys() - server - {"box-1"}
    assert access["rules"]


_PYTHON = """#!/bin/sh
# Stands in for Python: makes environments, and dies where the test says.
case "$*" in
    "-m venv "*)
        mkdir -p "$3/bin"
        cp "$0" "$3/bin/python"
        [ ! -e "{folder}/die-in-venv" ] || kill -9 $PPID
        echo pip >"$3/pip"
        ;;
    "-m pip "*)
        [ -e "$(dirname "$0")/../pip" ] || exit 1
        [ ! -e "{folder}/die-in-pip" ] || kill -9 $PPID
        for last; do :; done
        echo "${{last##*/source}}" >"$(dirname "$0")/../slipstream"
        ;;
    *sys.base_prefix*) echo /usr ;;
esac
"""


class Machine:
    """Installs environments below a folder, with a stand-in for Python."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.releases = folder / "root" / "opt" / "slipstream" / "releases"
        self.source = folder / "source"
        shutil.copytree(DEPLOY, self.source / "deploy")
        (self.source / "docs").mkdir()
        (self.source / "docs" / "operations.md").touch()
        router = Path("slipstream_cli") / "daemons" / "router.py"
        (self.source / router).parent.mkdir(parents=True)
        shutil.copy(DEPLOY.parent / router, self.source / router)
        script = self.source / "deploy" / "install.sh"
        text = script.read_text()
        # An environment below a folder cannot run elsewhere, which does not matter here.
        assert "root=$2 venv=no" in text
        script.write_text(text.replace("root=$2 venv=no", "root=$2"))
        self.python = folder / "python"
        self.python.write_text(_PYTHON.format(folder=folder))
        self.python.chmod(0o755)

    def install(self, version: str, die_in: str | None = None, *more: str) -> int:
        """Install a version, with more arguments; returns the exit status."""
        text = f'version = "{version}"\n\npostgres = []\ntracing = []\n'
        (self.source / "pyproject.toml").write_text(text)
        if die_in is not None:
            (self.folder / f"die-in-{die_in}").touch()
        arguments: tuple[str | Path, ...] = (
            "--root",
            self.folder / "root",
            "--python",
            self.python,
            *more,
            "edge",
        )
        done = subprocess.run(
            ["sh", self.source / "deploy" / "install.sh", *arguments],
            capture_output=True,
            timeout=60,
        )
        if die_in is not None:
            (self.folder / f"die-in-{die_in}").unlink()
        return done.returncode

    def current(self) -> str:
        """The version that would start now, with all that belongs to it."""
        release = (self.releases.parent / "current").resolve()
        assert {path.name for path in release.iterdir()} > {"bin", "pip", "slipstream"}
        return release.name

    def extras(self) -> str:
        """What the current release was installed with."""
        return (self.releases.parent / "current" / "slipstream").read_text().strip()

    def kept(self) -> set[str]:
        """Releases on the disk."""
        return {path.name for path in self.releases.iterdir()}


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """A machine without Slipstream."""
    return Machine(tmp_path)


@pytest.mark.slow
@pytest.mark.attack
@pytest.mark.parametrize("where", ["venv", "pip"])
def test_a_killed_installation_is_mended_by_the_next(machine: Machine, where: str) -> None:
    """Killed while it makes the first environment, or a newer one: run again, it is there."""
    assert machine.install("1.0", die_in=where) == -signal.SIGKILL
    assert machine.install("1.0") == 0
    assert machine.current() == "1.0"
    assert machine.install("1.1", die_in=where) == -signal.SIGKILL
    assert machine.current() == "1.0"
    assert machine.install("1.1") == 0
    assert machine.current() == "1.1"
    assert machine.install("1.1", die_in="pip") == -signal.SIGKILL
    assert machine.install("1.1") == 0
    assert machine.current() == "1.1"


@pytest.mark.slow
def test_extras_that_were_named_once_come_with_each_upgrade(machine: Machine) -> None:
    """Until others are named, or none; a name that there is not changes nothing."""
    assert machine.install("1.0") == 0
    assert machine.extras() == "[edge]"
    assert machine.install("1.0", None, "--extras", "postgres,tracing") == 0
    assert machine.extras() == "[edge,postgres,tracing]"
    assert machine.install("1.1") == 0
    assert (machine.current(), machine.extras()) == ("1.1", "[edge,postgres,tracing]")
    assert machine.install("1.2", None, "--extras", "postgre") == 2
    assert machine.current() == "1.1"
    assert machine.install("1.2", None, "--extras", "") == 0
    assert machine.install("1.3") == 0
    assert machine.extras() == "[edge]"


@pytest.mark.slow
def test_the_release_before_stays_and_older_ones_go(machine: Machine) -> None:
    """Two are kept: after each upgrade, the same version again, and a way back by hand."""
    for version in ("1.0", "1.1", "1.2"):
        assert machine.install(version) == 0
    assert machine.kept() == {"1.1", "1.2"}
    assert machine.install("1.2") == 0
    assert machine.kept() == {"1.1", "1.2"}
    current = machine.releases.parent / "current"
    current.unlink()
    current.symlink_to(machine.releases / "1.1")
    assert machine.install("1.3") == 0
    assert machine.kept() == {"1.1", "1.3"}
    assert machine.current() == "1.3"


@pytest.mark.slow
def test_a_second_run_changes_nothing(tmp_path: Path) -> None:
    """What is installed is the same again, and settings that were edited stay so."""
    assert install("--root", tmp_path, "all").returncode == 0
    edited = tmp_path / "etc" / "slipstream" / "site.toml"
    edited.write_text(edited.read_text().replace("keep_days = 90.0", "keep_days = 7.0"))
    before = tree(tmp_path)
    assert install("--root", tmp_path, "all").returncode == 0
    assert tree(tmp_path) == before


def test_a_dry_run_tells_and_does_nothing(tmp_path: Path) -> None:
    """Each step is printed, none is taken."""
    done = install("--dry-run", "--root", tmp_path / "none", "all")
    assert done.returncode == 0
    assert done.stdout.count("\n+ ") > 10
    assert not (tmp_path / "none").exists()
    live = install("--dry-run", "--no-venv", "server")
    assert "+ systemd-sysusers" in live.stdout


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((), "edge, agent, server, worker or all"),
        (("spaceship",), "spaceship"),
        (("--root",), "--root"),
    ],
)
def test_a_slip_of_the_tongue_is_one_line(arguments: tuple[str, ...], named: str) -> None:
    """Bad arguments: exit status 2 and what is wrong."""
    done = install(*arguments)
    assert done.returncode == 2
    assert named in done.stderr
    assert done.stderr.count("\n") == 1
