"""A second energy model for comparison: QUEST's steady-state drag of a vehicle behind another.

Formula: paper section II-D, which takes it from QUEST (arXiv 2505.08074). A follower s behind a
leader b needs E_{s,b} = c_s V_b² [1 − f (C_b − c_s)] per unit of distance. It knows no rolling
resistance and no change of speed, and its saving comes from the leader's being larger: two equal
vehicles save nothing by it, where the paper's own model gives the follower 20 % of its drag.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slipstream.energy import PAPER_CAR, Array, VehicleParameters


def quest_drag_n(
    speed_mps: npt.ArrayLike,
    follower: VehicleParameters,
    leader: VehicleParameters,
    shelter_mpkg: float,
) -> Array:
    """E_{s,b}: drag energy per distance at the wheels, J/m (which is N).

    The paper leaves the units of c and f open. Here c is ½ρC_dA, so that cV² is the drag force,
    and f is per kg/m.

    Args:
        speed_mps: V_b, the pair's speed, any shape.
        follower: s.
        leader: b.
        shelter_mpkg: f ≥ 0, how much shelter a leader gives by what it is larger.

    Raises:
        ValueError: f is negative, not finite, or so large that the follower would be pulled.
    """
    own, larger_by = follower.drag_factor_kgpm, leader.drag_factor_kgpm - follower.drag_factor_kgpm
    factor = 1 - shelter_mpkg * larger_by
    if not (np.isfinite(shelter_mpkg) and shelter_mpkg >= 0 and factor >= 0):
        raise ValueError(f"shelter_mpkg must be within [0, 1/(C_b − c_s)], got {shelter_mpkg}")
    return own * np.square(np.asarray(speed_mps, dtype=np.float64)) * factor


def quest_energy_kwh(
    distance_m: npt.ArrayLike,
    speed_mps: npt.ArrayLike,
    follower: VehicleParameters = PAPER_CAR,
    leader: VehicleParameters = PAPER_CAR,
    shelter_mpkg: float = 0.0,
) -> Array:
    """Electrical energy against drag over a distance by QUEST's model, kWh; arguments broadcast.

    Raises:
        ValueError: as `quest_drag_n`.
    """
    force = quest_drag_n(speed_mps, follower, leader, shelter_mpkg)
    return force * np.asarray(distance_m, dtype=np.float64) * follower.electrical_kwh(1.0)
