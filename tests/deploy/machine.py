"""A clean Debian 12 machine in a container, booted by systemd, with no network but its loopback."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, TypeVar

from .conftest import ROOT

CACHE: Final = ROOT / "build" / "deploy"
DEBIAN: Final = ("systemd-sysv", "python3-venv")
"""What docs/operations.md asks for, on the smallest Debian."""
DEADLINE_S: Final = 120.0
_NEWNET: Final = 0x40000000

T = TypeVar("T")


class Unavailable(Exception):
    """This machine can boot no container, or the checkout has no history."""


def wait_for(what: str, ask: Callable[[], T | None], seconds: float = DEADLINE_S) -> T:
    """The first answer that is not None; an AssertionError after the deadline."""
    end = time.monotonic() + seconds
    while (answer := ask()) is None:
        assert time.monotonic() < end, f"{what}: not within {seconds:g} s"
        time.sleep(0.5)
    return answer


def debian(mmdebstrap: str) -> Path:
    """The files of a clean Debian 12, made once."""
    folder = CACHE / "debian-12"
    if not folder.exists():
        unfinished = folder.with_suffix(".part")
        shutil.rmtree(unfinished, ignore_errors=True)
        CACHE.mkdir(parents=True, exist_ok=True)
        command = [mmdebstrap, "--variant=minbase", f"--include={','.join(DEBIAN)}", "bookworm"]
        done = subprocess.run([*command, unfinished], capture_output=True, text=True)
        if done.returncode != 0:
            raise Unavailable(f"mmdebstrap: {done.stderr.strip()[-300:]}")
        unfinished.rename(folder)
    return folder


def wheels() -> Path:
    """What the lock names and what builds the package, for Debian 12's Python; fetched once."""
    lock = ROOT / "deploy" / "locks" / "all.txt"
    project = (ROOT / "pyproject.toml").read_text()
    builder = re.search(r'^requires = \["(hatchling[^"]*)"\]$', project, re.MULTILINE)
    assert builder is not None
    key = hashlib.sha256(lock.read_bytes() + builder[1].encode()).hexdigest()[:12]
    folder = CACHE / f"wheels-{key}"
    if not folder.exists():
        unfinished = folder.with_suffix(".part")
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--dest", str(unfinished)]
        pip += ["--only-binary", ":all:", "--python-version", "3.11"]
        for what in (["--require-hashes", "-r", str(lock)], [builder[1]]):
            subprocess.run([*pip, *what], check=True, stderr=subprocess.DEVNULL)
        unfinished.rename(folder)
    return folder


def git(*words: str) -> bytes:
    """What git says of this checkout."""
    command = ["git", "-c", f"safe.directory={ROOT}", "-C", str(ROOT), *words]
    done = subprocess.run(command, capture_output=True)
    if done.returncode != 0:
        raise Unavailable(f"git: {done.stderr.decode().strip()[-300:]}")
    return done.stdout


def copy_checkout(target: Path) -> None:
    """Copy the checkout as it stands, changes and new files included."""
    listed = git("ls-files", "-z", "--cached", "--others", "--exclude-standard")
    for name in filter(None, listed.decode().split("\0")):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)


def copy_version_before(target: Path) -> str:
    """Copy the last commit of the version before; returns that version."""
    change = ("-1", "--format=%H", "-G^__version__", "--", "slipstream/__init__.py")
    # In a shallow clone the parent is missing, which git says.
    commit = f"{git('log', *change).decode().strip()}^"
    target.mkdir(parents=True)
    subprocess.run(["tar", "-x", "-C", str(target)], input=git("archive", commit), check=True)
    text = (target / "slipstream" / "__init__.py").read_text()
    found = re.search(r'^__version__ = "(.+)"$', text, re.MULTILINE)
    assert found is not None
    return found[1]


def _removed(group: Path) -> bool:
    """Remove a control group with those in it; False: a process of it has not ended yet."""
    try:
        for folder in sorted(group.rglob("*/"), reverse=True):
            folder.rmdir()
        group.rmdir()
    except OSError:
        return not group.exists()
    return True


