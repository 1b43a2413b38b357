"""Room that the inputs of a large fleet's cycles take."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dispatcher_daemon.planning.cycle.cycle import CycleResult
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.replay import InputEncoder, Trace
from dispatcher_daemon.service.dispatcher.reports import failed_report
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic.snapshot import Expectations, take_snapshot
from slipstream.explain import VehicleAccount
from slipstream.messages import SegmentState
from slipstream_lab.research.cities.generator import generate_city
from storage import open_database


@pytest.mark.long
def test_a_cycle_of_200_vehicles_and_1000_segments_takes_little_room(
    tmp_path: Path, state: Callable[..., SegmentState]
) -> None:
    """Roads, fleet and costs learned in the hour are there once; each further cycle takes some
    35 kB, where every segment is watched, measured and has a learned share of its gate's states.
    """
    city = generate_city(1, vehicles=200, stops=1000, segments=1000)
    network, rng = city.problem.network, np.random.default_rng(1)
    turns = [(a, b) for a in network.segments for b in network.turns(a)]

    def drawn(names: Iterable[Any]) -> dict[Any, float]:
        return {name: float(rng.uniform()) for name in names}

    def seen(number: int) -> list[SegmentState]:
        spread = {name: rng.normal(size=3) for name in network.segments}
        return [
            state(
                name,
                int(drawn[2] < 0.5),
                time_ns=10**18 + number - int(1e9 * rng.uniform()),
                speed_mps=9.0 + 2.0 * drawn[0],
                mean_acceleration_mps2=0.3 * drawn[1],
                acceleration_variance_m2ps4=0.1 + 0.2 * drawn[2] ** 2,
            )
            for name, drawn in spread.items()
        ]

    expected = Expectations(drawn(turns), drawn(turns), drawn(turns))
    encoder, settings = InputEncoder(), DispatcherSettings()
    path = tmp_path / "a.db"
    used = []
    with open_database(f"sqlite:///{path}") as database:
        for number in (1, 2, 3):
            shares = {name: round(share, 4) for name, share in drawn(network.segments).items()}
            snapshot = take_snapshot(network, seen(number), 10**18 + number, stale_after_s=5.0)
            snapshot = replace(snapshot.with_usual_gates(shares), expected=expected)
            accounts = []
            for vehicle in city.problem.fleet.vehicles:
                a, b, c, d, e, f, g = rng.uniform(size=7).tolist()
                own = VehicleAccount(vehicle.id, ("a", "b", "c"), a, b, c, d, e, (), f, g)
                accounts.append(own)
            stops = {
                v.id: tuple(rng.permutation(1000)[:5].astype(str))
                for v in city.problem.fleet.vehicles
            }
            cycle = Cycle(city.problem, snapshot, settings, number, 10**18, number, start=stops)
            report = failed_report(number, 10**18, 0.0, "not planned")
            trace = Trace(tuple(rng.integers(0, 100, 700).tolist()), ((20_000,),) * 20)
            made_from = encoder.encode(
                cycle, trace, CycleResult(report, (), accounts=tuple(accounts))
            )
            database.record_cycle(report, [], [], made_from=made_from)
            database.trim(1e6)
            used.append(database._pages().used * database._pages().size)
    first, second, third = used
    print(f"database: {first / 1e3:.0f} kB, then {(third - first) / 2e3:.0f} kB a cycle")
    print({name: f"{len(part.data) / 1e3:.1f} kB" for name, part in made_from.parts.items()})
    assert first < 700_000
    assert len(made_from.parts["traffic"].data) < 20_000
    assert third - second < 60_000
