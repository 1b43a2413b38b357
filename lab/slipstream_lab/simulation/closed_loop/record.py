"""The result of an arm of the closed loop: plain data, the same for the same seed."""

from __future__ import annotations

from dataclasses import dataclass

from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg
from slipstream_lab.simulation.fleet.safety import NOTHING, FleetSafety


@dataclass(frozen=True)
class OrderService:
    """One order: when it was due and when its service began; None: never in this day."""

    order: str
    latest_s: float
    begun_s: float | None


@dataclass(frozen=True)
class LoopCycleRecord:
    """One dispatch cycle."""

    time_s: float
    status: str
    vehicles: int
    planned_kwh: float
    planned_platooned_m: float
    planned_drafting_kwh: float
    open: int
    judged: int
    watched: int
    open_turbulent: int


@dataclass(frozen=True)
class Others:
    """The background's trips that ended: the fleet's effect on other traffic. `trips`: all that
    came onto the road.
    """

    arrived: int
    duration_s: float
    time_loss_s: float
    stops: float
    trips: int


@dataclass(frozen=True)
class ArmResult:
    """One arm of one seed.

    Attributes:
        end_s: orders were released until then; earlier after a gridlock.
        teleports: SUMO's counts of the whole run, of all vehicles; collisions and emergency stops
            likewise.
        safety: the fleet's part of them.
        gridlock_s: when most vehicles had stood for long; None: never.
    """

    scenario: str
    seed: int
    policy: str
    begin_s: float
    end_s: float
    legs: tuple[DrivenLeg, ...]
    services: tuple[OrderService, ...]
    cycles: tuple[LoopCycleRecord, ...]
    others: Others
    disengagements: int
    teleports: int
    collisions: int
    emergency_stops: int
    gridlock_s: float | None
    unfinished: int
    served_again: int = 0
    ended_s: float = 0.0
    watched: tuple[str, ...] = ()
    opened: tuple[str, ...] = ()
    safety: FleetSafety = NOTHING
