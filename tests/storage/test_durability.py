"""What was reported as recorded is there after SIGKILL at any moment."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

import storage

WRITER = """
import sys
import storage
from slipstream.messages import CycleReport

database = storage.open_database(sys.argv[1])
while True:
    number = database.next_cycle_number()
    report = CycleReport(
        cycle=number, started_ns=number, wall_s=0.0, status="baseline", reason="x" * 2000,
        solver=None, objective_kwh=None, variables=0, solvers=(), gates=(), energy=None, plans=0,
    )
    database.record_cycle(report, [], [])
    print(number, flush=True)
"""


@pytest.mark.process
@pytest.mark.long
def test_killed_writer_loses_nothing(url):
    """Eight writers killed at random moments: every number they printed is stored, intact."""
    moments = random.Random(5)
    acknowledged: list[int] = []
    for killed in range(1, 9):
        awaited = moments.randint(1, 15)
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER, url],
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        assert process.stdout is not None
        first = [process.stdout.readline() for _ in range(awaited)]
        # So that not all kills hit a writer that has just printed.
        time.sleep(moments.uniform(0.0, 0.02))
        process.kill()
        # A last line that the kill cut in two has no newline and acknowledges nothing.
        rest = [line for line in process.stdout if line.endswith("\n")]
        process.wait()
        process.stdout.close()
        acknowledged += [int(line) for line in [*first, *rest]]
        with storage.open_reader(url) as reader:
            stored = [cycle.cycle for cycle in reader.cycles(limit=1_000_000)]
        assert set(acknowledged) <= set(stored)
        # At most the cycle that was being acknowledged is stored beyond that.
        assert stored == list(range(1, len(stored) + 1))
        assert len(stored) <= len(set(acknowledged)) + killed
        report = storage.check(url)
        assert report.ok, report.faults
