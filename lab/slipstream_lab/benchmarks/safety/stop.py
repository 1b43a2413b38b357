"""One emergency stop of a platoon behind traffic that brakes as hard as it can."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from slipstream.braking import BRAKING, HARDEST_MPS2, BrakingClass, Road
from slipstream.messages import SensedVehicle, VehicleSensing
from slipstream_lab.benchmarks.safety.vehicle import (
    INTERVAL_S,
    LENGTH_M,
    STEP_S,
    VALID_S,
    Body,
    Vehicle,
    road,
)

_BEGIN_NS: Final = 1_000_000_000_000
_FORMED_S: Final = 5.0
_STANDS_MPS: Final = 0.05


@dataclass(frozen=True)
class Fault:
    """What fails at a moment: an agent, the router (all messages), or a vehicle's sensing."""

    kind: str
    at_s: float
    vehicle: int = 0


@dataclass(frozen=True)
class Case:
    """A stop.

    Attributes:
        classes: of the vehicles, front to back.
        traffic_gap: share of the gap that the leader needs at which the traffic ahead drives.
        traffic_mps2: deceleration of the traffic; None: it goes on.
        to_mps: speed that it brakes to.
        loss: share of messages that get lost, for each receiver anew.
        latency_s: of a message.
        unsensed: share of samples of the own sensing that get lost.
        gap_noise_m: standard deviation of a sensed gap.
        speed_noise_mps: of a sensed speed.
        corner: share of the vehicles' values at an end of their tolerance.
    """

    speed_mps: float
    classes: tuple[BrakingClass, ...]
    road: Road
    seed: int
    traffic_mps2: float | None
    to_mps: float = 0.0
    loss: float = 0.0
    latency_s: float = 0.02
    unsensed: float = 0.0
    gap_noise_m: float = 0.03
    speed_noise_mps: float = 0.05
    corner: float = 0.5
    brakes_s: float = _FORMED_S
    fault: Fault | None = None


@dataclass(frozen=True)
class Outcome:
    """Of one stop.

    Attributes:
        formed: vehicles that were in a close gap when the traffic braked.
        gaps_m: theirs then.
        least_m: least gap of each follower.
        hardest_mps2: hardest deceleration of each vehicle.
        traffic_m: least gap of the leader to the traffic ahead.
        impact_mps: largest difference of speeds at a collision; 0: there was none.
        seconds: until all stood.
    """

    formed: int
    gaps_m: tuple[float, ...]
    least_m: tuple[float, ...]
    hardest_mps2: tuple[float, ...]
    traffic_m: float
    impact_mps: float
    before_mps2: float = 0.0


class _Gates:
    def is_open(self, segment: str) -> bool:
        return True

    def is_turbulent(self, segment: str) -> bool:
        return False


