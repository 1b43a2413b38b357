"""What is done for a request: a green is held, a phase is cut, and no yellow is changed."""

from __future__ import annotations

import pytest

from slipstream_lab.simulation.signals.priority_rules import (
    EndPhase,
    ExtendPhase,
    PrioritySettings,
    decide,
)
from slipstream_lab.simulation.signals.program import Phase, Program

PROGRAM = Program(
    (
        Phase("Gr", 30.0, 8.0, (1,)),
        Phase("yr", 3.0, 3.0, (2,)),
        Phase("rG", 30.0, 8.0, (3,)),
        Phase("ry", 3.0, 3.0, (0,)),
    ),
    True,
)


def _decide(
    phase: int, link: int, *, wanted_s: float, through_s: float
) -> ExtendPhase | EndPhase | None:
    """A phase that began at 100 and ends at 130; greens are held to 145 at most."""
    return decide(PROGRAM, phase, 100.0, 130.0, link, wanted_s, through_s, 145.0)


def test_a_green_is_held_only_if_it_is_needed_and_within_its_limit() -> None:
    """Through before its end: nothing; after it: held until then; too long: nothing."""
    assert _decide(0, 0, wanted_s=115.0, through_s=130.0) is None
    assert _decide(0, 0, wanted_s=125.0, through_s=134.0) == ExtendPhase(134.0)
    assert _decide(0, 0, wanted_s=140.0, through_s=146.0) is None


def test_a_phase_is_cut_no_earlier_than_needed_and_after_its_least_time() -> None:
    """Green with the vehicle's arrival, yellow before it, and no green of less than 8 s."""
    assert _decide(0, 1, wanted_s=120.0, through_s=128.0) == EndPhase(117.0)
    assert _decide(0, 1, wanted_s=90.0, through_s=98.0) == EndPhase(108.0)
    assert _decide(0, 1, wanted_s=133.0, through_s=140.0) is None


def test_yellow_is_never_changed() -> None:
    """While a junction is cleared there is nothing to decide."""
    assert _decide(1, 0, wanted_s=100.0, through_s=160.0) is None
    assert _decide(1, 1, wanted_s=100.0, through_s=160.0) is None


def test_settings_out_of_range_are_refused() -> None:
    """Times are not negative."""
    with pytest.raises(ValueError, match="signal priority"):
        PrioritySettings(lead_s=-1.0)
