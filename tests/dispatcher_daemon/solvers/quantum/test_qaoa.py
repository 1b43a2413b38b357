from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import pytest

from dispatcher_daemon.forms.decode import violations
from dispatcher_daemon.forms.problem import ArcProblem, RouteProblem
from dispatcher_daemon.planning.arc_form.arcs import arc_problem_of
from dispatcher_daemon.settings import QaoaSettings
from dispatcher_daemon.solvers.quantum.qaoa import QaoaSolver
from dispatcher_daemon.solvers.quantum.statevector.exact_state import ExactState, Schedule
from slipstream_lab.research.instances import open_instance

Routes = Callable[[int, Sequence[int], int], RouteProblem]


def published(name: str) -> ArcProblem:
    """The arc form of a published instance."""
    instance = open_instance(name)
    return arc_problem_of(instance.problem, instance.snapshot, instance.sync_window_s)


def test_x_mixer_says_what_it_did() -> None:
    """A valid answer, samples of all qubits, and no figures of a circuit that was not built."""
    problem = published("arc14-avenue")
    outcome = QaoaSolver().solve(problem, 10.0, seed=1)
    assert outcome.selected is not None
    assert violations(problem, outcome.selected) == ()
    assert outcome.samples is not None
    assert (outcome.samples.qubits, outcome.samples.shots) == (14, 4096)
    assert sum(n for _, n in outcome.samples.raw) > 20
    execution = outcome.execution
    assert execution is not None
    assert (execution.backend, execution.kind) == ("statevector", "simulated")
    assert (execution.variant, execution.layers) == ("x", 2)
    assert (execution.two_qubit_depth, execution.two_qubit_gates) == (None, None)
    assert 0 < execution.train_s + execution.sample_s < outcome.wall_s


def test_a_seed_gives_one_answer() -> None:
    """Twice the same, timings aside."""
    problem = published("arc08-blocks")
    solver = QaoaSolver()
    first, second = (solver.solve(problem, 10.0, seed=7) for _ in range(2))
    assert (first.selected, first.samples) == (second.selected, second.samples)


def test_xy_mixer_draws_one_option_each(random_routes: Routes) -> None:
    """Where any choice of options is valid, all raw samples are, and none needs repair."""
    problem = random_routes(3, (3, 4, 2), 0)
    outcome = QaoaSolver(QaoaSettings(variant="xy"), shots=1000).solve(problem, 5.0, seed=2)
    assert outcome.samples is not None
    assert outcome.samples.share(outcome.samples.raw) == 1
    assert outcome.execution is not None
    assert outcome.execution.variant == "xy"
    best = min(value for value, _ in outcome.samples.raw)
    uniform = 1 / 24
    assert outcome.samples.share(outcome.samples.raw, best) > uniform


def test_shipped_angles_of_the_xy_mixer_beat_chance(random_routes: Routes) -> None:
    """Untrained, on 5 · 5 · 5 · 5 choices: the best one far more often than one time in 625."""
    problem = random_routes(4, (5,) * 4, 0)
    solver = QaoaSolver(QaoaSettings(variant="xy"), layers=3, shots=20_000)
    outcome = solver.solve(problem, 5.0, seed=2)
    assert outcome.samples is not None
    best = min(value for value, _ in outcome.samples.repaired)
    assert outcome.samples.share(outcome.samples.raw, best) > 10 / 625


def test_xy_mixer_needs_options() -> None:
    """The arc form has no one-hot groups, and the answer says so."""
    outcome = QaoaSolver(QaoaSettings(variant="xy")).solve(published("arc08-blocks"), 5.0, seed=1)
    assert outcome.status == "failed"
    assert "one-hot" in (outcome.reason or "")


@pytest.mark.parametrize(
    ("variant", "counts", "deadline_s", "reason"),
    [
        ("x", (4,) * 7, 10.0, "28 qubits, the most for a state vector is 27"),
        ("x", (5,) * 5, 0.5, "25 qubits at p = 2 take about"),
        ("xy", (4,) * 10, 2.0, "40 qubits at p = 2 take about"),
        ("xy", (5,) * 9, 10.0, "1953125 combinations of options"),
        ("xy", (), 10.0, "nothing to choose"),
    ],
)
def test_what_will_not_fit_is_refused_at_once(
    variant: str, counts: tuple[int, ...], deadline_s: float, reason: str, random_routes: Routes
) -> None:
    """By qubits, time or combinations, with the reason, long before the deadline."""
    problem = random_routes(1, counts, 0)
    solver = QaoaSolver(QaoaSettings.model_validate({"variant": variant}))
    began = time.process_time()
    outcome = solver.solve(problem, deadline_s, seed=1)
    assert time.process_time() - began < 0.4
    assert outcome.status == "failed"
    assert outcome.selected is None
    assert reason in (outcome.reason or "")


def test_memory_is_looked_at_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """With 1 MiB free, 20 qubits are refused with both figures."""

    class Memory:
        available = 1 << 20

    monkeypatch.setattr("psutil.virtual_memory", Memory)
    outcome = QaoaSolver().solve(published("arc20-avenue"), 10.0, seed=1)
    assert outcome.reason == "20 qubits need 12 MiB of memory, 1 MiB are free"


def test_training_gets_its_share_of_the_time() -> None:
    """Three fifths; the angles that it leaves the state at are the answer's."""
    given_s: list[float] = []

    def train(state: ExactState, start: Schedule, deadline: float) -> None:
        given_s.append(deadline - time.perf_counter())
        state.evolve(start)

    problem = published("arc14-avenue")
    outcome = QaoaSolver(train=train).solve(problem, 10.0, seed=1)
    assert 3.0 < given_s[0] <= 6.0
    assert outcome.samples == QaoaSolver().solve(problem, 10.0, seed=1).samples
