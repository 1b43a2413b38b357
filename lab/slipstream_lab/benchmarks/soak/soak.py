"""Starts ``slipstream run``, samples it until its end, judges and reports."""

from __future__ import annotations

import json
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import psutil

from slipstream import __version__
from slipstream.bus import Bus, free_port
from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream.service import die_with_parent
from slipstream.site import names_of
from slipstream_cli.place.site_file import daemons_of
from slipstream_lab.benchmarks.aims import Load
from slipstream_lab.benchmarks.observer import BusObserver
from slipstream_lab.benchmarks.soak import report
from slipstream_lab.benchmarks.soak.processes import ProcessSample, ProcessTree
from slipstream_lab.benchmarks.soak.verdict import SoakVerdict, SoakWindow, judge

_START_LIMIT_S: Final = 600.0
_STOP_LIMIT_S: Final = 20.0
# The run stops a little earlier by its own clock: its last seconds are not evaluated.
_MARGIN_S: Final = 2.0
_LEAK: Final = """
import sys, threading, time

def leak(kept=[]):
    while True:
        kept.append(bytearray({bytes}))
        time.sleep(0.1)

if "dashboard" in sys.orig_argv:
    threading.Thread(target=leak, daemon=True).start()
"""


@dataclass(frozen=True)
class SoakSettings:
    """What to run and where to report.

    Attributes:
        out: folder for the report, the run's log and its state; made if missing.
        clips: folder with the demo's clips; they are rendered into it where they are missing.
        interval_s: between two cycles. What grows with each grows six times as fast as with the
            demo's 30 s; and the 200 cycles that the page keeps are there before it is judged.
        planted_mb_per_h: the page's daemon leaks so much, to see that it is found.
        warm_up_s: not judged; None: the first third, at least a minute, at most half.
    """

    seconds: float
    out: Path = Path(".slipstream/soak")
    clips: Path = Path(".slipstream/clips")
    interval_s: float = 5.0
    period_s: float = 1.0
    warm_up_s: float | None = None
    planted_mb_per_h: float = 0.0


@dataclass
class _Running:
    process: subprocess.Popen[str]
    command: list[str]
    settings: Path
    started: float = field(default_factory=time.time)


