"""A string of seven vehicles: no deviation of speed grows from one to the next."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from slipstream.spacing import RESPONSE_S, wanted_gap_m
from tests.vehicle_agent.platooning.world import World, road, string
from vehicle_agent.platooning.safe_gap import STANDING_M

Script = Callable[[float], float]
CALM_S = 10.0
COMMON_MPS = 24.0
# (interval, messages one interval late)
LIVE, EVALUATION = (0.1, True), (0.5, False)


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


SCRIPTS = {
    "step": steps(2.0),
    "hard step": steps(9.0),
    **{f"sine of {period} s": sine(period) for period in (3.0, 6.0, 12.0, 25.0, 60.0)},
    "brakes comfortably": brakes(2.5, 8.0),
    "brakes hard": brakes(9.0, 8.0),
    "brakes to a stand": brakes(9.0, 0.0),
}


CASES = [
    pytest.param(*mode, name, marks=[] if name in few else [pytest.mark.long])
    for mode, few in ((LIVE, ["brakes hard"]), (EVALUATION, ["brakes to a stand"]))
    for name in SCRIPTS
]


@pytest.mark.slow
@pytest.mark.parametrize(("interval_s", "delayed", "name"), CASES)
def test_no_deviation_grows_along_the_string(interval_s: float, delayed: bool, name: str) -> None:
    """Neither in the mean square nor at its largest, and no gap is less than a safe one.

    Live, |G| is 1 at its largest for h = Δt: half a per cent is for the ends of what is summed.
    """
    script = SCRIPTS[name]
    gap_m = wanted_gap_m(COMMON_MPS, 1.5, interval_s)
    cars = string(7, lambda t: script(max(0.0, t - CALM_S)), gap_m, COMMON_MPS, road(length_m=9e3))
    world = World(cars, interval_s, delayed)
    world.run(CALM_S)
    begin = world.steps
    world.run(100.0)
    assert {mode for car in cars[1:] for mode in world.modes[car.name][begin:]} == {"following"}
    deviations = [np.array(world.speeds[car.name][begin:]) - COMMON_MPS for car in cars]
    squares = [float(np.sqrt((d**2).sum() * interval_s)) for d in deviations]
    largest = [float(abs(d).max()) for d in deviations]
    for ahead, behind in itertools.pairwise(squares):
        assert behind <= 1.005 * ahead
    for ahead, behind in itertools.pairwise(largest):
        assert behind <= 1.005 * ahead
    for front, rear in itertools.pairwise(cars):
        gaps = np.array(world.gaps[rear.name][begin:])
        speeds = np.array(world.speeds[rear.name][begin:])
        ahead_mps = np.array(world.speeds[front.name][begin:])
        # What braking at the strongest from here on takes, by both.
        taken_m = np.maximum(0.0, speeds**2 - ahead_mps**2) / 18.0
        assert (gaps - taken_m).min() >= STANDING_M


@pytest.mark.parametrize("braking", [1.0, 2.5, 4.5])
def test_nobody_touches_where_braking_is_told_late_in_an_evaluation(braking: float) -> None:
    """A leader that announces its old speed while it already brakes: gaps shrink, none is lost."""

    def script(t: float) -> float:
        return max(8.0, COMMON_MPS - braking * max(0.0, t - CALM_S))

    gap_m = wanted_gap_m(COMMON_MPS, 1.5, 0.5)
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
