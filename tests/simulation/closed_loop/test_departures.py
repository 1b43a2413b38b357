"""The last look before a leg: what the plan allows, and no more."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from simulation.closed_loop.departures import LegDepartures
from simulation.closed_loop.dispatching import settings_of
from simulation.closed_loop.policy import LEVERS, Policy
from simulation.controllers.vehicle import LegOrder
from slipstream.messages import DrivingAdvice


class Seconds:
    """Always finds the last second the best."""

    def best_second(self, path: tuple[str, ...], now_s: float, latest_s: float) -> float:
        """The latest one."""
        return latest_s


def leg_departures(slack_s: float, way: tuple[str, ...] | None = None) -> LegDepartures:
    """With a vehicle that has so much time, and a better way or none."""
    alternatives = SimpleNamespace(better=lambda *_: way)
    dispatching: Any = SimpleNamespace(alternatives=lambda *_: alternatives)
    tours: Any = SimpleNamespace(slack_s=lambda *_: slack_s)
    return LegDepartures(cast(Any, None), dispatching, cast(Any, None), tours, cast(Any, Seconds()))


@pytest.mark.parametrize(
    ("window_s", "slack_s", "waits_s"), [(32.0, 600.0, 32.0), (32.0, 5.0, 5.0), (0.0, 600.0, 0.0)]
)
def test_a_leg_waits_no_longer_than_its_plan_and_its_deliveries_allow(
    window_s: float, slack_s: float, waits_s: float
) -> None:
    """The plan that the vehicle got says within how much time the second may be chosen."""
    advice = DrivingAdvice(departure_window_s=window_s)
    order = LegOrder("van", 0, 0, ("a", "b"), 100.0, 100.0, 60.0, (), advice)
    assert leg_departures(slack_s).leave(order, 100.0) == (order, 100.0 + waits_s)


def test_the_window_is_in_the_plans_of_arms_that_have_the_lever() -> None:
    """And 0 in the others'."""
    for lever in LEVERS:
        advice = settings_of(Policy("x", frozenset({lever}))).advice
        assert advice.departure_window_s == (32.0 if lever == "departures" else 0.0)
