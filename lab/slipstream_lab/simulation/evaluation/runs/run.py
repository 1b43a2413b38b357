"""Simulates the arms that a folder lacks, several at once, each in a subprocess."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.runs.store import ArmStore, write_atomically
from slipstream_lab.simulation.sumo import Progress

Simulate = Callable[[Policy, int, Progress], ArmResult]
"""Simulates the arm of a policy and a seed in a subprocess that it starts, and ends on any fault.

What the progress callback raises ends the arm.
"""


@dataclass(frozen=True)
class RunSummary:
    """Summary of a run."""

    kept: int
    wall_s: dict[tuple[str, int], float]


class _Cancelled(Exception):
    """The run was stopped."""


def run_missing(
    policies: Sequence[Policy],
    seeds: Sequence[int],
    span_s: tuple[float, float],
    store: ArmStore,
    simulate: Simulate,
    workers: int,
    progress: Callable[[float, float], None],
) -> RunSummary:
    """Simulate what is not in the store, seed by seed, so that an interrupted run has whole seeds.

    Args:
        progress: called with the simulated time done and the total, s; never concurrently.

    Raises:
        InputError: an arm cannot be simulated, or the store is of another evaluation. What was
            finished before is kept, as after KeyboardInterrupt.
    """
    begin_s, end_s = span_s
    wanted = [(policy, seed) for seed in seeds for policy in policies]
    missing = [job for job in wanted if store.get(*job) is None]
    stop, lock = threading.Event(), threading.Lock()
    passed_s: dict[tuple[str, int], float] = {}
    wall_s: dict[tuple[str, int], float] = {}
    whole_s = len(missing) * (end_s - begin_s)

    def one(policy: Policy, seed: int) -> None:
        def report(now_s: float, _: float) -> None:
            if stop.is_set():
                raise _Cancelled
            with lock:
                passed_s[policy.name, seed] = min(now_s, end_s) - begin_s
                progress(sum(passed_s.values()), whole_s)

        if stop.is_set():
            return
        began = time.monotonic()
        result = simulate(policy, seed, report)
        with lock:
            store.put(policy, seed, result)
            wall_s[policy.name, seed] = time.monotonic() - began
            record_wall_time(store.folder, policy.name, seed, wall_s[policy.name, seed])
            passed_s[policy.name, seed] = end_s - begin_s
            progress(sum(passed_s.values()), whole_s)

    with ThreadPoolExecutor(max_workers=workers) as pool:
        # Threads only wait: each arm has its process.
        futures: list[Future[None]] = [pool.submit(one, *job) for job in missing]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
        finally:
            stop.set()
            for future in futures:
                future.cancel()
    for future in futures:
        if not future.cancelled() and not isinstance(future.exception(), _Cancelled | None):
            future.result()
    return RunSummary(len(wanted) - len(missing), wall_s)


def record_wall_time(folder: Path, name: str, seed: int, wall_s: float) -> None:
    """Add an arm's wall time to `run.json`, which is not part of the results. Raises OSError: the
    disk is full.
    """
    path = folder / "run.json"
    try:
        known = dict(json.loads(path.read_text(encoding="utf-8"))["wall_s"])
    except (OSError, ValueError, KeyError, TypeError):
        known = {}
    known[f"{name}-{seed}"] = round(wall_s, 1)
    write_atomically(path, json.dumps({"wall_s": dict(sorted(known.items()))}, indent=1) + "\n")
