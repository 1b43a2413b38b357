"""Platoons as the plans have them, beside those that are driven."""

from __future__ import annotations

from slipstream.energy.consumption import ETA_FOLLOWER, ETA_LEADER, drag_saving_kwh
from slipstream.messages import VehiclePlan


class PlannedPlatoons:
    """What the newest plan of each vehicle has of platoons at any moment.

    A later plan replaces what an earlier one had of the time after it.

    Attributes:
        planned_m: distance on which plans expect close platoons so far, what was replaced left out.
        saved_kwh: what drafting saves there, at planned speeds by the paper's reductions.
    """

    def __init__(self) -> None:
        self.planned_m = 0.0
        self.saved_kwh = 0.0
        self._newest: dict[str, VehiclePlan] = {}

    def add(self, plan: VehiclePlan, now_ns: int) -> None:
        """A plan is sent."""
        before = self._newest.get(plan.vehicle)
        replaced = (0.0, 0.0) if before is None else platooned(before, now_ns)
        (old_m, old_kwh), (new_m, new_kwh) = replaced, platooned(plan, now_ns)
        self.planned_m += new_m - old_m
        self.saved_kwh += new_kwh - old_kwh
        self._newest[plan.vehicle] = plan


def platooned(plan: VehiclePlan, from_ns: int = 0) -> tuple[float, float]:
    """(distance on which close platoons are expected, m; what drafting saves there, kWh) on
    segments that are entered from a moment on, at planned speeds by the paper's reductions.
    """
    distance_m, saved_kwh = 0.0, 0.0
    for segment in plan.segments:
        if segment.platoon is not None and segment.entry_ns >= from_ns:
            share = 1.0 if segment.drafting_share is None else segment.drafting_share
            length_m = share * (segment.length_m or 0.0)
            eta = ETA_LEADER if segment.place == 0 else ETA_FOLLOWER
            distance_m += length_m
            saved_kwh += drag_saving_kwh(length_m, segment.speed_mps, eta)
    return distance_m, saved_kwh
