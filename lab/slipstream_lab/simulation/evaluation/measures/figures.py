"""One arm of one seed in figures: sums over its legs, services and cycles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from slipstream.energy.consumption import Energy, total
from slipstream.energy.drafting import DragLaw, greatest_reduction
from slipstream_lab.simulation.closed_loop.record import ArmResult, Others
from slipstream_lab.simulation.fleet.drafting import CAUSES, Cause
from slipstream_lab.simulation.fleet.losses import Losses
from slipstream_lab.simulation.fleet.safety import FleetSafety, OthersSafety
from slipstream_lab.simulation.scenarios.acceptance import clock


@dataclass(frozen=True)
class Measures:
    """What an arm came to; energies in kWh.

    Attributes:
        teleports: of all vehicles, as SUMO counts them; collisions and emergency stops likewise.
        safety: the fleet's part of them.
        late: orders served after their latest time, or not at all though it is over.
        faults: why no figure of this arm counts; nothing if it is sound.
    """

    driven: Energy
    alone: Energy
    losses: Losses
    legs: int
    distance_km: float
    travel_h: float
    driving_h: float
    depot_waits_s: tuple[float, ...]
    stop_waits_s: tuple[float, ...]
    led_km: float
    followed_km: float
    planned_platooned_km: float
    planned_drafting_kwh: float
    missed_km: Mapping[Cause, float]
    stops: int
    waited_h: float
    orders: int
    served_orders: frozenset[str]
    late: int
    cycles: int
    planned_kwh: float
    watched: int
    judged: int
    open: int
    open_turbulent: int
    disengagements: int
    turbulent_s: float
    others: Others
    unfinished: int
    teleports: int
    collisions: int
    emergency_stops: int
    safety: FleetSafety
    faults: tuple[str, ...]
    law: DragLaw

    @property
    def others_safety(self) -> OthersSafety:
        """What is not the fleet's of the collisions, emergency stops and teleports."""
        own = self.safety
        return OthersSafety(
            # SUMO may count a collision of the fleet otherwise than we do.
            max(0, self.collisions - own.collisions),
            max(0, self.emergency_stops - own.emergency_stops),
            max(0, self.teleports - own.teleports),
            self.others.trips,
        )

    @property
    def served(self) -> int:
        """Orders whose service began."""
        return len(self.served_orders)

    @property
    def per_order_kwh(self) -> float:
        """Energy for each served order; a sound arm served some."""
        return self.energy_kwh / self.served

    @property
    def per_order_s(self) -> float:
        """Travel time for each served order."""
        return 3600 * self.travel_h / self.served

    @property
    def energy_kwh(self) -> float:
        """Electrical energy of the fleet."""
        return self.driven.total_kwh

    @property
    def waits_s(self) -> tuple[float, ...]:
        """Of all legs, before they came onto the road."""
        return self.depot_waits_s + self.stop_waits_s

    @property
    def platooned_km(self) -> float:
        """Driven in platoons, leaders included."""
        return self.led_km + self.followed_km

    @property
    def drafted_kwh(self) -> float:
        """Saved by drafting on the same drives."""
        return self.alone.total_kwh - self.driven.total_kwh

    @property
    def ceiling_kwh(self) -> float:
        """What drafting would save at most: everybody a follower all the way."""
        return greatest_reduction(self.law) * self.alone.drag_kwh

    @property
    def platooned_share(self) -> float:
        """Of the distance; 0 where nothing was driven."""
        return self.platooned_km / self.distance_km if self.distance_km else 0.0

    @property
    def open_share(self) -> float | None:
        """Open gates of the judged ones."""
        return self.open / self.judged if self.judged else None


def measure(result: ArmResult, law: DragLaw = "paper") -> Measures:
    """Sum up an arm. `law`: of its vehicles' drag."""
    legs, cycles = result.legs, result.cycles
    return Measures(
        driven=total(leg.driven for leg in legs),
        alone=total(leg.alone for leg in legs),
        losses=Losses(*(sum(parts) for parts in zip(*(leg.losses for leg in legs), strict=True)))
        if legs
        else Losses(0.0, 0.0, 0.0, 0.0, 0.0),
        legs=len(legs),
        distance_km=sum(leg.distance_m for leg in legs) / 1000,
        travel_h=sum(leg.travel_s for leg in legs) / 3600,
        driving_h=sum(leg.arrived_s - leg.departed_s for leg in legs) / 3600,
        depot_waits_s=tuple(leg.departed_s - leg.ready_s for leg in legs if leg.leg == 0),
        stop_waits_s=tuple(leg.departed_s - leg.ready_s for leg in legs if leg.leg > 0),
        led_km=sum(leg.led_m for leg in legs) / 1000,
        followed_km=sum(leg.followed_m for leg in legs) / 1000,
        planned_platooned_km=sum(cycle.planned_platooned_m for cycle in cycles) / 1000,
        planned_drafting_kwh=sum(cycle.planned_drafting_kwh for cycle in cycles),
        missed_km={
            cause: sum(leg.missed_m.get(cause, 0.0) for leg in legs) / 1000 for cause in CAUSES
        },
        stops=sum(leg.stops for leg in legs),
        waited_h=sum(leg.waited_s for leg in legs) / 3600,
        orders=len(result.services),
        served_orders=frozenset(s.order for s in result.services if s.begun_s is not None),
        late=sum(
            (max(result.end_s, result.ended_s) if service.begun_s is None else service.begun_s)
            > service.latest_s
            for service in result.services
        ),
        cycles=len(cycles),
        planned_kwh=sum(cycle.planned_kwh for cycle in cycles),
        watched=sum(cycle.watched for cycle in cycles),
        judged=sum(cycle.judged for cycle in cycles),
        open=sum(cycle.open for cycle in cycles),
        open_turbulent=sum(cycle.open_turbulent for cycle in cycles),
        disengagements=result.disengagements,
        turbulent_s=sum(leg.turbulent_s for leg in legs),
        others=result.others,
        unfinished=result.unfinished,
        teleports=result.teleports,
        collisions=result.collisions,
        emergency_stops=result.emergency_stops,
        safety=result.safety,
        faults=faults(result),
        law=law,
    )


def faults(result: ArmResult) -> tuple[str, ...]:
    """Faults that make an arm invalid: gridlock, collisions, emergency stops and teleports of the
    fleet, an order that was served twice. Others' make none: no energy of theirs is measured.
    """
    found, own = [], result.safety
    if result.gridlock_s is not None:
        found.append(f"gridlock at {clock(result.gridlock_s)}")
    for count, what in (
        (own.collisions, "collision% of the fleet"),
        (own.emergency_stops, "emergency stop% of the fleet"),
        (own.teleports, "teleport% of the fleet"),
        (result.served_again, "second service%"),
    ):
        if count > 0:
            found.append(f"{count} {what.replace('%', 's' if count > 1 else '')}")
    if not any(service.begun_s is not None for service in result.services) or not result.legs:
        found.append("no order was served")
    return tuple(found)
