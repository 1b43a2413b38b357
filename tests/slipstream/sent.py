"""Messages to send."""

from __future__ import annotations

import msgspec

from slipstream.messages import (
    CycleReport,
    Estimate,
    KinematicFeatures,
    SegmentState,
    Unserved,
)


def a_state(**changes: object) -> SegmentState:
    """A valid state, with changes."""
    fields: dict[str, object] = {
        "rsu": "r",
        "segment": "s",
        "sequence": 1,
        "time_ns": 1,
        "window_s": 10.0,
        "features": KinematicFeatures(
            mean_speed_mps=Estimate(value=16.5, standard_error=0.1),
            mean_acceleration_mps2=Estimate(value=0.0),
            density_veh_per_m=Estimate(value=0.05),
            speed_std_mps=Estimate(value=0.2),
            acceleration_variance_m2ps4=Estimate(value=0.01),
        ),
        "y_e": 1,
        "reason": None,
        "vehicles": 9,
        "frames": 300,
        "coverage": 1.0,
    }
    return msgspec.convert(fields | changes, SegmentState)


def a_report(*unserved: Unserved) -> CycleReport:
    """A report of a cycle without plans, with these stops left out."""
    return CycleReport(
        cycle=1,
        started_ns=1,
        wall_s=0.1,
        status="ok",
        reason=None,
        solver=None,
        objective_kwh=None,
        variables=0,
        solvers=(),
        gates=(),
        energy=None,
        plans=0,
        unserved=unserved,
    )
