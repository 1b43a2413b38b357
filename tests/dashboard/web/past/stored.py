"""A short stored run of the demo network's two vans."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import msgspec

import storage
from slipstream.energy.ledger import EnergyHour, PlanEnergy
from slipstream.explain import CycleFacts, RefusedPlatoon, VehicleAccount, facts_data
from slipstream.messages import VehiclePlan
from slipstream.orders import FleetRecords, OrderChange, OrderRecord, PlanRecord
from storage import CycleInputs, Event, RollUpBuffer

S = 1_000_000_000
CYCLES = 3
PERIOD_NS = 300 * S


def store_run(url: str, world: Any, begin_ns: int) -> None:
    """Store three cycles, five minutes apart: van-b gets no plan in the last one, an order is
    served and another fails, and the eastbound avenue turns turbulent before the third.
    """
    times = [begin_ns + number * PERIOD_NS for number in range(CYCLES)]
    with storage.open_database(url) as database:
        for number, time_ns in enumerate(times, 1):
            vans = ("van-a", "van-b") if number < CYCLES else ("van-a",)
            plans = [world.plan(van, number, time_ns) for van in vans]
            states = _states(world, time_ns, number)
            ended = [
                PlanRecord(
                    world.plan(van, number - 1, times[number - 2]), "superseded", time_ns, ""
                )
                for van in vans
                if number > 1
            ]
            if number == CYCLES:
                # Its tour is over a little later.
                second = world.plan("van-b", 2, times[1])
                ended.append(PlanRecord(second, "done", time_ns + 60 * S))
            database.record_cycle(
                world.cycle(number, time_ns),
                plans,
                states,
                FleetRecords(plans=tuple(ended)),
                CycleInputs(_record(vans), {}),
                {plan.vehicle: _energy(plan) for plan in plans},
            )
            buffer = RollUpBuffer()
            for second in range(60):
                for state in states:
                    buffer.add(msgspec.structs.replace(state, time_ns=time_ns + second * S))
            database.add_rollups(buffer.take())
        database.save_fleet(_fleet(times))
        database.save_events(_events(times))


def _energy(plan: VehiclePlan) -> PlanEnergy:
    """A quarter of what it needs alone is saved by a platoon, on its first segment."""
    size = len(plan.segments)
    drag_kwh = (plan.energy_kwh / 3, *[0.0] * (size - 1))
    return PlanEnergy((plan.energy_kwh / size,) * size, drag_kwh)


def _record(vans: tuple[str, ...]) -> bytes:
    accounts = tuple(
        VehicleAccount(van, ("mill",), 0.75, 1.0, 100.0, 0.0, 200.0, ("mill",), 1.0, 90.0)
        for van in vans
    )
    refused = (RefusedPlatoon(("van-a", "van-b"), ("bridge",), "apart", None, 0.02, 61.5),)
    return json.dumps(facts_data(CycleFacts(vans, accounts, refused))).encode()


def _states(world: Any, time_ns: int, number: int) -> list[Any]:
    east = 1 if number < CYCLES else 0
    return [
        world.state("avenue_east", time_ns, east, speed_mps=15.0),
        world.state("avenue_west", time_ns, 0, speed_mps=7.0),
    ]


def _fleet(times: list[int]) -> FleetRecords:
    orders, changes = [], []
    for name, node, last in (
        ("mill", "mill", "served"),
        ("dock", "dock", "failed"),
        ("=late", "hill", "planned"),
    ):
        steps = [(0, "open"), (10, "planned"), (400, last)]
        record = OrderRecord(
            name,
            node,
            60.0,
            2,
            None,
            times[0] + 300 * S,
            last,
            times[0] + 400 * S,
            "so",
            "van-a",
            1,
        )
        orders.append(replace(record, pinned="van-a"))
        changes += [
            OrderChange(name, times[0] + at * S, state, f"became {state}", "van-a", 1)
            for at, state in steps
        ]
    hour_ns = times[0] // (3600 * S) * 3600 * S
    driven = tuple(
        EnergyHour(hour_ns - n * 3600 * S, van, 2.0, 1.5, 0.1, 0.3, 0.1, 10_000.0, 4_000.0)
        for n in (0, 1)
        for van in ("van-a", "van-b")
    )
    return FleetRecords(orders=tuple(orders), changes=tuple(changes), driven=driven)


def _events(times: list[int]) -> list[Event]:
    return [
        Event(
            times[1],
            "rsu_silent",
            "critical",
            "rsu/rsu-avenue_west",
            "rsu-avenue_west is <silent>",
            mend="look at its box",
            alarm="a-1",
            ended_ns=times[1] + 120 * S,
            acknowledged_by="anna",
            acknowledged_ns=times[1] + 60 * S,
        ),
        Event(times[1], "pause", "info", "dispatcher", "paused", actor="anna"),
    ]
