"""The installer, as far as it goes without root."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from .conftest import DEPLOY

SCRIPT = DEPLOY / "install.sh"
RELEASE = DEPLOY / "release.sh"


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
    """The scripts are clean."""
    done = subprocess.run([tool("shellcheck"), SCRIPT, RELEASE], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.long
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
release=$(dirname "$(dirname "$0")")
case "$*" in
    -V) echo Python 3.11.2 ;;
    *sys.base_prefix*) echo /usr ;;
    *version_info*) [ ! -e "{folder}/old-python" ] ;;
    */database.py*)
        [ "${{release##*/}}" != "$(cat "{folder}/too-old")" ] || {{ echo schema 0099; exit 2; }}
        ;;
    "-m venv "*)
        mkdir -p "$3/bin"
        cp "$0" "$3/bin/python"
        case $3 in */releases/*) [ ! -e "{folder}/die-in-venv" ] || kill -9 $PPID ;; esac
        ;;
    "-m pip wheel "*)
        wheel=$6/slipstream-$(cat "{folder}/version")-py3-none-any.whl
        cp "{folder}/source/slipstream/__init__.py" "$wheel"
        ;;
    "-m pip install --only-binary :all: --require-hashes "*)
        [ ! -e "{folder}/die-in-pip" ] || kill -9 $PPID
        [ ! -e "{folder}/pip-says" ] || {{ cat "{folder}/pip-says" >&2; exit 1; }}
        for lock; do case $lock in *.txt) basename "$lock" .txt ;; esac; done >"$release/locks"
        ;;
    "-m pip install --no-deps "*)
        for wheel; do case $wheel in *.whl) cp "$wheel" "$release/program" ;; esac; done
        program=$release/bin/slipstream
        printf '#!/bin/sh\\ncat %s %s\\n' "$release/locks" "$release/program" >"$program"
        chmod 755 "$program"
        ;;
esac
"""


