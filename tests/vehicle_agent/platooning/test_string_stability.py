"""A string of vehicles: no deviation of speed grows along it."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from slipstream.spacing import RESPONSE_S, STANDING_M, least_gap_m
from tests.vehicle_agent.platooning.world import IDEAL, World, road, string
from vehicle_agent.platooning import gap_control

Script = Callable[[float], float]
CALM_S = 40.0
COMMON_MPS = 24.0
# (interval, messages one interval late)
LIVE, EVALUATION = (0.1, True), (0.5, False)
ROAD = road(length_m=9e3)


def steps(rate_mps2: float) -> Script:
    """Down and up again by 4 m/s, with a largest rate of change."""

    def at(t: float) -> float:
        down = min(4.0, rate_mps2 * t)
        up = 0.0 if t < 30 else min(4.0, 1.5 * (t - 30))
        return COMMON_MPS - down + up

    return at


def sine(period_s: float) -> Script:
    """Never more than 1.5 m/s²."""
    amplitude = min(3.0, 1.5 * period_s / (2 * math.pi))
    return lambda t: COMMON_MPS + amplitude * math.sin(2 * math.pi * t / period_s)


def brakes(rate_mps2: float, to_mps: float) -> Script:
    """And stays at that speed."""
    return lambda t: max(to_mps, COMMON_MPS - rate_mps2 * t)


CALM = {
    "step": steps(1.9),
    **{f"sine of {period} s": sine(period) for period in (3.0, 6.0, 12.0, 25.0, 60.0)},
    "brakes": brakes(1.9, 8.0),
}
HARD = {
    "hard step": steps(9.0),
    "brakes hard": brakes(9.0, 8.0),
    "brakes to a stand": brakes(9.0, 0.0),
}
LIMIT_MPS2 = 2.0


def cases(scripts: dict[str, Script], few: str) -> list[Any]:
    """Of both modes; all but one are for longer runs."""
    return [
        pytest.param(*mode, name, marks=[] if name == few else [pytest.mark.long])
        for mode in (LIVE, EVALUATION)
        for name in scripts
    ]


@pytest.fixture(autouse=True)
def _any_length(monkeypatch: pytest.MonkeyPatch) -> None:
    """Deviations are looked at beyond the length that brakes allow."""
    monkeypatch.setattr(gap_control, "longest_string", lambda *_: 99)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("interval_s", "delayed", "name"), cases(CALM, "sine of 6.0 s"))
def test_no_deviation_grows_along_the_string(interval_s: float, delayed: bool, name: str) -> None:
    """Neither in the mean square nor at its largest, along ten vehicles behind a leader that tells
    what it will drive. Live, one message in twenty is lost. Two per cent in the mean, and three at
    the largest, are for what the first follower does not hear in time.
    """
    script = CALM[name]
    gap_m = least_gap_m(COMMON_MPS, LIMIT_MPS2, IDEAL, interval_s)
    cars = string(11, lambda t: script(max(0.0, t - CALM_S)), max(1.5, gap_m), COMMON_MPS, ROAD)
    cars[0].promises_mps2 = LIMIT_MPS2
    world = World(cars, interval_s, delayed, loss=0.05 if delayed else 0.0)
    world.run(CALM_S)
    begin = world.steps
    world.run(100.0)
    assert {mode for car in cars[1:] for mode in world.modes[car.name][begin:]} == {"following"}
    deviations = [np.array(world.speeds[car.name][begin:]) - COMMON_MPS for car in cars]
    squares = [float(np.sqrt((d**2).sum() * interval_s)) for d in deviations]
    largest = [float(abs(d).max()) for d in deviations]
    for behind in squares[1:]:
        assert behind <= 1.02 * squares[0]
    for behind in largest[1:]:
        assert behind <= 1.03 * largest[0]
    assert min(min(world.gaps[car.name][begin:]) for car in cars[1:]) > STANDING_M


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("interval_s", "delayed", "name"), cases(HARD, "brakes to a stand"))
def test_nobody_touches_where_the_leader_promises_nothing(
    interval_s: float, delayed: bool, name: str
) -> None:
    """It brakes as hard as it can, and tells it as it does it."""
    script = HARD[name]
    gap_m = least_gap_m(COMMON_MPS, 9.0, IDEAL, interval_s)
    cars = string(7, lambda t: script(max(0.0, t - CALM_S)), gap_m, COMMON_MPS, ROAD)
    world = World(cars, interval_s, delayed)
    world.run(CALM_S + 60.0)
    assert min(min(world.gaps[car.name]) for car in cars[1:]) > 0.0


@pytest.mark.parametrize("braking", [1.0, 2.5, 4.5])
def test_nobody_touches_where_braking_is_told_late_in_an_evaluation(braking: float) -> None:
    """A leader that announces its old speed while it already brakes: gaps shrink, none is lost."""

    def script(t: float) -> float:
        return max(8.0, COMMON_MPS - braking * max(0.0, t - CALM_S))

    gap_m = least_gap_m(COMMON_MPS, 9.0, IDEAL, 0.5)
    world = World(string(5, script, gap_m, COMMON_MPS, road(length_m=9e3)), 0.5, delayed=True)
    world.run(60.0)
    assert min(min(world.gaps[f"v{i}"]) for i in range(1, 5)) > 0.4


def test_the_transfer_function_that_the_law_is_named_by_never_exceeds_one() -> None:
    """|G(jω)| for all frequencies, with h as large as the delay; and not with half of it."""

    def largest(h: float, tau: float, k: float = 0.4) -> float:
        s = 1j * np.logspace(-3, 3, 20_000)
        return float(np.abs((s * np.exp(-tau * s) + k) / (s * (1 + k * h) + k)).max())

    assert largest(RESPONSE_S, 0.1) <= 1.0
    assert largest(RESPONSE_S, 0.0) <= 1.0
    assert largest(0.05, 0.1) > 1.001
