"""The result of an arm of the closed loop: plain data, the same for the same seed."""

from __future__ import annotations

from dataclasses import dataclass

from simulation.closed_loop.losses import Losses
from slipstream.energy import Energy


@dataclass(frozen=True)
class DrivenLeg:
    """One driven leg of a tour, from rest at one place to rest at the next.

    Attributes:
        vehicle: of the fleet.
        round: number of the tour in the vehicle's day, from 0.
        leg: number of the leg in the tour, from 0.
        ready_s: when it could have left: its plan was made, or the delivery before it was done; s
            since midnight.
        due_s: when it should have left by the plan.
        departed_s: when it came onto the road.
        arrived_s: when it stood at the next place.
        free_s: what the leg takes at the limit on an empty road, as the dispatcher plans it.
        distance_m: driven.
        driven: energy with the drag reductions that it had.
        alone: energy of the same speeds without any.
        led_m: distance as a platoon's leader.
        followed_m: distance as a follower.
        stops: on the road, without the arrival.
        waited_s: time below 0.1 m/s on the road.
        turbulent_s: time in a close gap, leaving included, on a segment whose true traffic was
            turbulent.
        path: its segments.
        losses: where the energy of `alone` went.
    """

    vehicle: str
    round: int
    leg: int
    ready_s: float
    due_s: float
    departed_s: float
    arrived_s: float
    free_s: float
    distance_m: float
    driven: Energy
    alone: Energy
    led_m: float
    followed_m: float
    stops: int
    waited_s: float
    turbulent_s: float
    path: tuple[str, ...]
    losses: Losses

    @property
    def travel_s(self) -> float:
        """From when it could have left to the arrival: waiting for others to meet counts, and
        waiting to get onto the road.
        """
        return self.arrived_s - self.ready_s


@dataclass(frozen=True)
class Service:
    """One order: when it was due and when its service began; None: never in this day."""

    order: str
    latest_s: float
    begun_s: float | None


@dataclass(frozen=True)
class CycleRecord:
    """One dispatch cycle.

    Attributes:
        time_s: since midnight.
        status: of its report.
        vehicles: sent.
        planned_kwh: energy of its plans, as the dispatcher expects it.
        planned_platooned_m: distance in platoons, as planned.
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
        end_s: simulated.
        legs: in the order of arrival.
        services: one an order that was released.
        cycles: those that had something to plan.
        others: the background.
        disengagements: of platoons, because the true traffic around them was turbulent.
        teleports: SUMO's counts of the whole run, collisions and emergency stops likewise.
        collisions: at least one vehicle ran into another.
        emergency_stops: brakings above the vehicle's emergency deceleration.
        gridlock_s: when most vehicles had stood for long; None: never.
        unfinished: vehicles of the fleet still on the road at the end.
    """

    scenario: str
    seed: int
    policy: str
    begin_s: float
    end_s: float
    legs: tuple[DrivenLeg, ...]
    services: tuple[Service, ...]
    cycles: tuple[CycleRecord, ...]
    others: Others
    disengagements: int
    teleports: int
    collisions: int
    emergency_stops: int
    gridlock_s: float | None
    unfinished: int
