"""What the database tells of one moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from slipstream.messages import CycleReport, VehiclePlan
from slipstream.orders import IN_FORCE, OrderRecord, PlanRecord
from storage import Event, SegmentAt

ALARMS_BEGAN_S: Final = 14 * 86_400.0
"""Alarms that began longer before a moment are not looked for, s."""
ENDED_ALARMS_S: Final = 600.0
"""For so long an alarm that has ended is listed, s: as the dispatcher does."""


@dataclass(frozen=True)
class Facts:
    """All that is stored of a moment.

    Attributes:
        time_ns: UTC.
        cycles: the last ones that had begun, oldest first.
        plans: of each vehicle, by vehicle; one may have ended.
        orders: as they were.
        segments: gates and roll-ups of all watched roads.
        events: that began before, latest first.
        energy: sums until then; None: not known.
        watched: roads by RSU, as far as is known now.
    """

    time_ns: int
    cycles: Sequence[CycleReport] = ()
    plans: Sequence[PlanRecord] = ()
    orders: Sequence[OrderRecord] = ()
    segments: Sequence[SegmentAt] = ()
    events: Sequence[Event] = ()
    energy: Mapping[str, Any] | None = None
    watched: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @property
    def plans_in_force(self) -> dict[str, VehiclePlan]:
        """The plans that vehicles followed then, by vehicle."""
        return {
            record.plan.vehicle: record.plan for record in self.plans if record.status in IN_FORCE
        }

    @property
    def alarms(self) -> list[Event]:
        """Alarms in force then, or ended less than `ENDED_ALARMS_S` before."""
        oldest_ns = self.time_ns - round(ENDED_ALARMS_S * 1e9)
        return [
            event
            for event in self.events
            if event.alarm is not None and (event.ended_ns is None or event.ended_ns > oldest_ns)
        ]

    @property
    def paused(self) -> bool:
        """Whether the dispatcher was paused, as its alarm told."""
        return any(event.kind == "paused" and self.in_force(event) for event in self.alarms)

    def in_force(self, alarm: Event) -> bool:
        """Whether an alarm had not ended."""
        return alarm.ended_ns is None or alarm.ended_ns > self.time_ns
