"""A city's daemons in one process: segment states, health, plans, positions, each once a second.

Run as a module: settings as JSON on standard input; writes "declared", then, each second, when the
probe's state went out, and goes on until its standard input ends.
"""

from __future__ import annotations

import json
import random
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass

from slipstream.bus import Bus, Publisher
from slipstream.config import BusSettings
from slipstream.messages import (
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    CycleReport,
    DispatcherHealth,
    EnergySummary,
    Gate,
    PlannedSegment,
    PlannedStop,
    RsuHealth,
    VehiclePlan,
    VehiclePosition,
    plan_key,
    position_key,
    rsu_health_key,
    state_key,
)
from slipstream.roads import RoadNetwork, Segment
from slipstream.roads.sumo_net import load_network

S = 1_000_000_000
_ROADS_OF_A_PLAN = 80
_STOPS_OF_A_PLAN = 5


@dataclass
class ShownRoad:
    """A watched road whose traffic wanders, as a window of ten seconds makes it."""

    publisher: Publisher
    rsu: str
    segment: str
    speed_mps: float
    spread_mps: float
    vehicles: int

    def state(self, sequence: int, time_ns: int, rng: random.Random, vehicles: int | None) -> bytes:
        """What its RSU sees a second later, with a number of vehicles of one's own if given."""
        self.speed_mps = min(max(self.speed_mps + rng.gauss(0, 0.15), 3.0), 15.0)
        self.spread_mps = min(max(self.spread_mps + rng.gauss(0, 0.02), 0.1), 3.0)
        if rng.random() < 0.2:
            self.vehicles = min(max(self.vehicles + rng.choice((-1, 1)), 3), 20)
        stable = self.spread_mps / self.speed_mps < 0.12
        # Written out: 10,000 models a second would take more than a core.
        return _STATE % (
            self.rsu.encode(),
            self.segment.encode(),
            sequence,
            time_ns,
            self.speed_mps,
            self.vehicles / 400,
            self.spread_mps,
            stable,
            self.vehicles if vehicles is None else vehicles,
        )


_STATE = (
    b'{"rsu":"%b","segment":"%b","sequence":%d,"time_ns":%d,"window_s":10.0,"features":{'
    b'"mean_speed_mps":{"value":%.9f,"standard_error":0.123456789},'
    b'"mean_acceleration_mps2":{"value":0.012345678,"standard_error":0.012345678},'
    b'"density_veh_per_m":{"value":%.9f,"standard_error":0.001234567},'
    b'"speed_std_mps":{"value":%.9f,"standard_error":0.081234567},'
    b'"acceleration_variance_m2ps4":{"value":0.051234567,"standard_error":0.011234567},'
    b'"mean_gap_m":{"value":22.123456789,"standard_error":3.123456789}},'
    b'"y_e":%d,"reason":null,"vehicles":%d,"frames":300,"coverage":1.0}'
)


