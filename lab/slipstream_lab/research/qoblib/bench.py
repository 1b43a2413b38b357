"""All runs of the referee over a folder of instances, stored as they come."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import TimeoutError
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from pydantic import Field

from dispatcher_daemon.settings import LcQaoaSettings
from dispatcher_daemon.solvers.workers import GRACE_S, WorkerExecutor, error_line
from slipstream.config import Settings
from slipstream.errors import InputError
from slipstream_lab.research.instances.matrices import read_published
from slipstream_lab.research.qoblib.cover import count_routes
from slipstream_lab.research.qoblib.solvers import (
    SOLVERS,
    TIMED_BY_CIRCUIT,
    Record,
    SolverName,
    Task,
    run_task,
    warm_up,
)
from slipstream_lab.research.quantum.store import Store

_VERSION: Final = 1
"""Of what is stored; a higher one measures all anew. Raise it when a change to the code would give
other answers with the same settings and seed."""
_WARM_UP_S: Final = 120.0


class QoblibSettings(Settings):
    """What is run."""

    instances: int | None = Field(
        default=None, ge=1, description="Those with the fewest routes to choose from; all."
    )
    seeds: int = Field(default=3, ge=1, le=1000, description="Runs of each solver: seeds 0, 1, ...")
    circuit: Literal["trained", "ramp", "multi-angle"] = "trained"
    layers: int = Field(default=1, ge=1, le=10)
    iterations: int = Field(default=30, ge=1, le=100_000, description="Of training, at most.")
    shots: int = Field(default=4096, ge=1, le=1_000_000, description="Of the circuit.")
    limit: float = Field(
        default=60.0,
        ge=1.0,
        le=86_400.0,
        description="Wall time of a run, after which it is ended.",
    )


@dataclass(frozen=True)
class QoblibCase:
    """An instance with its runs.

    Attributes:
        best_known: cost in the library's solution; None without one.
        runs: by solver, in the order of the seeds; of those that were made.
    """

    path: Path
    stops: int
    vehicles: int
    routes: int
    best_known: float | None
    runs: dict[SolverName, list[Record]]

    @property
    def name(self) -> str:
        """As the library names it."""
        return self.path.stem


def run(
    settings: QoblibSettings,
    data: Path,
    out: Path,
    progress: Callable[[int, int], None],
    *,
    stored: bool = False,
) -> list[QoblibCase]:
    """Make the runs that are missing; seed by seed, so that an interrupted one has whole tables.

    Args:
        progress: called with the number of runs that were made, and of those that were missing.

    Raises:
        InputError: no or malformed instances, or a folder that cannot be written.
    """
    cases = find_cases(data, settings.instances)
    circuit = LcQaoaSettings(
        variant=settings.circuit,
        layers=settings.layers,
        iterations=settings.iterations,
        shots=settings.shots,
    )
    stamp = settings.model_dump(mode="json", exclude={"instances", "seeds"})
    todo = [(c, seed, s) for seed in range(settings.seeds) for c in cases for s in SOLVERS]
    with Store(out / "results.jsonl", {"version": _VERSION, **stamp}, read_only=stored) as store:
        missing = sum(store.get(_row(s, seed), c.name) is None for c, seed, s in todo)
        executor = WorkerExecutor(1) if missing and not stored else None
        done = 0
        try:
            for case, seed, solver in todo:
                record = store.get(_row(solver, seed), case.name)
                if record is None and executor is not None:
                    progress(done, missing)
                    task = Task(solver, case.path, seed, circuit, settings.limit)
                    record = _record(task, case, store, executor)
                    record = store.put(_row(solver, seed), case.name, record)
                    done += 1
                if record is not None:
                    case.runs[solver].append(record)
            if executor is not None:
                progress(done, missing)
        finally:
            if executor is not None:
                executor.shutdown()
    return cases


def _row(solver: str, seed: int) -> str:
    return f"{solver} {seed}"


def _record(task: Task, case: QoblibCase, store: Store, executor: WorkerExecutor) -> Record:
    """One run; one that fails or is late has no answer, and the reason."""
    nothing: Record = {"seed": task.seed, "date": time.strftime("%Y-%m-%d", time.gmtime())}
    nothing |= {"cost": None, "routes": None, "bound": None, "cpu_s": None, "wall_s": None}
    cpu_s = None
    if task.solver in TIMED_BY_CIRCUIT:
        of_circuit = store.get(_row("circuit", task.seed), case.name)
        if of_circuit is None or of_circuit["cpu_s"] is None:
            return nothing | {"reason": "the circuit has no time to compare with"}
        cpu_s = of_circuit["cpu_s"] - of_circuit["model_s"]
    task = Task(task.solver, task.path, task.seed, task.circuit, task.limit_s, cpu_s)
    try:
        # A worker in the place of one that was ended has to import all first.
        executor.submit_limited(_WARM_UP_S, warm_up).result()
        return nothing | executor.submit_limited(task.limit_s + GRACE_S, run_task, task).result()
    except TimeoutError:
        return nothing | {"reason": f"no answer within {task.limit_s:g} s; ended"}
    except InputError:
        raise
    except Exception as error:
        return nothing | {"reason": error_line(error)}


def find_cases(data: Path, most: int | None) -> list[QoblibCase]:
    """The instances of a folder, those with the fewest routes first. Raises InputError: there are
    none, or one is malformed or cannot be modelled.
    """
    for folder in (data / "09-routing" / "instances", data / "instances", data):
        paths = sorted(folder.glob("*.vrp"))
        if paths:
            break
    else:
        mend = "give QOBLIB's folder, its 09-routing, or one with .vrp files"
        raise InputError(data, "no routing instance", mend, key="--data")
    cases = []
    for path in paths:
        instance = read_published(path, "qoblib")
        best = instance.file.best_known
        cases.append(
            QoblibCase(
                path,
                len(instance.fleet.stops),
                len(instance.fleet.vehicles),
                count_routes(instance, path),
                None if best is None else best.cost,
                {solver: [] for solver in SOLVERS},
            )
        )
    return sorted(cases, key=lambda case: (case.routes, case.name))[:most]


def best_cost(case: QoblibCase) -> float | None:
    """The best known cost, the library's or a better one that was found."""
    costs = [r["cost"] for runs in case.runs.values() for r in runs if r["cost"] is not None]
    return min([*costs, *([] if case.best_known is None else [case.best_known])], default=None)
