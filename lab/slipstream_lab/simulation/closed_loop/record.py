"""The result of an arm of the closed loop: plain data, the same for the same seed."""

from __future__ import annotations

from dataclasses import dataclass

from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg


@dataclass(frozen=True)
class Service:
    """One order: when it was due and when its service began; None: never in this day."""

    order: str
    latest_s: float
    begun_s: float | None


@dataclass(frozen=True)
class LoopCycleRecord:
    """One dispatch cycle.

    Attributes:
        time_s: since midnight.
        status: of its report.
        vehicles: sent.
        planned_kwh: energy of its plans, as the dispatcher expects it.
        planned_platooned_m: distance in platoons that its plans add to those before.
        planned_drafting_kwh: what drafting saves there, likewise.
        open: judged segments whose gate was open.
        judged: watched segments whose y_e was known.
        watched: segments that an RSU watches.
        open_turbulent: open gates of segments whose true traffic was turbulent.
    """

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
    """The background's trips that ended: the fleet's effect on other traffic.

    Attributes:
        arrived: trips.
        duration_s: mean, departure delay included.
        time_loss_s: mean, against driving as fast as they like.
        stops: mean number of times that they came to a stand.
    """

    arrived: int
    duration_s: float
    time_loss_s: float
    stops: float


@dataclass(frozen=True)
class ArmResult:
    """One arm of one seed.

    Attributes:
        scenario: its name.
        seed: of the day.
        policy: name of the arm.
        begin_s: simulated, s since midnight.
        end_s: orders were released until then; earlier after a gridlock.
        legs: in the order of arrival.
        services: one an order that was released.
        cycles: those that had something to plan.
        others: the background.
        disengagements: of platoons, because the true traffic around them was turbulent.
        teleports: SUMO's counts of the whole run, collisions and emergency stops likewise.
        collisions: at least one vehicle ran into another.
        emergency_stops: brakings above the vehicle's emergency deceleration.
        gridlock_s: when most vehicles had stood for long; None: never.
        unfinished: tours that had begun and not ended when the arm did.
        served_again: services of orders that had been served.
        ended_s: when everybody was at home, or the arm was given up.
        watched: segments that an RSU watches.
        opened: those of them whose gate was open at any time.
    """

    scenario: str
    seed: int
    policy: str
    begin_s: float
    end_s: float
    legs: tuple[DrivenLeg, ...]
    services: tuple[Service, ...]
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
