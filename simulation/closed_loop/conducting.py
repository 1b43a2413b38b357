"""The conductor of an arm, from its levers."""

from __future__ import annotations

from collections.abc import Mapping

from simulation.closed_loop.conductor import Conductor, NoConductor
from simulation.closed_loop.gates import Roadside
from simulation.closed_loop.policy import Policy


def conductor_of(
    policy: Policy, step_s: float, lengths_m: Mapping[str, float], roadside: Roadside
) -> Conductor:
    """What tells the vehicles of an arm how to drive."""
    return NoConductor()
