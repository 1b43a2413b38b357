from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from .refused_calls import UNAVAILABLE

WORKERS = """
import json, math, os, time

from dispatcher_daemon.service.api.solving import SolveJobs
from dispatcher_daemon.service.api.solving.vroom import VroomTask
from dispatcher_daemon.fleet.learning import Learned
from dispatcher_daemon.solvers.quantum.hardware.service import ServiceWorker
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import PoolJob, SolverPool
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import arc_form_of

REQUEST = {
    "vehicles": [{"id": 1, "start_index": 0}],
    "jobs": [{"id": 1, "location_index": 1}],
    "matrix": [[0, 7], [7, 0]],
}

def main():
    found = {}
    problem = arc_form_of(open_instance("arc14-avenue")).problem
    with SolverPool([ExactSolver()]) as pool:
        found["warm"] = pool.warm_up(300)
        (outcome,) = pool([PoolJob("exact", problem, 1)], 120)
        found["exact"] = outcome.status
    with WorkerExecutor(1) as workers:
        found["search"] = workers.submit(math.hypot, 3, 4).result(300)
    worker = ServiceWorker()
    found["device"] = worker.call(math.hypot, (3, 4), 300)
    worker.close()
    jobs = SolveJobs()
    settings, answer_by_ns = DispatcherSettings(), time.time_ns() + 300 * 10**9
    learned = Learned({}, {}, None)
    task = VroomTask(
        settings, "", (), learned, 0, 1, REQUEST, 1.0, answer_by_ns, False, False
    )
    job = jobs.submit(300.0, lambda: task)
    jobs.wait(job, 300)
    found["caller"] = job.reason or json.loads(job.result)["summary"]["cost"]
    jobs.close()
    print(json.dumps(found))

if __name__ == "__main__":
    main()
"""


@pytest.mark.process
@pytest.mark.long
def test_workers_answer_where_the_service_may_not_set_priorities(tmp_path: Path) -> None:
    """Under the shipped units' filter the exact solver, the search, the device's worker and that of
    callers' jobs work as elsewhere.
    """
    script = tmp_path / "workers.py"
    script.write_text(textwrap.dedent(WORKERS))
    filtered = Path(__file__).with_name("refused_calls.py")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])}
    done = subprocess.run(
        [sys.executable, filtered, sys.executable, script],
        capture_output=True,
        text=True,
        env=environment,
    )
    if done.returncode == UNAVAILABLE:
        pytest.skip("system calls cannot be filtered here")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {
        "warm": {},
        "exact": "optimal",
        "search": 5.0,
        "device": 5.0,
        "caller": 7,
    }