def drive(case: Case, watch: Callable[[float, list[Vehicle]], None] | None = None) -> Outcome:
    """Drive one case."""
    rng = random.Random(case.seed)
    leg, gates = road(case.speed_mps), _Gates()
    brakes = [BRAKING[name].on(case.road) for name in case.classes]
    others = HARDEST_MPS2[case.road]
    count, gap_m = len(brakes), 2.5
    cars = [
        Vehicle(
            f"v{i}",
            Body.drawn(brakes[i], rng, case.corner),
            brakes[i],
            leg,
            100.0 + (count - 1 - i) * (gap_m + LENGTH_M),
            case.speed_mps,
            others,
            rng.randrange(round(INTERVAL_S / STEP_S)) * STEP_S,
        )
        for i in range(count)
    ]
    fault = case.fault
    if fault is not None and fault.kind == "agent":
        cars[fault.vehicle].agent_dies_s = fault.at_s
    traffic_m, traffic_mps = 0.0, case.speed_mps
    traffic_on = False
    waiting: list[tuple[float, int, int, object]] = []
    number = 0
    least = [float("inf")] * count
    impact, formed, gaps = 0.0, 0, ()
    traffic_least = float("inf")
    touched = [False] * count
    before = 0.0
    end_s = case.brakes_s + 60.0
    step = 0
    last: list[tuple[float, VehicleSensing, object] | None] = [None] * count
    while (now_s := step * STEP_S) < end_s:
        if not traffic_on and now_s >= case.brakes_s:
            traffic_on = True
            s = cars[0].platooning
            limit = s.limit_mps2 or brakes[0].guaranteed_mps2
            from slipstream.spacing import closing_m, reaction_s

            error = brakes[0].error
            needed = 0.6 + closing_m(
                case.speed_mps,
                case.speed_mps,
                others,
                limit / (1 + error) * (1 - error),
                reaction_s(brakes[0]) + 0.3,
            )
            traffic_m = cars[0].place_m + LENGTH_M + needed
            traffic_mps = cars[0].speed_mps
            formed = sum(car.mode == "following" for car in cars)
            gaps = tuple(cars[i - 1].place_m - LENGTH_M - cars[i].place_m for i in range(1, count))
            before = min(car.hardest_mps2 for car in cars)
            for car in cars:
                car.hardest_mps2 = 0.0
        now_ns = _BEGIN_NS + round(now_s * 1e9)
        while waiting and waiting[0][0] <= now_s + 1e-9:
            _, _, to, message = heapq.heappop(waiting)
            if now_s < cars[to].agent_dies_s:
                cars[to].platooning.receive(message, now_ns)  # type: ignore[arg-type]
        for i, car in enumerate(cars):
            since = (now_s - car.phase_s) / INTERVAL_S
            if abs(since - round(since)) > 1e-6 or since < -1e-6 or now_s >= car.agent_dies_s:
                continue
            ahead = None
            if i > 0 or traffic_on:
                front_m = cars[i - 1].place_m if i else traffic_m
                front_mps = cars[i - 1].speed_mps if i else traffic_mps
                ahead = SensedVehicle(
                    track=f"v{i - 1}" if i else "t",
                    vehicle=f"v{i - 1}" if i else None,
                    gap_m=front_m - LENGTH_M - car.place_m + rng.gauss(0, case.gap_noise_m),
                    speed_mps=max(0.0, front_mps + rng.gauss(0, case.speed_noise_mps)),
                )
            behind = None
            if i + 1 < count:
                behind = SensedVehicle(
                    track=f"v{i + 1}",
                    vehicle=f"v{i + 1}",
                    gap_m=car.place_m - LENGTH_M - cars[i + 1].place_m,
                    speed_mps=cars[i + 1].speed_mps,
                )
            state = car.state(car.place_m, car.speed_mps, car.acceleration_mps2)
            lost = rng.random() < case.unsensed
            blind = fault is not None and fault.kind == "sensor" and fault.vehicle == i
            if (blind and fault is not None and now_s >= fault.at_s) or (lost and last[i]):
                seen = last[i]
                assert seen is not None
                _, sensing, state0 = seen
                state = state0  # type: ignore[assignment]
            else:
                sensing = VehicleSensing(
                    vehicle=car.name,
                    time_ns=now_ns,
                    on_road=True,
                    segment=state.segment,
                    crossing=False,
                    lane=0,
                    front_m=state.front_m,
                    speed_mps=car.speed_mps,
                    acceleration_mps2=car.acceleration_mps2,
                    driven_m=0.0,
                    ahead=ahead,
                    behind=behind,
                )
                last[i] = (now_s, sensing, state)
            result = car.platooning.step(now_ns, leg, state, sensing, gates)
            car.mode = result.mode
            if result.acceleration_mps2 is not None:
                car.advised = (result.acceleration_mps2, now_s + VALID_S)
            elif i == 0:
                car.advised = None
            dead = fault is not None and fault.kind == "router" and now_s >= fault.at_s
            if dead:
                continue
            for j in range(count):
                if j != i and rng.random() >= case.loss:
                    number += 1
                    heapq.heappush(waiting, (now_s + case.latency_s, number, j, result.control))
            for message in result.messages:
                number += 1
                to = int(message.partner[1:])
                heapq.heappush(waiting, (now_s + case.latency_s, number, to, message))
        for i, car in enumerate(cars):
            front_m = cars[i - 1].place_m if i else traffic_m
            front_mps = cars[i - 1].speed_mps if i else traffic_mps
            car.move(now_s, front_m - LENGTH_M - car.place_m, front_mps)
        if traffic_on:
            if case.traffic_mps2 is not None:
                old = traffic_mps
                traffic_mps = max(min(case.to_mps, old), old - case.traffic_mps2 * STEP_S)
                traffic_m += (old + traffic_mps) / 2 * STEP_S
            else:
                traffic_m += traffic_mps * STEP_S
            traffic_least = min(traffic_least, traffic_m - LENGTH_M - cars[0].place_m)
            for i in range(1, count):
                gap = cars[i - 1].place_m - LENGTH_M - cars[i].place_m
                least[i] = min(least[i], gap)
                if gap <= 0 and not touched[i]:
                    touched[i] = True
                    impact = max(impact, cars[i].speed_mps - cars[i - 1].speed_mps)
            if all(car.speed_mps < _STANDS_MPS for car in cars):
                break
        if watch is not None:
            watch(now_s, cars)
        step += 1
    return Outcome(
        formed,
        gaps,
        tuple(least[1:]),
        tuple(car.hardest_mps2 for car in cars),
        traffic_least,
        impact,
        before,
    )