class Machine:
    """Installs environments below a folder, with a stand-in for Python."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.root = folder / "root"
        self.releases = self.root / "opt" / "slipstream" / "releases"
        self.source = folder / "source"
        shutil.copytree(DEPLOY, self.source / "deploy")
        for part in (
            "docs/operations.md",
            "slipstream_cli/daemons/router.py",
            "slipstream_cli/place/bus_files.py",
        ):
            (self.source / part).parent.mkdir(parents=True)
            shutil.copy(DEPLOY.parent / part, self.source / part)
        (self.source / "slipstream").mkdir()
        script = self.source / "deploy" / "install.sh"
        text = script.read_text()
        # An environment below a folder cannot run elsewhere, which does not matter here.
        assert "root=$2 venv=no" in text
        script.write_text(text.replace("root=$2 venv=no", "root=$2"))
        self.python = folder / "python"
        self.python.write_text(_PYTHON.format(folder=folder))
        self.python.chmod(0o755)
        (folder / "too-old").write_text("none")

    def command(self, *arguments: str | Path) -> list[str | Path]:
        """The installer's, for the folder."""
        script = self.source / "deploy" / "install.sh"
        return ["sh", script, "--root", self.root, "--python", self.python, *arguments]

    def call(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        """Run the installer below the folder."""
        return subprocess.run(self.command(*arguments), capture_output=True, text=True, timeout=300)

    def version(self, version: str) -> None:
        """What the checkout is."""
        (self.source / "slipstream" / "__init__.py").write_text(f'__version__ = "{version}"\n')
        (self.folder / "version").write_text(version)

    def install(self, version: str, die_in: str | None = None, *more: str) -> int:
        """Install a version, with more arguments; returns the exit status."""
        self.version(version)
        if die_in is not None:
            (self.folder / f"die-in-{die_in}").touch()
        done = self.call(*more, "edge")
        if die_in is not None:
            (self.folder / f"die-in-{die_in}").unlink()
        return done.returncode

    def current(self) -> str:
        """The version that would start now."""
        release = (self.releases.parent / "current").resolve()
        assert f'"{release.name.removesuffix("-again")}"' in self.start()
        return release.name

    def start(self) -> str:
        """What the current program says: its locks and its version."""
        program = self.releases.parent / "current" / "bin" / "slipstream"
        return subprocess.run([program], capture_output=True, text=True, check=True).stdout

    def locks(self) -> set[str]:
        """What the current release was installed from."""
        return set(self.start().splitlines()[:-1])

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
    assert machine.install("1.1", "pip", "--extras", "osm") == -signal.SIGKILL
    assert (machine.current(), machine.locks()) == ("1.1", {"edge"})
    assert machine.install("1.1") == 0
    assert machine.current() == "1.1"


@pytest.mark.long
@pytest.mark.slow
def test_extras_that_were_named_once_come_with_each_upgrade(machine: Machine) -> None:
    """Until others are named, or none; a name that there is not changes nothing."""
    assert machine.install("1.0") == 0
    assert machine.locks() == {"edge"}
    assert machine.install("1.0", None, "--extras", "postgres,tracing") == 0
    assert machine.current() == "1.0-again"  # not into the one that runs
    assert machine.locks() == {"edge", "postgres", "tracing"}
    assert machine.install("1.1") == 0
    assert (machine.current(), machine.locks()) == ("1.1", {"edge", "postgres", "tracing"})
    assert machine.install("1.2", None, "--extras", "postgre") == 2
    assert machine.current() == "1.1"
    assert machine.install("1.2", None, "--extras", "") == 0
    assert machine.install("1.3") == 0
    assert machine.locks() == {"edge"}


@pytest.mark.slow
def test_an_installed_release_needs_no_checkout_for_another_role_or_extra(machine: Machine) -> None:
    """Its own installer makes the release anew, of its own program; or finds nothing to do."""
    assert machine.install("1.0") == 0
    own = machine.releases.parent / "current" / "source" / "deploy" / "install.sh"
    shutil.rmtree(machine.source)
    command = ["sh", own, *machine.command()[2:]]
    assert subprocess.run([*command, "edge"], timeout=300).returncode == 0
    assert machine.kept() == {"1.0"}
    for more in (["--extras", "osm", "edge"], ["server"]):
        assert subprocess.run([*command, *more], timeout=300).returncode == 0
    assert machine.locks() == {"edge", "server", "osm"}
    assert machine.current() == "1.0"


@pytest.mark.long
@pytest.mark.slow
def test_the_release_before_stays_and_older_ones_go(machine: Machine) -> None:
    """Two are kept: after each upgrade, the same version again, and a way back by hand."""
    for version in ("1.0", "1.1", "1.2"):
        assert machine.install(version) == 0
    assert machine.kept() == {"1.1", "1.2"}
    assert machine.install("1.2") == 0
    assert machine.kept() == {"1.1", "1.2"}
    assert machine.call("use", "1.1").returncode == 0
    assert machine.current() == "1.1"
    assert machine.install("1.3") == 0
    assert machine.kept() == {"1.1", "1.3"}
    assert machine.current() == "1.3"


@pytest.mark.long
@pytest.mark.process
@pytest.mark.attack
def test_power_cuts_leave_a_release_that_starts(
    machine: Machine, figure: Callable[[str], None]
) -> None:
    """All processes of an upgrade killed at any moment: what is current is complete and starts,
    units are old or new; run again, the upgrade is there.
    """
    cuts, random = int(os.environ.get("POWER_CUTS", "20")), Random(38)
    unit = machine.source / "deploy" / "systemd" / "slipstream-edge@.service"
    installed = machine.root / "etc" / "systemd" / "system" / unit.name
    shipped = unit.read_text()
    begun = time.monotonic()
    assert machine.install("1.0") == 0
    took, unfinished = time.monotonic() - begun, 0
    for number in range(1, cuts + 1):
        before, after = f"1.{number - 1}", f"1.{number}"
        unit.write_text(f"{shipped}# {after}\n")
        machine.version(after)
        upgrade = subprocess.Popen(
            machine.command("edge"),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        time.sleep(random.uniform(0, took))
        os.killpg(upgrade.pid, signal.SIGKILL)
        upgrade.wait()
        current = machine.current()
        assert current in (before, after)
        unfinished += current == before
        units = {shipped, f"{shipped}# {before}\n", f"{shipped}# {after}\n"}
        assert installed.read_text() in units
        begun = time.monotonic()
        assert machine.install(after) == 0
        took = time.monotonic() - begun
        assert machine.current() == after
        assert installed.read_text() == f"{shipped}# {after}\n"
        # One that a cut kept from being removed goes with the next upgrade.
        assert len(machine.kept()) <= 3
    assert unfinished > 0
    figure(f"{cuts} power cuts during an upgrade, {unfinished} before the switch: each starts")


@pytest.mark.slow
def test_way_back_is_one_command_and_brings_its_units(machine: Machine) -> None:
    """Release and units of before; forth again; a version that is not there changes nothing."""
    unit = machine.source / "deploy" / "systemd" / "slipstream-edge@.service"
    installed = machine.root / "etc" / "systemd" / "system" / unit.name
    shipped = unit.read_text()
    assert machine.install("1.0") == 0
    unit.write_text(shipped + "# newer\n")
    assert machine.install("1.1") == 0
    assert machine.call("use", "1.0").returncode == 0
    assert (machine.current(), installed.read_text()) == ("1.0", shipped)
    assert machine.call("use", "1.1").returncode == 0
    assert (machine.current(), installed.read_text()) == ("1.1", shipped + "# newer\n")
    refused(machine.call("use", "0.9"), "use 0.9: no such release; installed: 1.0 1.1")
    assert machine.current() == "1.1"


def refused(done: subprocess.CompletedProcess[str], named: str) -> None:
    """Exit status 2 and one line."""
    assert done.returncode == 2, done.stderr
    assert named in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_an_older_release_than_the_database_is_refused(machine: Machine) -> None:
    """By the way back and by an installation; what runs stays current."""
    assert machine.install("1.0") == 0
    assert machine.install("1.1") == 0
    (machine.folder / "too-old").write_text("1.0")
    refused(machine.call("use", "1.0"), "release 1.0: schema 0099")
    (machine.folder / "too-old").write_text("0.9")
    assert machine.install("0.9") == 2
    assert machine.current() == "1.1"


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.process
def test_a_database_of_a_newer_schema_is_seen(tmp_path: Path) -> None:
    """By the release's own program; a database of its own schema, or none, is no reason."""
    import sqlite3

    from storage import open_database

    site = tmp_path / "site.toml"
    site.write_text(f'database_url = "sqlite:///{tmp_path}/slipstream.db"\n')
    look = [sys.executable, DEPLOY / "database.py", site]
    assert subprocess.run(look, timeout=600).returncode == 0
    open_database(f"sqlite:///{tmp_path}/slipstream.db").close()
    assert subprocess.run(look, timeout=600).returncode == 0
    with sqlite3.connect(tmp_path / "slipstream.db") as database:
        database.execute("UPDATE alembic_version SET version_num = '9999'")
    done = subprocess.run(look, capture_output=True, text=True, timeout=600)
    refused(done, "was written by a newer Slipstream (schema 9999")


@pytest.mark.slow
def test_what_cannot_be_installed_leaves_what_runs(machine: Machine) -> None:
    """A Python or a lock that does not fit, a wheelhouse with a wheel missing or altered."""
    assert machine.install("1.0") == 0
    machine.version("1.1")
    (machine.folder / "old-python").touch()
    refused(machine.call("edge"), "not Python 3.11 to 3.13")
    (machine.folder / "old-python").unlink()
    refused(machine.call("--python", "/none", "edge"), "/none: not found")
    says = machine.folder / "pip-says"
    says.write_text("ERROR: Could not find it\nERROR: No matching distribution for numpy==9\n")
    refused(machine.call("edge"), "No matching distribution for numpy==9")
    refused(machine.call("server"), "Python packages for edge server: ERROR: Could not find it")
    says.unlink()
    assert (machine.current(), machine.kept()) == ("1.0", {"1.0"})

    wheels = machine.folder / "slipstream-1.1-edge" / "wheels"
    wheels.mkdir(parents=True)
    refused(machine.call("--wheelhouse", wheels, "edge"), "no SHA256SUMS or no slipstream-1.1")
    program = wheels / "slipstream-1.1-py3-none-any.whl"
    program.write_text('__version__ = "1.1"\n')
    library = wheels / "numpy-2.4-py3-none-any.whl"
    library.write_text("numpy")
    sums = subprocess.run(
        ["sha256sum", program.name, library.name], cwd=wheels, capture_output=True, check=True
    )
    (wheels / "SHA256SUMS").write_bytes(sums.stdout)
    tarball = machine.folder / "wheelhouse.tar"
    subprocess.run(["tar", "-cf", tarball, "-C", machine.folder, wheels.parent.name], check=True)
    library.write_text("altered")
    refused(machine.call("--wheelhouse", wheels, "edge"), f"missing or altered: {library.name}")
    altered = machine.folder / "altered.tar"
    subprocess.run(["tar", "-cf", altered, "-C", machine.folder, wheels.parent.name], check=True)
    named = f"--wheelhouse {altered}: missing or altered: {library.name}"
    refused(machine.call("--wheelhouse", altered, "edge"), named)
    library.unlink()
    refused(machine.call("--wheelhouse", wheels, "edge"), f"missing or altered: {library.name}")
    refused(machine.call("--wheelhouse", program, "edge"), "no tarball that can be read")
    assert (machine.current(), machine.kept()) == ("1.0", {"1.0"})
    assert machine.call("--wheelhouse", tarball, "edge").returncode == 0
    assert machine.current() == "1.1"


@pytest.mark.slow
def test_a_release_that_cannot_be_signed_is_not_begun(
    tmp_path: Path, tool: Callable[[str], str]
) -> None:
    """A key that gpg does not have: what was released before is still there."""
    tool("gpg")
    (tmp_path / "home").mkdir(mode=0o700)
    (tmp_path / "dist").mkdir()
    done = subprocess.run(
        [tool("make"), "-C", tmp_path, "-f", DEPLOY.parent / "Makefile", "release", "KEY=nobody"],
        env={**os.environ, "GNUPGHOME": str(tmp_path / "home")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "No secret key" in done.stderr
    assert (tmp_path / "dist").exists()


@pytest.mark.slow
def test_removal_keeps_settings_and_data_unless_told(machine: Machine) -> None:
    """Units, drop-ins of the installer and releases go; the rest with `--data` only."""
    assert machine.install("1.0") == 0
    data = machine.root / "var" / "lib" / "slipstream" / "slipstream.db"
    data.parent.mkdir(parents=True)
    data.touch()
    system = machine.root / "etc" / "systemd" / "system"
    wants = system / "multi-user.target.wants"
    wants.mkdir()
    (wants / "slipstream-edge@rsu-1.service").symlink_to(system / "slipstream-edge@.service")
    (system / "slipstream-of-another.service").touch()
    settings = machine.root / "etc" / "slipstream"
    before = tree(settings)
    assert machine.call("remove").returncode == 0
    assert not (machine.root / "opt" / "slipstream").exists()
    left = {path.name for path in system.rglob("*") if not path.is_dir()}
    assert left == {"slipstream-of-another.service"}
    assert (tree(settings), data.exists()) == (before, True)
    assert machine.call("remove", "--data").returncode == 0
    assert not settings.exists()
    assert not data.parent.exists()


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
