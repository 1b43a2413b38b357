"""A city on a grid, and a fleet that drives in it, made by hand: as large as a pilot's will be."""

from __future__ import annotations

import numpy as np

from dashboard.live import Snapshot
from slipstream.messages import PlannedSegment, PlannedStop, Unserved, VehiclePlan
from slipstream.roads import RoadNetwork, Segment, build_network

S = 1_000_000_000
SIDE = 23
BLOCK_M = 220.0


def grid_city() -> RoadNetwork:
    """2,024 directed streets between 529 crossings; every third street bends."""
    junctions = {f"x{x}y{y}": (BLOCK_M * x, BLOCK_M * y) for x in range(SIDE) for y in range(SIDE)}
    streets = []
    for x in range(SIDE):
        for y in range(SIDE):
            for other in ((x + 1, y), (x, y + 1)):
                if max(other) < SIDE:
                    here, there = f"x{x}y{y}", f"x{other[0]}y{other[1]}"
                    streets += [(here, there), (there, here)]
    segments = []
    for number, (start, end) in enumerate(streets):
        a, b = np.array(junctions[start]), np.array(junctions[end])
        bend = [tuple((a + b) / 2 + 12.0)] if number % 3 == 0 else []
        shape = (tuple(a), *bend, tuple(b))
        segments.append(Segment(f"{start}_{end}", start, end, BLOCK_M, 13.9, 1, shape))
    return build_network("grid", segments, junctions)


def drive(network: RoadNetwork, rng: np.random.Generator, length: int) -> list[Segment]:
    """A drive over so many streets without turning back."""
    names = list(network.segments)
    road = names[rng.integers(len(names))]
    driven = [road]
    while len(driven) < length:
        onward = network.follows[driven[-1]]
        driven.append(onward[rng.integers(len(onward))])
    return [network.segments[name] for name in driven]


def plan(
    vehicle: str,
    driven: list[Segment],
    stops: list[str],
    now_ns: int,
    cycle: int = 1,
    begun_s: float = 0.0,
) -> VehiclePlan:
    """A plan over some streets, a stop after each equal part of them, every fifth in a platoon."""
    every = len(driven) // (len(stops) + 1)
    clock_ns = now_ns - round(begun_s * S)
    depart_ns, parts, planned = clock_ns, [], []
    for number, road in enumerate(driven):
        together = number % 5 == 4
        end_ns = clock_ns + round(road.free_flow_s * S)
        parts.append(
            PlannedSegment(
                segment=road.id,
                entry_ns=clock_ns,
                exit_ns=end_ns,
                speed_mps=road.speed_limit_mps,
                platoon="p" if together else None,
                place=0 if together else None,
                gap_m=None,
                leg=min(number // every, len(stops)),
            )
        )
        clock_ns = end_ns
        if number % every == every - 1 and len(planned) < len(stops):
            planned.append(
                PlannedStop(
                    stop=stops[len(planned)],
                    node=road.end,
                    arrival_ns=clock_ns,
                    departure_ns=clock_ns + 30 * S,
                )
            )
            clock_ns += 30 * S
    return VehiclePlan(
        vehicle=vehicle,
        cycle=cycle,
        issued_ns=now_ns,
        valid_until_ns=now_ns + 7200 * S,
        depart_ns=depart_ns,
        stops=tuple(planned),
        segments=tuple(parts),
        distance_m=BLOCK_M * len(driven),
        energy_kwh=0.1 * len(driven),
    )


def snapshot(world, network: RoadNetwork, now_ns: int, seed: int = 0, cycle: int = 1) -> Snapshot:
    """200 vans under way to 1,000 stops, 40 more stops left out, 600 watched roads."""
    rng = np.random.default_rng(seed)
    stops = iter(f"stop-{number:04}" for number in range(1000))
    plans = {
        f"van-{number:03}": plan(
            f"van-{number:03}",
            drive(network, rng, 80),
            [next(stops) for _ in range(5)],
            now_ns,
            cycle,
            begun_s=float(rng.uniform(0, 900)),
        )
        for number in range(200)
    }
    watched = list(network.segments)[::3][:600]
    states = [world.state(name, now_ns, y_e=int(rng.integers(2))) for name in watched]
    report = world.cycle(cycle, now_ns).model_copy(
        update={
            "plans": 200,
            "unserved": tuple(
                Unserved(stop=f"left-{number}", reason="no vehicle has room and time for it")
                for number in range(40)
            ),
        }
    )
    return Snapshot(
        states={(state.segment, state.rsu): state for state in states},
        rsus={state.rsu: world.health(state.segment, now_ns) for state in states},
        plans=plans,
        cycles=(report,),
        dispatcher=world.dispatcher(now_ns),
    )
