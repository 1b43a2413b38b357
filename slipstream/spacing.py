"""Gaps: those that followers keep and drivers have, and how leaders let them be closed; as vehicles
control them and plans count on them.

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

DRIVER_TIME_GAP_S: Final = 1.2
DRIVER_MIN_GAP_M: Final = 2.5
"""Drivers keep s₀ + v T, by the IDM of vehicles alone."""

ENTRY_HEADWAY_S: Final = 3.0
"""Between vehicles that leave one place in the same second and enter the road one after another."""

MAX_SLOWDOWN: Final = 0.15
"""Largest share that a vehicle takes off its speed so that others catch up: at 30 m/s it is still
faster than trucks, which would else pass it."""

SLOWING_SHARE: Final = 0.9
"""Of the deceleration by coasting, with which it does so."""


def driver_gap_m(speed_mps: float) -> float:
    """Gap that drivers keep at a speed, m."""
    return DRIVER_MIN_GAP_M + DRIVER_TIME_GAP_S * speed_mps


def wanted_gap_m(speed_mps: float, advised_gap_m: float, interval_s: float = RESPONSE_S) -> float:
    """Gap g* that followers keep, m: see the module.

    Args:
        interval_s: Δt; the default is that of agents in vehicles.
    """
    return advised_gap_m + max(MAX_BRAKING_MPS2 * interval_s**2, RESPONSE_S * speed_mps)
