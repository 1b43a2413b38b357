"""Runs commands of `slipstream` within limits of time and memory.

A job is a line of JSON on standard input, its outcome one on standard output. The processes are
forked from this one, which has imported everything, and run some commands each: so thousands of
commands are a matter of minutes.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from pathlib import Path
from typing import Any, TextIO

import psutil

CPU_S = 10
"""Of its own: a loaded machine is no hang."""
WALL_S = 45.0
JOBS_A_PROCESS = 50
GROWTH_MB = 1000.0
_POLL_S = 0.05
_PRELOADED = (
    "alembic.command",
    "cv2",
    "dashboard.settings",
    "dispatcher_daemon.fleet.file",
    "dispatcher_daemon.forms",
    "dispatcher_daemon.planning",
    "dispatcher_daemon.settings",
    "edge_daemon.calibration.files",
    "edge_daemon.calibration.overlay",
    "edge_daemon.detection.openvino",
    "edge_daemon.offline",
    "openvino",
    "slipstream_lab.research.instances.forms",
    "slipstream_lab.research.perception",
    "slipstream_lab.research.perception.noise",
    "slipstream_lab.simulation.closed_loop.policy",
    "slipstream_lab.simulation.evaluation.measures",
    "slipstream_lab.simulation.evaluation.report",
    "slipstream_lab.simulation.evaluation.runs",
    "slipstream_lab.simulation.ground_truth",
    "slipstream_lab.commands.solve.quantum",
    "sqlalchemy.orm",
    "storage",
    "sumolib.net",
)


def main() -> None:
    """Answer jobs until standard input ends."""
    # Before any of the others: it tells OpenCV its limits.
    import slipstream_cli.main

    slipstream_cli.main.parser()
    for module in _PRELOADED:
        importlib.import_module(module)
    gc.collect()
    gc.freeze()
    answers = os.fdopen(os.dup(1), "w")
    worker: Worker | None = None
    for line in sys.stdin:
        worker = worker or Worker()
        outcome = worker.run(line)
        if outcome["ended"] is not None or worker.jobs >= JOBS_A_PROCESS:
            worker.stop()
            worker = None
        answers.write(json.dumps(outcome) + "\n")
        answers.flush()
    if worker is not None:
        worker.stop()


class Worker:
    """A process that runs commands, one after the other."""

    def __init__(self) -> None:
        self.jobs = 0
        jobs, self._jobs = os.pipe()
        self._answers, answers = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self._jobs)
            os.close(self._answers)
            _serve(os.fdopen(jobs), os.fdopen(answers, "w"))
        os.close(jobs)
        os.close(answers)

    def run(self, line: str) -> dict[str, Any]:
        """Run one command.

        Args:
            line: JSON of its arguments, and of the folder to run it in.

        Returns:
            Exit status; why it was ended, if it was; processor time; growth of memory; its output.
        """
        self.jobs += 1
        folder = Path(json.loads(line)["folder"])
        process = psutil.Process(self._pid)
        before_mb = process.memory_info().rss / 1e6
        began = time.monotonic()
        os.write(self._jobs, line.encode())
        outcome: dict[str, Any] = {"status": -1, "cpu_s": 0.0, "growth_mb": 0.0, "ended": None}
        while not select.select([self._answers], [], [], _POLL_S)[0]:
            if process.memory_info().rss / 1e6 - before_mb > GROWTH_MB:
                outcome["ended"] = "grew too large"
            elif time.monotonic() - began > WALL_S:
                outcome["ended"] = "hung"
            if outcome["ended"] is not None:
                break
        else:
            answer = os.read(self._answers, 4096)
            if answer:
                outcome |= json.loads(answer)
            else:
                outcome["ended"] = f"its process ended with status {self.stop()}"
        for name in ("stdout", "stderr"):
            said = folder / name
            outcome[name] = said.read_text(errors="replace") if said.exists() else ""
        return outcome

    def stop(self) -> int:
        """End the process and all that it has started; its exit status."""
        if self._pid:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._pid, signal.SIGKILL)
            self._status = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
            self._pid = 0
            os.close(self._jobs)
            os.close(self._answers)
        return self._status


def _serve(jobs: TextIO, answers: TextIO) -> None:
    """Run commands to the end of this process."""
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.stdout = os.fdopen(1, "w", closefd=False)
        sys.stderr = os.fdopen(2, "w", closefd=False, errors="backslashreplace")
        for line in iter(jobs.readline, ""):
            job = json.loads(line)
            os.chdir(job["folder"])
            for number, name in ((0, os.devnull), (1, "stdout"), (2, "stderr")):
                flags = os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC
                file = os.open(name, flags, 0o600)
                os.dup2(file, number)
                os.close(file)
            answers.write(json.dumps(_measured(job["arguments"])) + "\n")
            answers.flush()
    finally:
        os._exit(70)


def _measured(arguments: list[str]) -> dict[str, float]:
    before, rss_mb = (
        resource.getrusage(resource.RUSAGE_SELF),
        psutil.Process().memory_info().rss / 1e6,
    )
    before_s = before.ru_utime + before.ru_stime
    resource.setrlimit(resource.RLIMIT_CPU, (int(before_s) + CPU_S + 1, resource.RLIM_INFINITY))
    code = _run(arguments)
    sys.stdout.flush()
    sys.stderr.flush()
    after = resource.getrusage(resource.RUSAGE_SELF)
    # The largest so far: what stays below it has grown less.
    grown = after.ru_maxrss > before.ru_maxrss
    return {
        "status": code,
        "cpu_s": after.ru_utime + after.ru_stime - before_s,
        "growth_mb": after.ru_maxrss * 1024 / 1e6 - rss_mb if grown else 0.0,
    }


def _run(arguments: list[str]) -> int:
    from slipstream_cli.main import main as slipstream

    try:
        return slipstream(arguments)
    except SystemExit as error:
        return int(error.code or 0)
    except BaseException:
        traceback.print_exc()
        return 1


if __name__ == "__main__":
    main()
