"""One emergency stop of a platoon behind traffic that brakes as hard as it can."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

from slipstream.braking import BRAKING, HARDEST_MPS2, BrakingClass, Road
from slipstream.messages import PlatoonControl, PlatoonManagement, SensedVehicle, VehicleSensing
from slipstream.spacing import STANDING_M, closing_m, reaction_s
from slipstream_lab.benchmarks.safety.vehicle import (
    INTERVAL_S,
    LENGTH_M,
    STEP_S,
    Vehicle,
    road,
)
from slipstream_lab.simulation.fleet.brakes import Brakes
from vehicle_agent.leg import VehicleState
from vehicle_agent.platooning import DELAY_S

BEGIN_NS: Final = 1_000_000_000_000
BRAKES_S: Final = 5.0
"""When the traffic brakes; until then the platoon has formed."""

_LONGEST_S: Final = 40.0
_STANDS_MPS: Final = 0.05

FaultKind = Literal["agent", "router", "sensor"]


@dataclass(frozen=True)
class Fault:
    """What ends at a moment: an agent, all messages, or a vehicle's sensing for its agent."""

    kind: FaultKind
    at_s: float
    vehicle: int = 0


@dataclass(frozen=True)
class Case:
    """A stop.

    Attributes:
        classes: of the vehicles, front to back.
        declared: class that all of them are declared as; None: each as it is.
        traffic_mps2: deceleration of the traffic.
        to_mps: speed that it brakes to.
        loss: share of the messages that are lost, for each receiver anew.
        latency_s: of a message.
        unsensed: share of the samples of the own sensing that are lost.
        gap_noise_m: standard deviation of a sensed gap.
        speed_noise_mps: of a sensed speed.
        corner: share of the vehicles' values at an end of their tolerance.
        segment_m: length of each of the road's ten segments.
    """

    speed_mps: float
    classes: tuple[BrakingClass, ...]
    road: Road
    seed: int
    traffic_mps2: float
    to_mps: float = 0.0
    loss: float = 0.0
    latency_s: float = 0.02
    unsensed: float = 0.0
    gap_noise_m: float = 0.03
    speed_noise_mps: float = 0.05
    corner: float = 0.5
    segment_m: float = 1000.0
    fault: Fault | None = None
    declared: BrakingClass | None = None


@dataclass(frozen=True)
class Outcome:
    """Of one stop.

    Attributes:
        followers: vehicles that followed when the traffic braked.
        gaps_m: of the followers then.
        least_m: least gap of each since.
        hardest_mps2: lowest acceleration of each vehicle since.
        traffic_m: least gap of the leader to the traffic.
        impact_mps: largest difference of speeds at a collision; 0: there was none.
        promised_mps2: what the leader had promised.
    """

    followers: int
    gaps_m: tuple[float, ...]
    least_m: tuple[float, ...]
    hardest_mps2: tuple[float, ...]
    traffic_m: float
    impact_mps: float
    promised_mps2: float | None


class _OpenGates:
    def is_open(self, segment: str) -> bool:
        return True

    def is_turbulent(self, segment: str) -> bool:
        return False


Watch = Callable[[float, list[Vehicle]], None]


def drive(case: Case, watch: Watch | None = None) -> Outcome:
    """Drive one case; `watch` sees each step."""
    return Run(case).drive(watch)


