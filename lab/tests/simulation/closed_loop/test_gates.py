"""Which gates are open, and what counts as turbulent."""

from __future__ import annotations

from slipstream_lab.simulation.closed_loop.gates import is_turbulent, open_gates
from slipstream_lab.simulation.ground_truth import TrueWindow

WATCHED = [f"s{number}" for number in range(40)]


def window(vehicles: int, y_e: int) -> TrueWindow:
    """A window of so many vehicles."""
    return TrueWindow(10.0, 0.0, 0.01, 2.0, 1.0, None, vehicles, 1 if y_e else 0, False)


def test_open_and_reported_gates() -> None:
    """All that are watched, or those that are reported."""
    assert open_gates("open", WATCHED, {"s1"}, 1) == frozenset(WATCHED)
    assert open_gates("rsu", WATCHED, {"s1"}, 1) == {"s1"}


def test_random_gates_are_open_as_often_and_as_long_but_elsewhere() -> None:
    """Each segment has another one's gate all day, so a gate that lasts is one that lasts."""
    first = open_gates("random", WATCHED, {"s1", "s2", "s3"}, 1)
    second = open_gates("random", WATCHED, {"s2", "s3", "s4"}, 1)
    assert len(first) == len(second) == 3
    assert len(first & second) == 2
    assert first != {"s1", "s2", "s3"}
    assert first != open_gates("random", WATCHED, {"s1", "s2", "s3"}, 2)
    assert open_gates("random", WATCHED, WATCHED, 1) == frozenset(WATCHED)


def test_one_or_two_vehicles_that_brake_are_no_turbulent_traffic() -> None:
    """As few as no RSU would judge."""
    assert is_turbulent(window(3, 0))
    assert not is_turbulent(window(2, 0))
    assert not is_turbulent(window(9, 1))
    assert not is_turbulent(None)
