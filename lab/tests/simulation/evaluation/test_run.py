"""Simulating what a folder lacks."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest

from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream.errors import InputError
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.runs.run import (
    RunSummary,
    Simulate,
    record_wall_time,
    run_missing,
)
from slipstream_lab.simulation.evaluation.runs.store import ArmStore
from slipstream_lab.simulation.sumo import Progress

ARMS = (POLICIES["B"], POLICIES["C"])
SPAN_S = (GROUND.begin_s, GROUND.end_s)


def run(folder: Path, simulate: Simulate, workers: int = 1) -> tuple[RunSummary, list[float]]:
    """Two arms of two seeds, and the shares that progress was told."""
    shares: list[float] = []
    with ArmStore(folder, GROUND, "code") as store:
        done = run_missing(
            ARMS, (1, 2), SPAN_S, store, simulate, workers, lambda a, b: shares.append(a / b)
        )
    return done, shares


def test_what_is_stored_is_not_simulated_again(tmp_path: Path) -> None:
    """Seed by seed; a second run does nothing and knows what it kept."""
    called: list[tuple[str, int]] = []

    def simulate(policy: Policy, seed: int, progress: Progress) -> ArmResult:
        called.append((policy.name, seed))
        progress(7.5 * 3600, GROUND.end_s)
        return make_arm(policy, seed)

    done, shares = run(tmp_path, simulate)
    assert called == [("B", 1), ("C", 1), ("B", 2), ("C", 2)]
    assert (done.kept, set(done.wall_s)) == (0, set(called))
    assert shares == pytest.approx([n / 8 for n in range(1, 9)])
    done, shares = run(tmp_path, simulate)
    assert (len(called), done.kept, done.wall_s, shares) == (4, 4, {}, [])


def test_arms_run_at_once(tmp_path: Path) -> None:
    """With two workers the second one begins before the first one ends."""
    both = threading.Barrier(2, timeout=20)

    def simulate(policy: Policy, seed: int, progress: Progress) -> ArmResult:
        both.wait()
        return make_arm(policy, seed)

    run(tmp_path, simulate, workers=2)
    assert len(list((tmp_path / "arms").glob("*.json"))) == 4


@pytest.mark.parametrize("fault", [InputError("net", "bad", "mend it"), KeyboardInterrupt()])
def test_a_fault_keeps_what_is_finished_and_ends_what_runs(
    tmp_path: Path, fault: BaseException
) -> None:
    """An arm that runs beside it is told to stop; the next run goes on from what is there."""
    running, stopped = threading.Event(), threading.Event()

    def simulate(policy: Policy, seed: int, progress: Progress) -> ArmResult:
        if (policy.name, seed) == ("B", 1):
            return make_arm(policy, seed)
        if (policy.name, seed) == ("C", 1):
            running.wait(20)
            raise fault
        running.set()
        try:
            while True:
                progress(GROUND.begin_s, GROUND.end_s)
        finally:
            stopped.set()

    with pytest.raises(type(fault)):
        run(tmp_path, simulate, workers=2)
    assert stopped.is_set()
    assert [path.name for path in (tmp_path / "arms").glob("*.json")] == ["B-1.json"]
    assert list(json.loads((tmp_path / "run.json").read_text())["wall_s"]) == ["B-1"]
    done, _ = run(tmp_path, lambda policy, seed, _: make_arm(policy, seed))
    assert done.kept == 1


def test_wall_times_are_added_up_over_runs(tmp_path: Path) -> None:
    """A later arm joins the earlier ones; a damaged file is begun anew."""
    record_wall_time(tmp_path, "B", 1, 10.04)
    record_wall_time(tmp_path, "C", 1, 20.0)
    path = tmp_path / "run.json"
    assert json.loads(path.read_text()) == {"wall_s": {"B-1": 10.0, "C-1": 20.0}}
    path.write_text("{")
    record_wall_time(tmp_path, "A", 1, 1.0)
    assert json.loads(path.read_text()) == {"wall_s": {"A-1": 1.0}}
