from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations, pairwise
from typing import Any

import pytest

from dispatcher_daemon.fleet import fleet_from, load_fleet
from dispatcher_daemon.forms.problem import ArcProblem, RouteOption, RouteProblem, RoutingProblem
from dispatcher_daemon.planning.arc_form.arcs import arc_problem
from dispatcher_daemon.planning.platooning.rewards import judge_pairs
from dispatcher_daemon.planning.roads.routes import candidate_arcs
from dispatcher_daemon.planning.roads.travel import least_energy_legs
from dispatcher_daemon.traffic.snapshot import SegmentTraffic, TrafficSnapshot, take_snapshot
from slipstream.messages import Estimate, KinematicFeatures, SegmentState
from slipstream.roads import Segment, build_network
from slipstream.roads.sumo_net import load_network

NOW_NS = 1_800_000_000_000_000_000
LIMIT_MPS = 16.67


def make_state(
    segment: str,
    y_e: int | None,
    *,
    time_ns: int = NOW_NS,
    rsu: str | None = None,
    sequence: int = 1,
    speed_mps: float = LIMIT_MPS,
    mean_acceleration_mps2: float = 0.0,
    acceleration_variance_m2ps4: float = 0.1,
    features: bool = True,
) -> SegmentState:
    """A SegmentState of traffic at the speed limit unless told otherwise."""

    def estimate(value: float) -> Estimate:
        return Estimate(value=value, standard_error=0.1)

    measured = KinematicFeatures(
        mean_speed_mps=estimate(speed_mps),
        mean_acceleration_mps2=estimate(mean_acceleration_mps2),
        density_veh_per_m=estimate(0.02),
        speed_std_mps=estimate(0.5),
        acceleration_variance_m2ps4=estimate(acceleration_variance_m2ps4),
    )
    return SegmentState(
        rsu=rsu or f"rsu-{segment}",
        segment=segment,
        sequence=sequence,
        time_ns=time_ns,
        window_s=10.0,
        features=measured if features else None,
        y_e=y_e,
        reason="uncertain" if y_e is None else None,
        vehicles=8,
        frames=300,
        coverage=1.0,
    )


@pytest.fixture(scope="session")
def state() -> Callable[..., SegmentState]:
    """Factory of segment states."""
    return make_state


@pytest.fixture(scope="session")
def now_ns() -> int:
    """A moment."""
    return NOW_NS


@pytest.fixture(scope="session")
def demo() -> RoutingProblem:
    """The built-in network and fleet."""
    network = load_network("demo")
    return RoutingProblem(network, load_fleet("demo", network))


@pytest.fixture(scope="session")
def traffic(demo: RoutingProblem) -> Callable[..., TrafficSnapshot]:
    """Factory of snapshots from y_e by segment, at the speed limit; None has no features."""

    def make(**flags: int | None) -> TrafficSnapshot:
        states = [make_state(s, y, features=y is not None) for s, y in flags.items()]
        return take_snapshot(demo.network, states, NOW_NS, stale_after_s=5.0)

    return make


@pytest.fixture(scope="session")
def demo_arcs(
    demo: RoutingProblem, traffic: Callable[..., TrafficSnapshot]
) -> Callable[..., ArcProblem]:
    """Factory of the demo's arc problem for flags as in `traffic`."""

    def make(**flags: int | None) -> ArcProblem:
        snapshot = traffic(**flags)
        arcs = candidate_arcs(demo, least_energy_legs(demo, snapshot))
        return arc_problem(demo, arcs, list(judge_pairs(demo, arcs, snapshot, 3.0)))

    return make


