"""Vehicles on one lane of one road, each with its own platooning; messages late and lost."""

from __future__ import annotations

import math
import random
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from slipstream.braking import BRAKING, Braking
from slipstream.energy.consumption import PAPER_CAR, VehicleParameters
from slipstream.energy.drafting import DragLaw
from slipstream.messages import (
    PlannedSegment,
    PlatoonControl,
    PlatoonManagement,
    SensedVehicle,
    VehicleSensing,
)
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import OwnVehicle, Platooning, PlatoonStep
from vehicle_agent.platooning.gap_control import IDM, Own

LENGTH_M = 4.6
IDEAL = BRAKING["ideal"].on("dry")
BEGIN_NS = 1_000_000_000_000


def planned(
    segment: str,
    length_m: float = 1000.0,
    limit_mps: float = 30.0,
    platoon: str | None = None,
    place: int | None = None,
    lanes: int = 1,
) -> PlannedSegment:
    """A segment of a plan."""
    return PlannedSegment(
        segment=segment,
        entry_ns=0,
        exit_ns=0,
        speed_mps=limit_mps,
        platoon=platoon,
        place=place,
        gap_m=1.5 if place else None,
        leg=0,
        length_m=length_m,
        speed_limit_mps=limit_mps,
        lanes=lanes,
    )


def road(
    names: str = "abcdefghij", length_m: float = 1000.0, limit_mps: float = 30.0, **plan: object
) -> Leg:
    """A leg on segments with names of one letter."""
    return Leg(1, 0, tuple(planned(n, length_m, limit_mps, **plan) for n in names))  # type: ignore[arg-type]


def platooning_of(
    interval_s: float,
    drafting: DragLaw = "paper",
    pace: float = 1.0,
    vehicle: VehicleParameters = PAPER_CAR,
    name: str = "me",
    braking: Braking = IDEAL,
) -> Platooning:
    """Of a vehicle whose brakes are ideal, unless told otherwise."""
    own = OwnVehicle(vehicle, braking, 9.0, interval_s, pace, drafting)
    return Platooning(name, LENGTH_M, own)


@dataclass
class Roadside:
    """Gates by segment."""

    closed: set[str] = field(default_factory=set)
    turbulent: set[str] = field(default_factory=set)

    def is_open(self, segment: str) -> bool:
        """Open unless closed."""
        return segment not in self.closed

    def is_turbulent(self, segment: str) -> bool:
        """As told."""
        return segment in self.turbulent


@dataclass
class Car:
    """A vehicle; with a script it drives so, and tells what it will drive.

    Attributes:
        name: None in `vehicle` of those who sense it, unless it is of the fleet.
        place_m: of its front on the road.
        speed_mps: now.
        leg: its road; all begin at the same place.
        script: speed at a time, s; None: platooning, and the IDM while it drives alone.
        fleet: whether it has an agent and messages.
        promises_mps2: limit of braking that a script promises; None: none.
    """

    name: str
    place_m: float
    speed_mps: float
    leg: Leg
    script: Callable[[float], float] | None = None
    fleet: bool = True
    acceleration_mps2: float = 0.0
    platooning: Platooning | None = None
    last: PlatoonStep | None = None
    silent: bool = False
    promises_mps2: float | None = None
    sequence: int = 0
    samples: list[tuple[VehicleState, VehicleSensing]] = field(default_factory=list)

    def state(self) -> VehicleState:
        """Where it is on its leg."""
        number = bisect_right(self.leg.begins_m, self.place_m) - 1
        front_m = self.place_m - self.leg.begins_m[number]
        return VehicleState(
            self.leg.path[number], number, False, 0, front_m, self.speed_mps, self.acceleration_mps2
        )