def a_plan(
    vehicle: str, network: RoadNetwork, now_ns: int, rng: random.Random, cycle: int = 1
) -> VehiclePlan:
    """A round of `_ROADS_OF_A_PLAN` roads begun some minutes ago, every fifth in a platoon."""
    names = list(network.segments)
    driven: list[Segment] = [network.segments[rng.choice(names)]]
    while len(driven) < _ROADS_OF_A_PLAN:
        driven.append(network.segments[rng.choice(network.follows[driven[-1].id])])
    clock_ns = begun_ns = now_ns - rng.randrange(120) * S
    node = driven[0].start
    stops = [PlannedStop(stop="yard", node=node, arrival_ns=clock_ns, departure_ns=clock_ns)]
    segments = []
    every = _ROADS_OF_A_PLAN // (_STOPS_OF_A_PLAN + 1)
    for number, road in enumerate(driven):
        end_ns = clock_ns + round(road.free_flow_s * S)
        together = number % 5 == 4
        segments.append(
            PlannedSegment(
                segment=road.id,
                entry_ns=clock_ns,
                exit_ns=end_ns,
                speed_mps=road.speed_limit_mps,
                platoon=f"{vehicle}-{number}" if together else None,
                place=0 if together else None,
                gap_m=None,
                leg=min(number // every, _STOPS_OF_A_PLAN),
            )
        )
        clock_ns = end_ns
        if number % every == every - 1 and len(stops) <= _STOPS_OF_A_PLAN:
            name = f"{vehicle}-stop-{len(stops)}"
            clock_ns += 30 * S
            stops.append(
                PlannedStop(stop=name, node=road.end, arrival_ns=end_ns, departure_ns=clock_ns)
            )
    stops.append(
        PlannedStop(stop="yard", node=driven[-1].end, arrival_ns=clock_ns, departure_ns=clock_ns)
    )
    return VehiclePlan(
        vehicle=vehicle,
        cycle=cycle,
        issued_ns=now_ns,
        valid_until_ns=clock_ns + 7200 * S,
        depart_ns=begun_ns,
        stops=tuple(stops),
        segments=tuple(segments),
        distance_m=sum(road.length_m for road in driven),
        energy_kwh=2.0,
    )


def a_position(plan: VehiclePlan, now_ns: int) -> VehiclePosition:
    """Where a vehicle is that is exactly on its plan."""
    for part in plan.segments:
        if part.entry_ns <= now_ns < part.exit_ns:
            share = (now_ns - part.entry_ns) / (part.exit_ns - part.entry_ns)
            where = (part.segment, share, part.speed_mps, True, part.leg)
            break
    else:
        before = [part for part in plan.segments if part.exit_ns <= now_ns] or [plan.segments[0]]
        where = (before[-1].segment, 1.0, 0.0, False, before[-1].leg + 1)
    segment, share, speed_mps, on_road, leg = where
    return VehiclePosition(
        vehicle=plan.vehicle,
        time_ns=now_ns,
        segment=segment,
        share=share,
        speed_mps=speed_mps,
        on_road=on_road,
        cycle=plan.cycle,
        leg=leg,
    )


def a_cycle(number: int, now_ns: int, watched: list[str], vans: int) -> CycleReport:
    """A cycle with a gate for each watched road."""
    return CycleReport(
        cycle=number,
        started_ns=now_ns,
        wall_s=4.2,
        status="ok",
        reason=None,
        solver="tabu",
        objective_kwh=300.0,
        variables=900,
        solvers=(),
        gates=tuple(
            Gate(segment=name, y_e=1, reason=None, age_s=0.5, speed_mps=12.0, open=True)
            for name in watched
        ),
        energy=EnergySummary(
            baseline="each van alone",
            baseline_kwh=400.0,
            cooperative_kwh=380.0,
            saved_distance_kwh=12.0,
            saved_drag_kwh=5.0,
            saved_acceleration_kwh=3.0,
            platooned_distance_m=80_000.0,
        ),
        plans=vans,
    )


def a_health(rsu: str, segments: tuple[str, ...], now_ns: int) -> RsuHealth:
    """A unit that is well."""
    return RsuHealth(
        rsu=rsu,
        time_ns=now_ns,
        started_ns=now_ns - 3600 * S,
        source="camera",
        segments=segments,
        status="ok",
        frames=100_000,
        frames_skipped=0,
        decode_errors=0,
        reconnects=0,
        states=3600,
        fps=30.0,
        latency_ms_p50=18.0,
        latency_ms_p95=30.0,
        vehicles_in_view=9,
        rss_mb=300.0,
    )


def a_dispatcher(now_ns: int, cycle_ns: int) -> DispatcherHealth:
    """A dispatcher that is well."""
    return DispatcherHealth(
        time_ns=now_ns,
        started_ns=now_ns - 3600 * S,
        cycles=120,
        cycles_failed=0,
        states_received=100_000,
        bad_messages=0,
        next_cycle_ns=cycle_ns + 30 * S,
        rss_mb=300.0,
    )


def main() -> None:
    """Publish until standard input ends."""
    told = json.loads(sys.stdin.readline())
    network, rng = load_network(told["network"]), random.Random(7)
    watched: dict[str, list[str]] = told["watched"]
    stopping = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.read()
        stopping.set()

    with ExitStack() as stack:
        bus = stack.enter_context(Bus.open(BusSettings(connect=(told["endpoint"],))))

        def outlet(key: str) -> Publisher:
            return bus.publisher(key, history=0)

        roads = [
            ShownRoad(outlet(state_key(rsu, name)), rsu, name, rng.uniform(6, 13), 1.2, 8)
            for rsu, names in watched.items()
            for name in names
        ]
        healths = {rsu: outlet(rsu_health_key(rsu)) for rsu in watched}
        dispatcher, cycles = bus.publisher(DISPATCHER_HEALTH_KEY), bus.publisher(CYCLE_KEY)
        now_ns = time.time_ns()
        plans = [a_plan(f"van-{n:04}", network, now_ns, rng) for n in range(told["vans"])]
        senders = [bus.publisher(plan_key(plan.vehicle)) for plan in plans]
        positions = [outlet(position_key(plan.vehicle)) for plan in plans]
        time.sleep(3.0)
        names = [road.segment for road in roads]
        for sender, plan in zip(senders, plans, strict=True):
            sender.put(plan)
        cycle_ns, number = now_ns, 1
        cycles.put(a_cycle(number, cycle_ns, names, len(plans)))
        print("declared", flush=True)
        threading.Thread(target=wait_for_end, daemon=True).start()
        due, second = time.monotonic(), 0
        while not stopping.is_set():
            second += 1
            # States of a city are spread over the second.
            for index, road in enumerate(roads):
                if index % 25 == 0:
                    time.sleep(max(0.0, due + 0.9 * index / len(roads) - time.monotonic()))
                now_ns = time.time_ns()
                probe = 1000 + second if index == 0 else None
                road.publisher.put(road.state(second, now_ns, rng, probe))
                if index == 0:
                    print(json.dumps({"probe": 1000 + second, "at": now_ns / S}), flush=True)
            now_ns = time.time_ns()
            for publisher, plan in zip(positions, plans, strict=True):
                publisher.put(a_position(plan, now_ns))
            for rsu, publisher in healths.items():
                publisher.put(a_health(rsu, tuple(watched[rsu]), now_ns))
            if second % 30 == 0:
                cycle_ns, number = now_ns, number + 1
                cycles.put(a_cycle(number, cycle_ns, names, len(plans)))
            dispatcher.put(a_dispatcher(now_ns, cycle_ns))
            # The probe's phase wanders through the page's period.
            due += 1.0 + rng.uniform(-0.1, 0.1)
            stopping.wait(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    main()
