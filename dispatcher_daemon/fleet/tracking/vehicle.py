"""One vehicle as its messages show it: reports, plan on offer, plan that it follows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from dispatcher_daemon.fleet.stops import Depot
from dispatcher_daemon.fleet.tracking.sightings import VehicleSightings
from dispatcher_daemon.fleet.vehicles import Break, Vehicle
from slipstream.messages import PlanAcknowledgement, VehiclePosition, VehicleProgress
from slipstream.orders import PlanRecord, PlanStatus, VehicleRecord

FRESH_NS: Final = 15 * 10**9
"""A vehicle whose last position is older is silent: some fifteen are missing."""
_STORED: Final = (
    *("position", "reports_progress", "answered_ns", "left_out_until", "booked"),
    *("rested_ns", "rested_break", "answer"),
)
_AHEAD_NS: Final = 10**9
"""A report dated further ahead than this may not keep later ones out."""


@dataclass
class TrackedVehicle:
    """What is known of one vehicle.

    Attributes:
        definition: in the fleet's file, as it was there last.
        depot: likewise.
        heard_ns: when its position came, by the dispatcher's clock.
        progress: its latest visits, without those of past tours.
        answered_ns: when its last message of any kind came; None: it has never sent one.
        withdrawn: plan that was taken back last, as it did not answer it or let it lie.
        leg: of the accepted plan, the furthest that it has reported.
        left: whether it has left its depot by the accepted plan.
        free_since_ns: since when it stands at its depot and says that it follows no plan, without
            a silence in between; None: it does not.
        left_out_until: cycle from which on it is planned again.
        booked: up to where the accepted plan is in the energy ledger, in segments of its way.
        rested_ns: when its last break ended, UTC; 0: it has had none.
        rested_break: number of that break; None: the vehicle has none of that name now.
        back_ns: when its last tour ended, UTC; 0: none has since the start.
        given: orders of the plans that it was sent, and when, by its clock.
    """

    definition: Vehicle
    depot: Depot
    listed: bool = True
    position: VehiclePosition | None = None
    heard_ns: int = 0
    reports_progress: bool = False
    progress: VehicleProgress | None = None
    answered_ns: int | None = None
    answer: PlanAcknowledgement | None = None
    offered: PlanRecord | None = None
    accepted: PlanRecord | None = None
    withdrawn: PlanRecord | None = None
    leg: int = 0
    left: bool = False
    free_since_ns: int | None = None
    left_out_until: int = 0
    booked: float = 0.0
    rested_ns: int = 0
    rested_break: int | None = None
    back_ns: int = 0
    given: dict[str, int] = field(default_factory=dict)
    sightings: VehicleSightings = field(default_factory=VehicleSightings)

    @property
    def id(self) -> str:
        """Its name."""
        return self.definition.id

    @property
    def has_telemetry(self) -> bool:
        """Whether it has ever sent anything."""
        return self.answered_ns is not None

    def charged(self) -> Vehicle:
        """As in the fleet's file, with the charge that it has reported, or else was planned for the
        place that it left last.
        """
        given = self.definition
        if given.type is None and given.own_type is None:
            return given
        charge_kwh = None if self.position is None else self.position.charge_kwh
        if charge_kwh is None and self.accepted is not None:
            place = self.accepted.plan.stops[min(self.leg, len(self.accepted.plan.stops) - 1)]
            if place.charge_kwh is not None:
                charge_kwh = place.charge_kwh + place.charged_kwh
        if charge_kwh is None:
            return given
        return given.model_copy(update={"charge_kwh": charge_kwh})

    def plannable(self, reference_ns: int) -> Vehicle:
        """`charged`, with the breaks that it has had as breaks that are over. They are taken in
        their order, so that those behind the last one are still to come. At its depot it can have
        had none before its last tour ended.
        """
        vehicle = self.charged()
        last = len(vehicle.breaks) if self.rested_break is None else self.rested_break
        back_s = 1e-9 * (self.back_ns - reference_ns)

        def due(number: int, own: Break) -> Break:
            if number <= last and reference_ns + 1e9 * own.earliest_s < self.rested_ns:
                return own.over
            if own.earliest_s < back_s <= own.latest_s:
                return own.model_copy(update={"earliest_s": back_s})
            return own

        breaks = tuple(due(number, own) for number, own in enumerate(vehicle.breaks))
        return (
            vehicle if breaks == vehicle.breaks else vehicle.model_copy(update={"breaks": breaks})
        )

    @property
    def keeps_its_plan(self) -> bool:
        """Whether a charging stop, a hub or a break lies ahead of it, or it stands at one: stops of
        a plan that no commitment tells.
        """
        if self.accepted is None or self.position is None:
            return False
        begin = self.leg + (1 if self.position.on_road else 0)
        ahead = self.accepted.plan.stops[begin:-1]
        return any(stop.charged_kwh > 0 or stop.is_hub for stop in ahead)

    def is_fresh(self, now_ns: int) -> bool:
        """Whether its position is known."""
        return self.position is not None and now_ns - self.heard_ns <= FRESH_NS

    def by_its_clock(self, now_ns: int) -> int:
        """A moment as the vehicle dates it, by its last position."""
        if self.position is None or self.heard_ns == 0:
            return now_ns
        return now_ns - (self.heard_ns - self.position.time_ns)

    def is_news(self, before_ns: int | None, time_ns: int, now_ns: int) -> bool:
        """Whether a report is later than the one before, if that is not of the future."""
        return before_ns is None or time_ns > before_ns or before_ns > now_ns + _AHEAD_NS

    def accept(self, now_ns: int) -> list[PlanRecord]:
        """It follows the plan on offer; the plans whose status has changed."""
        assert self.offered is not None
        changed = []
        before = self.accepted
        if before is not None:
            changed.append(ended(before, "superseded", now_ns, "by the plan that it accepted"))
        self.accepted = replace(self.offered, status="acknowledged", since_ns=now_ns)
        self.offered = None
        self.leg = 0
        self.left = self.left and before is not None
        return [*changed, self.accepted]

    def record(self) -> VehicleRecord:
        """As it is stored."""
        return VehicleRecord(
            vehicle=self.id,
            definition=self.definition.model_dump(mode="json"),
            depot=self.depot.model_dump(mode="json"),
            **{name: getattr(self, name) for name in _STORED},
        )


def loaded(record: VehicleRecord) -> TrackedVehicle:
    """A vehicle as it was stored; it is silent until it is heard of again."""
    return TrackedVehicle(
        definition=Vehicle.model_validate(record.definition),
        depot=Depot.model_validate(record.depot),
        listed=False,
        **{name: getattr(record, name) for name in _STORED},
    )


def ended(
    record: PlanRecord, status: PlanStatus, now_ns: int, reason: str | None = None
) -> PlanRecord:
    """A plan that is no longer in force."""
    return replace(record, status=status, since_ns=now_ns, reason=reason)