@dataclass
class World:
    """Steps of all vehicles, front to back.

    Attributes:
        cars: front to back.
        interval_s: of control and messages.
        delayed: messages come one interval late; else within the step to those behind.
        loss: share of messages that get lost, for each receiver anew.
        unsensed: share of samples of the own sensing that get lost: the one before is used again.
        latency: steps by which sensing is late.
        gates: of segments.
    """

    cars: list[Car]
    interval_s: float = 0.1
    delayed: bool = True
    loss: float = 0.0
    unsensed: float = 0.0
    latency: int = 0
    gates: Roadside = field(default_factory=Roadside)
    seed: int = 1
    steps: int = 0
    speeds: dict[str, list[float]] = field(default_factory=dict)
    gaps: dict[str, list[float]] = field(default_factory=dict)
    modes: dict[str, list[str]] = field(default_factory=dict)
    _waiting: list[PlatoonControl | PlatoonManagement] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)
        for car in self.cars:
            if car.fleet and car.script is None:
                car.platooning = platooning_of(self.interval_s, name=car.name)

    @property
    def now_ns(self) -> int:
        """By everybody's clock."""
        return BEGIN_NS + round(self.steps * self.interval_s * 1e9)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Go on for a time, or until something holds; whether it did."""
        for _ in range(round(seconds / self.interval_s)):
            if until():
                return True
            self.step()
        return until()

    def car(self, name: str) -> Car:
        """By name."""
        return next(car for car in self.cars if car.name == name)

    def gap_m(self, name: str) -> float:
        """To the vehicle ahead; infinite for the first."""
        number = self.cars.index(self.car(name))
        if number == 0:
            return math.inf
        return self.cars[number - 1].place_m - LENGTH_M - self.cars[number].place_m

    def step(self) -> None:
        """One interval."""
        now_ns, dt = self.now_ns, self.interval_s
        waiting, self._waiting = self._waiting, []
        for message in waiting:
            self._deliver(message)
        commands = []
        for number, car in enumerate(self.cars):
            ahead = self.cars[number - 1] if number else None
            coming, told = self._drive(car, ahead, now_ns)
            commands.append(coming)
            for message in told:
                # Those ahead have had their step and hear it in their next one.
                receivers = [] if self.delayed else self.cars[number + 1 :]
                self._deliver(message, receivers)
                self._waiting.append(message)
            self.modes.setdefault(car.name, []).append(car.last.mode if car.last else "alone")
        for car, coming in zip(self.cars, commands, strict=True):
            car.acceleration_mps2 = (coming - car.speed_mps) / dt
            car.speed_mps = coming
            car.place_m += coming * dt
        for car in self.cars:
            self.speeds.setdefault(car.name, []).append(car.speed_mps)
            self.gaps.setdefault(car.name, []).append(self.gap_m(car.name))
        self.steps += 1

    def _deliver(
        self, message: PlatoonControl | PlatoonManagement, to: Sequence[Car] | None = None
    ) -> None:
        for car in self.cars if to is None else to:
            if car.platooning is not None and self._random.random() >= self.loss:
                car.platooning.receive(message, self.now_ns)

    def _drive(
        self, car: Car, ahead: Car | None, now_ns: int
    ) -> tuple[float, list[PlatoonControl | PlatoonManagement]]:
        dt, state = self.interval_s, car.state()
        if car.script is not None:
            coming = max(0.0, car.script((self.steps + 1) * dt))
            told = [self._scripted(car, state, coming, now_ns)] if car.fleet else []
            return coming, [] if car.silent else [*told]
        assert car.platooning is not None
        if not (car.samples and self.unsensed and self._random.random() < self.unsensed):
            car.samples.append((state, self.sensing(car, ahead)))
        seen, sensing = car.samples[max(0, len(car.samples) - 1 - self.latency)]
        step = car.platooning.step(now_ns, car.leg, seen, sensing, self.gates)
        car.last = step
        messages = [] if car.silent else [step.control, *step.messages]
        commanded = step.lead_mps if step.speed_mps is None else step.speed_mps
        if commanded is not None:
            return max(commanded, car.speed_mps - 9.0 * dt), messages
        limit = car.leg.limits_mps[state.number]
        desired = limit if step.cruise_mps is None else step.cruise_mps
        own = Own(car.speed_mps, limit, desired, 1.5, dt, PAPER_CAR, IDEAL)
        if ahead is None:
            a = IDM.acceleration_to_mps2(own, 1e9, 0.0)
        else:
            a = IDM.acceleration_to_mps2(own, self.gap_m(car.name), ahead.speed_mps)
        a = min(max(a, -9.0), IDM.acceleration_mps2)
        return max(0.0, car.speed_mps + a * dt), messages

    def sensing(self, car: Car, ahead: Car | None) -> VehicleSensing:
        """What its own sensors measure, without error."""
        state, seen = car.state(), None
        if ahead is not None and self.gap_m(car.name) < 120.0:
            seen = SensedVehicle(
                track=ahead.name,
                vehicle=ahead.name if ahead.fleet else None,
                gap_m=self.gap_m(car.name),
                speed_mps=ahead.speed_mps,
            )
        return VehicleSensing(
            vehicle=car.name,
            time_ns=self.now_ns,
            on_road=True,
            segment=state.segment,
            crossing=False,
            lane=0,
            front_m=state.front_m,
            speed_mps=state.speed_mps,
            acceleration_mps2=state.acceleration_mps2,
            driven_m=0.0,
            ahead=seen,
            behind=None,
        )

    def _planned(self, car: Car, coming: float) -> tuple[float, ...]:
        """Of the next interval; who promises tells three more."""
        assert car.script is not None
        dt, now_s = self.interval_s, self.steps * self.interval_s
        later = [max(0.0, car.script(now_s + k * dt)) for k in range(2, 5)]
        speeds = [car.speed_mps, coming, *(later if car.promises_mps2 is not None else [])]
        return tuple((b - a) / dt for a, b in pairwise(speeds))

    def _scripted(
        self, car: Car, state: VehicleState, coming: float, now_ns: int
    ) -> PlatoonControl:
        car.sequence += 1
        here = car.leg.planned[state.number]
        return PlatoonControl(
            vehicle=car.name,
            sequence=car.sequence,
            time_ns=now_ns,
            path=car.leg.path[state.number :],
            crossing=False,
            lane=0,
            front_m=state.front_m,
            length_m=LENGTH_M,
            speed_mps=car.speed_mps,
            acceleration_mps2=car.acceleration_mps2,
            announced_mps=coming,
            planned_mps2=self._planned(car, coming),
            limit_mps2=car.promises_mps2,
            greatest_mps2=9.0,
            desired_mps=30.0,
            mode="alone",
            ahead=None,
            leader=car.name,
            joined_by=None,
            tail_m=LENGTH_M,
            platoon=here.platoon,
            place=here.place,
        )


def string(
    count: int,
    script: Callable[[float], float] | None,
    gap_m: float,
    speed_mps: float,
    leg: Leg | None = None,
) -> list[Car]:
    """Vehicles v0, v1, ... front to back, with equal gaps; the first one drives by the script."""
    leg = road() if leg is None else leg
    front_m = 100.0 + (count - 1) * (gap_m + LENGTH_M)
    return [
        Car(
            f"v{i}",
            front_m - i * (gap_m + LENGTH_M),
            speed_mps,
            leg,
            script if i == 0 else None,
        )
        for i in range(count)
    ]


def sensing_of(
    state: VehicleState, ahead: SensedVehicle | None, time_ns: int, acceleration: float = 0.0
) -> VehicleSensing:
    """Of a vehicle in that state."""
    return VehicleSensing(
        vehicle="me",
        time_ns=time_ns,
        on_road=True,
        segment=state.segment,
        crossing=state.crossing,
        lane=state.lane,
        front_m=state.front_m,
        speed_mps=state.speed_mps,
        acceleration_mps2=acceleration,
        driven_m=0.0,
        ahead=ahead,
        behind=None,
    )


def told(
    now_ns: int, sequence: int, front_m: float, speed: float, announced: float
) -> PlatoonControl:
    """A partner ahead that can be followed."""
    return PlatoonControl(
        vehicle="p",
        sequence=sequence,
        time_ns=now_ns,
        path=("a", "b", "c"),
        crossing=False,
        lane=0,
        front_m=front_m,
        length_m=4.6,
        speed_mps=speed,
        acceleration_mps2=0.0,
        announced_mps=announced,
        desired_mps=30.0,
        mode="alone",
        ahead=None,
        leader="p",
        joined_by=None,
        tail_m=4.6,
    )
