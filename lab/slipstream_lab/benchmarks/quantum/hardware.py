"""`python -m slipstream_lab.benchmarks.quantum.hardware`: dispatch cycles beside a device that fails in every way.

Real cycles, workers, database and job manager; the device's service is simulated and times out,
refuses, loses jobs, answers garbage, late or never, hangs and takes the worker down with it. Every
few cycles job manager and database are closed, whatever they are at, and opened again; the device's
worker is killed now and then, and so is the whole process, which goes on with the same database. A
cycle is on time if its plan is verified and stored before its deadline. Exit status 1 if any
promise is broken.
"""

from __future__ import annotations

import argparse
import json
import logging
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import psutil

from slipstream_lab.benchmarks.quantum.faulty_service import ServiceRecords
from slipstream_lab.benchmarks.quantum.hardware_checks import Run, check_run
from slipstream_lab.benchmarks.quantum.hardware_cycles import SETTINGS, empty_run, run

STRETCH: Final = (30, 90)
"""Cycles until the whole process is killed, at least and at most."""
START_S: Final = 120.0
"""Time for a new process to run its first cycle; and for each further one."""


def run_killed(
    cycles: int, seed: int, folder: Path, progress: Callable[[str], None] = lambda _: None
) -> Run:
    """`run` in processes that are killed and started again on the same database.

    Args:
        folder: for database, service, and what each process writes down.
        progress: called with a line after each kill.
    """
    rng = random.Random(seed)
    result = empty_run(SETTINGS)
    for number in range(cycles):
        missing = cycles - result.cycles
        stretch = rng.randint(*STRETCH)
        last = missing <= STRETCH[1]
        notes = folder / f"stretch-{number}.jsonl"
        ran = _stretch(missing if last else stretch, seed, folder, notes, rng, kill=not last)
        for note in read_notes(notes):
            if "cycle" in note:
                result.add(note)
            else:
                result.growth, result.leaks = note["growth"], note["leaks"]
                result.broken += note["broken"]
        result.broken += ran
        if last:
            break
        result.kills["dispatcher"] += 1
        progress(f"{result.cycles} cycles, {dict(result.answered)}, broken: {result.broken[-3:]}")
    check_run(ServiceRecords(folder / "service.db", seed), f"sqlite:///{folder}/cycles.db", result)
    return result


def _stretch(
    cycles: int, seed: int, folder: Path, notes: Path, rng: random.Random, *, kill: bool
) -> list[str]:
    """Run one process, to its end or until it has written down so many cycles; what is wrong."""
    command = [
        sys.executable,
        "-m",
        "slipstream_lab.benchmarks.quantum.hardware",
        "--notes",
        str(notes),
    ]
    # One that is to be killed shall not come to its end before.
    command += ["--cycles", str(10 * cycles if kill else cycles)]
    process = subprocess.Popen([*command, "--seed", str(seed), "--folder", str(folder)])
    written, until = 0, time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < until:
        time.sleep(0.1)
        now_written = notes.read_bytes().count(b"\n") if notes.exists() else 0
        if now_written > written:
            written, until = now_written, time.monotonic() + START_S
        if kill and written >= cycles:
            break
    else:
        if process.poll() is None:
            process.kill()
            process.wait()
            return [f"no cycle ended in {START_S:g} s"]
        # Status 1: a promise is broken, which its notes progress.
        wrong = kill or process.returncode not in (0, 1)
        return [f"a process ended with status {process.returncode}"] if wrong else []
    time.sleep(rng.uniform(0.0, SETTINGS.deadline_s))
    workers = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    _, alive = psutil.wait_procs(workers, timeout=10.0)
    for worker in alive:
        worker.kill()
    return [f"{len(alive)} workers outlived the process"] if alive else []


def read_notes(path: Path) -> Iterator[dict[str, Any]]:
    """What a process wrote down, without a last line that was cut short."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    for line in text.splitlines(keepends=True):
        if line.endswith("\n"):
            yield json.loads(line)


def _in_a_stretch(cycles: int, seed: int, folder: Path, notes: Path) -> int:
    """Run cycles and write each down when it is over, and what was found in the end."""
    with notes.open("w", encoding="utf-8") as file:

        def write(entry: Mapping[str, Any]) -> None:
            file.write(json.dumps(entry) + "\n")
            file.flush()

        written_faults: list[str] = []

        def write_cycle(entry: Mapping[str, Any]) -> None:
            written_faults.extend(entry["broken"])
            write(entry)

        result = run(cycles, seed, folder, write=write_cycle, checked=False)
        broken = result.broken[len(written_faults) :]
        write({"growth": result.growth, "leaks": result.leaks, "broken": broken})
    return 1 if result.broken else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it and print the figures as JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.hardware", description=__doc__
    )
    parser.add_argument("--cycles", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="kept afterwards (default: a temporary one)")
    parser.add_argument("--notes", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    logging.disable(logging.CRITICAL)
    if options.notes is not None:
        return _in_a_stretch(options.cycles, options.seed, options.folder, options.notes)
    with ExitStack() as stack:
        folder = options.folder
        if folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        began = time.monotonic()
        result = run_killed(
            options.cycles,
            options.seed,
            folder,
            lambda line: print(line, file=sys.stderr, flush=True),
        )
        report = result.report() | {"took_s": round(time.monotonic() - began, 1)}
    print(json.dumps(report, indent=1))
    return 1 if result.broken else 0


if __name__ == "__main__":
    sys.exit(main())