class Run:
    """The vehicles of a case, and what goes between them."""

    vehicles: type[Vehicle] = Vehicle

    def __init__(self, case: Case) -> None:
        self.case, self.rng = case, random.Random(case.seed)
        brakes = [BRAKING[name].on(case.road) for name in case.classes]
        self.others_mps2, count = HARDEST_MPS2[case.road], len(brakes)
        self.leg, self.gates = road(case.speed_mps, case.segment_m), _OpenGates()
        self.cars = [
            self.vehicles(
                f"v{i}",
                Brakes.drawn(own, self.rng, case.corner),
                own if case.declared is None else BRAKING[case.declared].on(case.road),
                self.leg,
                100.0 + (count - 1 - i) * (2.5 + LENGTH_M),
                case.speed_mps,
                self.others_mps2,
                self.rng.randrange(round(INTERVAL_S / STEP_S)) * STEP_S,
            )
            for i, own in enumerate(brakes)
        ]
        fault = case.fault
        if fault is not None and fault.kind == "agent":
            self.cars[fault.vehicle].agent_ends_s = fault.at_s
        self.traffic: tuple[float, float] | None = None
        self.waiting: list[tuple[float, int, int, PlatoonControl | PlatoonManagement]] = []
        self.samples: list[tuple[VehicleState, VehicleSensing] | None] = [None] * count
        self.sent = 0

    def drive(self, watch: Watch | None) -> Outcome:
        """Until all have come to where the traffic has braked to."""
        cars, followers = self.cars, 0
        gaps: tuple[float, ...] = ()
        promised: float | None = None
        least = [float("inf")] * (len(cars) - 1)
        traffic_m, impact, step = float("inf"), 0.0, 0
        while (now_s := step * STEP_S) < _LONGEST_S:
            if self.traffic is None and now_s >= BRAKES_S:
                self._meet_traffic()
                followers = sum(car.mode == "following" for car in cars)
                gaps, promised = self._gaps(), cars[0].platooning.limit_mps2
                for car in cars:
                    car.hardest_mps2 = 0.0
            self._step(now_s)
            if self.traffic is not None:
                traffic_m = min(traffic_m, self.traffic[0] - LENGTH_M - cars[0].place_m)
                for number, gap_m in enumerate(self._gaps()):
                    if gap_m <= 0 < least[number]:
                        faster = cars[number + 1].speed_mps - cars[number].speed_mps
                        impact = max(impact, faster, 1e-3)
                    least[number] = min(least[number], gap_m)
                if self._has_ended():
                    break
            if watch is not None:
                watch(now_s, cars)
            step += 1
        hardest = tuple(car.hardest_mps2 for car in cars)
        return Outcome(followers, gaps, tuple(least), hardest, traffic_m, impact, promised)

    def _step(self, now_s: float) -> None:
        """One step of messages, agents, vehicles and the traffic."""
        self._deliver(now_s)
        for number in range(len(self.cars)):
            self._advise(number, now_s)
        for number, car in enumerate(self.cars):
            ahead = self._ahead(number)
            car.move(now_s, *((1e9, car.speed_mps) if ahead is None else ahead))
        if self.traffic is not None:
            self._brake_traffic()

    def _has_ended(self) -> bool:
        """Whether all have come to where the traffic has braked to."""
        to_mps = self.case.to_mps
        if to_mps >= self.case.speed_mps:
            return False
        enough_mps = to_mps + 0.5 if to_mps > 0 else _STANDS_MPS
        return all(car.speed_mps <= enough_mps for car in self.cars)

    def _gaps(self) -> tuple[float, ...]:
        places = [car.place_m for car in self.cars]
        return tuple(ahead - LENGTH_M - behind for ahead, behind in pairwise(places))

    def _meet_traffic(self) -> None:
        """Traffic ahead, as near as the leader may have it."""
        leader, own = self.cars[0], self.cars[0].braking
        limit = leader.platooning.limit_mps2 or own.guaranteed_mps2
        limit = own.commanded_mps2(limit) * (1 - own.error)
        v, rho_s = leader.speed_mps, reaction_s(own) + DELAY_S
        gap_m = STANDING_M + 0.1 + closing_m(v, v, self.others_mps2, limit, rho_s)
        self.traffic = leader.place_m + LENGTH_M + gap_m, v

    def _brake_traffic(self) -> None:
        assert self.traffic is not None
        place_m, before = self.traffic
        after = max(min(self.case.to_mps, before), before - self.case.traffic_mps2 * STEP_S)
        self.traffic = place_m + (before + after) / 2 * STEP_S, after

    def _ahead(self, number: int) -> tuple[float, float] | None:
        """Gap and speed of the vehicle ahead."""
        own = self.cars[number].place_m
        if number:
            front = self.cars[number - 1]
            return front.place_m - LENGTH_M - own, front.speed_mps
        return None if self.traffic is None else (self.traffic[0] - LENGTH_M - own, self.traffic[1])

    def _deliver(self, now_s: float) -> None:
        now_ns = BEGIN_NS + round(now_s * 1e9)
        while self.waiting and self.waiting[0][0] <= now_s + 1e-9:
            _, _, to, message = heapq.heappop(self.waiting)
            if now_s < self.cars[to].agent_ends_s:
                self.cars[to].platooning.receive(message, now_ns)

    def _advise(self, number: int, now_s: float) -> None:
        car, intervals = self.cars[number], (now_s - self.cars[number].phase_s) / INTERVAL_S
        if abs(intervals - round(intervals)) > 1e-6 or intervals < -1e-6:
            return
        if now_s >= car.agent_ends_s:
            return
        now_ns = BEGIN_NS + round(now_s * 1e9)
        state, sensing = self._sense(number, now_s, now_ns)
        step = car.platooning.step(now_ns, self.leg, state, sensing, self.gates)
        car.take(step, now_s)
        fault = self.case.fault
        if fault is not None and fault.kind == "router" and now_s >= fault.at_s:
            return
        self._publish(number, now_s, step.control, step.messages)

    def _publish(
        self,
        number: int,
        now_s: float,
        control: PlatoonControl,
        messages: Iterable[PlatoonManagement],
    ) -> None:
        for other in range(len(self.cars)):
            if other != number:
                self._send(now_s, other, control)
        for message in messages:
            self._send(now_s, int(message.partner[1:]), message)

    def _send(self, now_s: float, to: int, message: PlatoonControl | PlatoonManagement) -> None:
        if self.rng.random() >= self.case.loss:
            self.sent += 1
            heapq.heappush(self.waiting, (now_s + self.case.latency_s, self.sent, to, message))

    def _sense(self, number: int, now_s: float, now_ns: int) -> tuple[VehicleState, VehicleSensing]:
        """A new sample, or the last one where it is lost."""
        case, car, last, fault = self.case, self.cars[number], self.samples[number], self.case.fault
        blind = fault is not None and fault.kind == "sensor" and fault.vehicle == number
        lost = self.rng.random() < case.unsensed
        if last is not None and (lost or (blind and fault and now_s >= fault.at_s)):
            return last
        ahead, behind = None, None
        seen = self._ahead(number)
        if seen is not None:
            ahead = SensedVehicle(
                track=f"v{number - 1}",
                vehicle=f"v{number - 1}" if number else None,
                gap_m=seen[0] + self.rng.gauss(0, case.gap_noise_m),
                speed_mps=max(0.0, seen[1] + self.rng.gauss(0, case.speed_noise_mps)),
            )
        if number + 1 < len(self.cars):
            name, follower = f"v{number + 1}", self.cars[number + 1]
            behind = SensedVehicle(
                track=name,
                vehicle=name,
                gap_m=car.place_m - LENGTH_M - follower.place_m,
                speed_mps=follower.speed_mps,
            )
        self.samples[number] = car.state(), car.sensing(now_ns, ahead, behind)
        found = self.samples[number]
        assert found is not None
        return found
