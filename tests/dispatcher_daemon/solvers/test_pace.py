from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.solvers import pace
from dispatcher_daemon.solvers.pace import SolverPace, measure_pace

Make = Callable[[Callable[[int, int], float]], tuple[list[int], Callable[[int], object]]]


@pytest.fixture
def sampler(monkeypatch: pytest.MonkeyPatch) -> Make:
    """A sampler by its time for each trial and number of shots, and what it was asked for."""
    now = [0.0]
    monkeypatch.setattr(pace.time, "perf_counter", lambda: now[0])

    def make(time_s: Callable[[int, int], float]) -> tuple[list[int], Callable[[int], object]]:
        asked: list[int] = []

        def take(shots: int) -> None:
            now[0] += time_s(len(asked), shots)
            asked.append(shots)

        return asked, take

    return make


def test_one_trial_is_enough_where_all_shots_fit(sampler: Make) -> None:
    """The fixed time counts for each few shots then, and it still fits."""
    asked, take = sampler(lambda _, shots: 0.001 + 0.0001 * shots)
    found = measure_pace(take, 1000, 1.0)
    assert asked == [16]
    assert found.shots_in(1.0, 1000) == 1000


def test_two_trials_tell_fixed_time_and_time_a_shot(sampler: Make) -> None:
    """What is planned is what the sampler takes."""
    asked, take = sampler(lambda _, shots: 0.3 + 0.01 * shots)
    found = measure_pace(take, 4096, 1.0)
    assert asked == [16, 128]
    assert found.fixed_s == pytest.approx(0.3)
    assert found.time_s(100) == pytest.approx(1.3)
    assert found.shots_in(1.3001, 4096) == 100


def test_a_first_trial_that_warms_up_hides_no_cost(sampler: Make) -> None:
    """Longer than the second one, it tells no slope; a share of the second does."""
    _, take = sampler(lambda trial, _: (2.0, 0.4)[trial])
    found = measure_pace(take, 4096, 1.0)
    assert found.shot_s == pytest.approx(0.25 * 0.4 / 128)
    assert found.shots_in(1.0, 4096) < 4096


def test_without_a_deadline_all_shots_are_taken() -> None:
    """A recorded cycle is solved again so."""
    assert SolverPace(5.0, 0.1).shots_in(float("inf"), 4096) == 4096


def test_no_time_is_a_few_shots() -> None:
    """A solver always answers."""
    assert SolverPace(5.0, 0.1).shots_in(1.0, 4096) == 16
    assert SolverPace(5.0, 0.1).shots_in(-1.0, 8) == 8