@pytest.fixture(scope="session")
def random_arcs() -> Callable[..., ArcProblem]:
    """Factory of random arc problems: sparse, some infeasible, some rewards above their costs."""
    import numpy as np

    from dispatcher_daemon.forms.problem import ArcReward, CandidateArc

    def make(seed: int, customers: int, vehicles: int, max_arcs: int) -> ArcProblem:
        rng = np.random.default_rng(seed)
        names = [f"c{i}" for i in range(customers)]
        fleet = [f"v{k}" for k in range(vehicles)]
        places = ["d", *names]
        pairs = [(k, i, j) for k in fleet for i in places for j in places if i != j]
        wanted: list[tuple[str, str, str]] = []
        if customers >= vehicles and rng.random() < 0.8:
            # The arcs of some valid route set come first, so that most instances are feasible.
            parts = np.array_split(rng.permutation(names), vehicles)
            for vehicle, part in zip(fleet, parts, strict=True):
                stops = ["d", *map(str, part), "d"]
                wanted += [(vehicle, i, j) for i, j in pairwise(stops)]
        others = [pairs[n] for n in rng.permutation(len(pairs)) if pairs[n] not in wanted]
        keep = sorted((wanted + others)[: max(max_arcs, len(wanted))])
        arcs = tuple(CandidateArc(*key, cost_kwh=float(rng.uniform(0.05, 0.4))) for key in keep)
        rewards = tuple(
            ArcReward(a, b, f"e{rng.integers(2)}", float(rng.uniform(0.01, 0.3)))
            for a in range(len(arcs))
            for b in range(a + 1, len(arcs))
            if arcs[a].vehicle != arcs[b].vehicle and rng.random() < 0.3
        )
        return ArcProblem("d", tuple(names), tuple(fleet), arcs, rewards)

    return make


@pytest.fixture(scope="session")
def random_routes() -> Callable[..., RouteProblem]:
    """Factory of random route problems: some infeasible, costs and savings of either sign."""
    import numpy as np

    def make(seed: int, options: Sequence[int], stops: int) -> RouteProblem:
        rng = np.random.default_rng(seed)
        fleet = [f"v{k}" for k in range(len(options))]
        names = [f"s{i}" for i in range(stops)]
        home = rng.integers(0, len(fleet), stops)
        every = []
        for number, (vehicle, count) in enumerate(zip(fleet, options, strict=True)):
            for option in range(count):
                served = {s for s, at in zip(names, home, strict=True) if at == number}
                if stops and option and rng.random() < 0.4:
                    served ^= {names[int(rng.integers(stops))]}
                cost = float(rng.normal(0.5, 0.4))
                every.append(RouteOption(vehicle, tuple(sorted(served)), cost))
        savings = {
            (a, b): float(rng.normal(0.1, 0.2))
            for a, b in combinations(range(len(every)), 2)
            if every[a].vehicle != every[b].vehicle and rng.random() < 0.4
        }
        return RouteProblem(tuple(fleet), tuple(names), tuple(every), savings)

    return make


Town = tuple[RoutingProblem, TrafficSnapshot]


@pytest.fixture(scope="session")
def town() -> Callable[..., Town]:
    """Factory of towns of 4 × 4 junctions "00" to "33", with all gates open unless told otherwise;
    beside them "p" and "q", joined to each other but not to the town.

    Stops are given by their junctions and named "s0", "s1" ..., or as tables, vehicles as tables.
    """
    import numpy as np

    def make(
        stops: Sequence[str | dict[str, Any]],
        vehicles: Sequence[dict[str, Any]],
        depots: Sequence[str] = ("00",),
        *,
        seed: int = 1,
        open_share: float = 1.0,
    ) -> Town:
        rng = np.random.default_rng(seed)
        at = {f"{x}{y}": (300.0 * x, 300.0 * y) for x in range(4) for y in range(4)}
        at |= {"p": (3000.0, 0.0), "q": (3300.0, 0.0)}
        near = [(a, b) for a in at for b in at if 0 < math.dist(at[a], at[b]) < 301]
        roads = [
            Segment(
                f"{a}-{b}",
                a,
                b,
                float(rng.uniform(150, 400)),
                float(rng.choice([8.33, 13.89, 16.67])),
                1,
                (at[a], at[b]),
            )
            for a, b in near
        ]
        network = build_network("town", roads, at)
        tables = [
            stop if isinstance(stop, dict) else {"id": f"s{i}", "node": stop, "service_s": 20.0}
            for i, stop in enumerate(stops)
        ]
        fleet = fleet_from(
            {
                "depots": [{"id": f"depot-{n}", "node": node} for n, node in enumerate(depots)],
                "stops": tables,
                "vehicles": [{"id": f"van-{n}", **v} for n, v in enumerate(vehicles)],
            },
            network,
            "town",
        )
        seen = {
            s.id: SegmentTraffic(s.id, s.speed_limit_mps, y_e=1, open=True, reason=None, age_s=1.0)
            if rng.random() < open_share
            else SegmentTraffic(s.id, s.speed_limit_mps)
            for s in roads
        }
        return RoutingProblem(network, fleet), TrafficSnapshot(NOW_NS, seen, ())

    return make