class Machine:
    """A booted container.

    Args:
        root: its files; they are not removed.
        binds: folders of this machine that it sees, read-only, by their paths in it.

    Attributes:
        pid: of its systemd.

    Raises:
        Unavailable: it does not boot.
    """

    def __init__(self, root: Path, binds: dict[str, Path]) -> None:
        self.root = root
        nspawn = ["systemd-nspawn", "--quiet", "--boot", "--register=no", "--private-network"]
        nspawn += ["--console=passive", f"--directory={root}", "--timezone=off"]
        nspawn += [f"--bind-ro={source}:{path}" for path, source in binds.items()]
        self._groups: list[Path] = []
        if not Path("/run/systemd/system").is_dir():
            # Nobody manages this machine's groups: one of its own, or two containers share theirs.
            nspawn.append("--keep-unit")
            top = Path("/sys/fs/cgroup")
            own = [top / name for name in ("unified", "systemd") if (top / name).is_dir()] or [top]
            self._groups = [folder / f"slipstream-{os.getpid()}" for folder in own]
        for group in self._groups:
            group.mkdir(exist_ok=True)
        join = "".join(f"echo $$ >{group}/cgroup.procs; " for group in self._groups)
        self._log = root.with_name(f"{root.name}.log")
        with self._log.open("w") as log:
            self._nspawn = subprocess.Popen(
                ["/bin/sh", "-c", f'{join}exec "$@"', "sh", *nspawn],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        self._inside = ThreadPoolExecutor(1, "machine", self._enter)
        self.pid = 0
        try:
            self.pid = wait_for("the container's systemd", self._first)
            wait_for("the container's boot", self._booted)
        except BaseException:
            self.stop()
            raise

    def _first(self) -> int | None:
        if self._nspawn.poll() is not None:
            raise Unavailable(f"systemd-nspawn: {self._log.read_text().strip()[-300:]}")
        of_nspawn = f"/proc/{self._nspawn.pid}/task/{self._nspawn.pid}/children"
        children = Path(of_nspawn).read_text().split()
        return int(children[0]) if children else None

    def _booted(self) -> bool | None:
        self._first()
        state = self.run("systemctl", "is-system-running", check=False).stdout.strip()
        assert state != "degraded", self.run("systemctl", "--failed").stdout
        return state == "running" or None

    def _enter(self) -> None:
        """Move the calling thread into the container's network."""
        with open(f"/proc/{self.pid}/ns/net") as network:
            if ctypes.CDLL(None, use_errno=True).setns(network.fileno(), _NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "setns")

    def words(self, *command: str) -> list[str]:
        """A command line that runs a command in it, as root."""
        enter = ["nsenter", f"--target={self.pid}", *["-m", "-u", "-i", "-n", "-p"], "--"]
        given = ["PATH=/usr/sbin:/usr/bin:/sbin:/bin", "HOME=/root", "LANG=C.UTF-8"]
        # Libraries come from the folder of wheels alone.
        given += ["PIP_NO_INDEX=1", "PIP_FIND_LINKS=/srv/wheels"]
        return [*enter, "env", "-i", *given, *command]

    def run(self, *command: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Run a command in it."""
        done = subprocess.run(
            self.words(*command),
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            cwd="/",
        )
        assert not check or done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        return done

    def ask(
        self, url: str, *, method: str = "GET", body: bytes | None = None, token: str = ""
    ) -> tuple[int, bytes]:
        """(status, body) of an HTTP request in its network; status 0: nobody answers."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        if body is not None:
            headers["Content-Type"] = "application/json"
        request = urllib.request.Request(url, data=body, headers=headers, method=method)
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))

        def call() -> tuple[int, bytes]:
            try:
                with opener.open(request, timeout=DEADLINE_S) as answer:
                    return answer.status, answer.read()
            except urllib.error.HTTPError as error:
                return error.code, error.read()
            except OSError as error:
                return 0, str(error).encode()

        return self._inside.submit(call).result()

    def write(self, path: str, text: str) -> None:
        """Write one of its files; one that is there keeps its rights."""
        file = self.root / path.removeprefix("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    def read(self, path: str) -> str:
        """Read one of its files."""
        return (self.root / path.removeprefix("/")).read_text()

    def processes(self, unit: str) -> Sequence[int]:
        """Of a unit, by this machine's numbers."""
        found, own = [], os.readlink(f"/proc/{self.pid}/ns/pid")
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                inside = os.readlink(process / "ns" / "pid") == own
                if inside and f"/{unit}.service" in (process / "cgroup").read_text():
                    found.append(int(process.name))
        return found

    def stop(self) -> None:
        """Take its power away."""
        # As one that loses its power; its first process ends all others.
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid or self._nspawn.pid, signal.SIGKILL)
        self._nspawn.wait(DEADLINE_S)
        self._inside.shutdown()
        for group in self._groups:
            wait_for(f"the end of {group}", lambda group=group: _removed(group) or None)
