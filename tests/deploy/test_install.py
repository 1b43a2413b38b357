"""The installer, as far as it goes without root."""

from __future__ import annotations

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


def test_shellcheck_has_nothing_to_say(tool: Callable[[str], str]) -> None:
    """The script is clean."""
    done = subprocess.run([tool("shellcheck"), str(SCRIPT)], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")


def test_each_role_gets_what_it_runs(tmp_path: Path) -> None:
    """Units, settings and nothing of the other role; settings are not for everybody's eyes."""
    assert install("--root", tmp_path / "box", "edge").returncode == 0
    assert install("--root", tmp_path / "server", "server").returncode == 0
    units = "etc/systemd/system/slipstream-"
    box, server = tree(tmp_path / "box"), tree(tmp_path / "server")
    assert f"{units}edge@.service" in box
    assert f"{units}dispatcher.service" not in box
    assert {f"{units}dispatcher.service", f"{units}dashboard.service"} < server.keys()
    assert f"{units}edge@.service" not in server
    for files in (box, server):
        assert f"{units}router.service" in files
        assert files["etc/slipstream/router.json5"][1] == 0o640
        assert "opt/slipstream/share/doc/operations.md" in files
        # What the router's unit runs is there.
        assert "opt/slipstream/share/router.py" in files


def test_a_second_run_changes_nothing(tmp_path: Path) -> None:
    """What is installed is the same again, and settings that were edited stay so."""
    assert install("--root", tmp_path, "all").returncode == 0
    edited = tmp_path / "etc" / "slipstream" / "dispatcher.toml"
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
    [((), "edge, server or all"), (("spaceship",), "spaceship"), (("--root",), "--root")],
)
def test_a_slip_of_the_tongue_is_one_line(arguments: tuple[str, ...], named: str) -> None:
    """Bad arguments: exit status 2 and what is wrong."""
    done = install(*arguments)
    assert done.returncode == 2
    assert named in done.stderr
    assert done.stderr.count("\n") == 1
