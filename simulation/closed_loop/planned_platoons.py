"""Platoons as the plans have them, beside those that are driven."""

from __future__ import annotations

from slipstream.messages import VehiclePlan


class PlannedPlatoons:
    """What the newest plan of each vehicle has of platoons at any moment.

    A later plan replaces what an earlier one had of the time after it.

    Attributes:
        planned_m: distance in platoons so far, of all plans, what was replaced left out.
    """

    def __init__(self) -> None:
        self.planned_m = 0.0
        self._newest: dict[str, VehiclePlan] = {}

    def add(self, plan: VehiclePlan, now_ns: int) -> None:
        """A plan is sent.

        Args:
            plan: with the lengths of its segments.
            now_ns: when, UTC.
        """
        before = self._newest.get(plan.vehicle)
        if before is not None:
            self.planned_m -= _platooned_m(before, now_ns)
        self.planned_m += _platooned_m(plan, now_ns)
        self._newest[plan.vehicle] = plan


def _platooned_m(plan: VehiclePlan, from_ns: int) -> float:
    """Distance in platoons on segments that are entered after a moment."""
    return sum(
        segment.length_m or 0.0
        for segment in plan.segments
        if segment.platoon is not None and segment.entry_ns >= from_ns
    )
