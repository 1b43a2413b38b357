"""The gap that followers in a platoon keep, as vehicles control it and plans count on it.

g* = g_advised + max(b Δt², h v): the first term is what an emergency braking ahead takes within a
control interval Δt of an evaluation, the second the time gap h = `RESPONSE_S`. Why h is enough:
`vehicle_agent.platooning.gap_control`.
"""

from __future__ import annotations

from typing import Final

ADVISED_GAP_M: Final = 1.5
"""Advised where nothing else is."""

MAX_BRAKING_MPS2: Final = 9.0
"""Strongest braking of any vehicle: dry asphalt."""

RESPONSE_S: Final = 0.1
"""From a partner's change of speed to the answer to it: one message and one control interval of the
platoon control message, sent ten times a second."""


def wanted_gap_m(speed_mps: float, advised_gap_m: float, interval_s: float = RESPONSE_S) -> float:
    """Gap g* that followers keep, m: see the module.

    Args:
        interval_s: Δt; the default is that of agents in vehicles.
    """
    return advised_gap_m + max(MAX_BRAKING_MPS2 * interval_s**2, RESPONSE_S * speed_mps)