def run_soak(
    settings: SoakSettings, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> SoakVerdict:
    """Run, judge and write the report; a KeyboardInterrupt ends the run early. Raises InputError:
    the daemons did not come up, or the output folder cannot be used.
    """
    state = _prepare(settings)
    load = Load()
    samples: list[ProcessSample] = []
    with ExitStack() as stack:
        running = stack.enter_context(_run(settings, state))
        tables = _wait_for_daemons(running, settings)
        port = int(tables["dashboard"]["port"])
        browser = stack.enter_context(browser_on(f"http://127.0.0.1:{port}/", settings.out))
        began = time.monotonic()

        def clock() -> float:
            return time.monotonic() - began

        observer = BusObserver(clock)
        tree = ProcessTree(running.process.pid)
        end_s = settings.seconds - _MARGIN_S
        with Bus.open(BusSettings(connect=_endpoints(tables))) as bus:
            observer.listen(bus)
            try:
                while (now_s := clock()) < end_s and running.process.poll() is None:
                    samples += tree.sample(now_s)
                    on_progress(int(now_s), int(settings.seconds))
                    time.sleep(max(0.0, settings.period_s - (clock() - now_s)))
            except KeyboardInterrupt:
                # The samples so far are reported too.
                end_s = clock()
                running.process.terminate()
        window = SoakWindow.of(end_s, settings.warm_up_s)
        figures = _figures(running)
    verdict = judge(
        samples,
        observer,
        expected={"supervisor", *(name or command for command, name in daemons_of(tables))},
        rsus=names_of(tables, "edge"),
        window=window,
        restarted=int(figures.get("processes_restarted", 0)),
    )
    if end_s < settings.seconds - _MARGIN_S:
        verdict = replace(verdict, faults=(f"interrupted after {end_s:.0f} s", *verdict.faults))
    about = {
        "command": shlex.join(running.command),
        "duration": f"{settings.seconds:g} s, a sample each {settings.period_s:g} s",
        "machine": f"{os.cpu_count()} cores, {psutil.virtual_memory().total / 1e9:.1f} GB, "
        f"{platform.platform()}, Python {platform.python_version()}",
        **load.figures(),
        "page": browser,
        "slipstream": __version__,
        "the run's own figures": json.dumps(figures),
    }
    report.write(settings.out, verdict, samples, about)
    return verdict


def _prepare(settings: SoakSettings) -> Path:
    """The state folder: an empty database, and the clips that other runs have made."""
    state = settings.out / "state"
    try:
        state.mkdir(parents=True, exist_ok=True)
        settings.clips.mkdir(parents=True, exist_ok=True)
        for old in (*state.glob("slipstream.db*"), *state.glob("site.toml")):
            old.unlink()
        link = state / "clips"
        if link.is_symlink():
            link.unlink()
        if not link.exists():
            link.symlink_to(settings.clips.resolve(), target_is_directory=True)
    except OSError as error:
        raise InputError(
            error.filename or settings.out, f"{error.strerror}".lower(), "choose another --out"
        ) from None
    return state


@contextmanager
def browser_on(address: str, folder: Path) -> Iterator[str]:
    """A browser that shows a page; in words, or why there is none."""
    chromium = shutil.which("chromium")
    if chromium is None:
        yield "in no browser: chromium is not installed"
        return
    with TemporaryDirectory() as profile, (folder / "browser.log").open("wb") as log:
        process = subprocess.Popen(
            [
                *(chromium, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"),
                *("--remote-debugging-port=0", f"--user-data-dir={profile}", address),
            ],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
            preexec_fn=partial(die_with_parent, os.getpid()),
        )
        try:
            yield "in a headless browser, which is not judged"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@contextmanager
def _run(settings: SoakSettings, state: Path) -> Iterator[_Running]:
    command = [
        *(sys.executable, "-m", "slipstream_cli", "run", "--state", str(state)),
        *("--port", str(free_port()), "--interval", f"{settings.interval_s:g}"),
        *("--seconds", f"{settings.seconds:g}", "--json"),
    ]
    with (settings.out / "run.log").open("w") as log:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            start_new_session=True,
            env=os.environ | _leaking(settings),
            preexec_fn=partial(die_with_parent, os.getpid()),
        )
        try:
            yield _Running(process, command, state / "site.toml")
        finally:
            if process.poll() is None:
                process.terminate()
            try:
                process.wait(timeout=_STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            assert process.stdout is not None
            process.stdout.close()


def _leaking(settings: SoakSettings) -> dict[str, str]:
    """The environment in which Python plants a leak into the page's daemon as it starts."""
    if not settings.planted_mb_per_h:
        return {}
    folder = (settings.out / "planted").absolute()
    folder.mkdir(exist_ok=True)
    code = _LEAK.format(bytes=round(settings.planted_mb_per_h * 1e6 / 36_000))
    (folder / "sitecustomize.py").write_text(code, encoding="utf-8")
    return {"PYTHONPATH": os.pathsep.join([str(folder), *filter(None, sys.path)])}


def _wait_for_daemons(running: _Running, settings: SoakSettings) -> dict[str, Any]:
    """The tables of the site, once all of its daemons have been started."""
    deadline = time.monotonic() + _START_LIMIT_S
    while time.monotonic() < deadline:
        tables = _tables(running.settings)
        if tables and running.process.poll() is None:
            names = {s.name for s in ProcessTree(running.process.pid).sample(0.0)}
            if names.issuperset(name or command for command, name in daemons_of(tables)):
                return tables
        if running.process.poll() is not None:
            break
        time.sleep(0.05)
    log = (settings.out / "run.log").read_text().strip().splitlines()
    raise InputError(
        settings.out / "run.log",
        f"the daemons did not come up: {log[-1] if log else 'no output'}",
        "see the log",
    )


def _tables(path: Path) -> dict[str, Any]:
    """What the run has written for its daemons; nothing while the file is only half there."""
    try:
        return tomllib.loads(path.read_text())
    except (OSError, tomllib.TOMLDecodeError):
        return {}


def _endpoints(tables: dict[str, Any]) -> tuple[str, ...]:
    return tuple(tables["bus"]["connect"])


def _figures(running: _Running) -> dict[str, Any]:
    """The JSON object that the run prints at its end; empty if it ended otherwise."""
    try:
        output, _ = running.process.communicate(timeout=_STOP_LIMIT_S)
        figures = json.loads(output)
    except (subprocess.TimeoutExpired, ValueError):
        return {}
    return figures if isinstance(figures, dict) else {}
