"""A moment thirty days back: a database of a month of a city, and how long its page takes."""

from __future__ import annotations

import contextlib
import random
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, Final

import storage
from dashboard.settings import Factors
from dashboard.view.places import Places
from dashboard.web.energy import EnergyBook
from dashboard.web.hub import encoded
from dashboard.web.past import StoredPast
from dashboard.web.tables.rows import Scene
from slipstream.energy.ledger import EnergyHour
from slipstream.messages import EnergySummary, PlannedSegment, PlannedStop, VehiclePlan
from slipstream.orders import FleetRecords, OrderChange, OrderRecord, PlanRecord
from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream_lab.benchmarks.aims import Check, at_most
from slipstream_lab.benchmarks.storage.city import CYCLE_S, START_NS, CityCycle, StoredCity
from storage.traffic.rollups import RollUp

MAX_S: Final = 2.0
ROADS: Final = 1000
VANS: Final = 200
DAYS: Final = 30
_ORDERS_A_DAY: Final = 2000
_PLANS_A_DAY: Final = 8
"""Tours of each van, each with a plan of its own."""
_DAY_NS: Final = 86_400 * 10**9
_CYCLES_A_DAY: Final = 86_400 // CYCLE_S
_SUMMARY: Final = EnergySummary(
    baseline="each van alone",
    baseline_kwh=100.0,
    cooperative_kwh=90.0,
    saved_distance_kwh=2.0,
    saved_drag_kwh=4.0,
    saved_acceleration_kwh=4.0,
    platooned_distance_m=40_000.0,
)


@dataclass(frozen=True)
class PastFigures:
    """What was measured.

    Attributes:
        play_s: moments half a minute apart, as played at 60 times: median and longest.
        cpu_s: processor time of such moments, median and longest. It says what other work on the
            machine hides.
    """

    days: int
    first_s: float
    moment_s: tuple[float, float]
    play_s: tuple[float, float]
    cpu_s: tuple[float, float]
    bytes: int
    gb: float


def measure(
    say: Callable[[str], None], *, days: int = DAYS, folder: Path | None = None, seed: int = 1
) -> PastFigures:
    """Fill a database and look at moments at its other end. `folder`: for the database, which
    stays; None: one that goes.
    """
    with tempfile.TemporaryDirectory() as made:
        path = (folder or Path(made)) / "past.db"
        url = f"sqlite:///{path}"
        if not path.exists():
            fill(url, days, seed, say)
        return _look(url, path, days)


def fill(url: str, days: int, seed: int, say: Callable[[str], None]) -> None:
    """Store a month of a city: two days as its dispatcher would, and copies of the second one.

    What the dispatcher would have deleted by its age, minutes and whole states, is not stored.
    """
    city, drawn = StoredCity(ROADS, seed), random.Random(seed)
    names = [state.segment for state in city.cycle(1).states]
    before: dict[str, VehiclePlan] = {}
    with storage.open_database(url, owned=True) as database:
        for number in range(1, 2 * _CYCLES_A_DAY + 1):
            cycle = city.cycle(number)
            now_ns = cycle.report.started_ns
            plans = _plans(number, now_ns, names, drawn)
            ended = tuple(
                PlanRecord(before[plan.vehicle], "done", now_ns)
                for plan in plans
                if plan.vehicle in before
            )
            before |= {plan.vehicle: plan for plan in plans}
            orders = list(_orders(number, now_ns))
            records = FleetRecords(
                orders=tuple(order for order, _ in orders),
                changes=tuple(change for _, changes in orders for change in changes),
                plans=ended,
                driven=_driven(now_ns),
            )
            report = cycle.report.model_copy(update={"plans": len(plans), "energy": _SUMMARY})
            database.record_cycle(report, plans, (), records)
            if now_ns % (3600 * 10**9) < CYCLE_S * 10**9:
                database.add_rollups(_hour(cycle, now_ns))
    say("past: two days are stored")
    path = url.removeprefix("sqlite:///")
    with contextlib.closing(sqlite3.connect(path)) as connection:
        for copy in range(1, days - 1):
            _copy_last_day(connection, copy)
            connection.commit()
    say(f"past: {days} days are stored")


def _hour(cycle: CityCycle, now_ns: int) -> list[RollUp]:
    """A minute in the hour before, of which its roll-up is made when the next one comes."""
    hour_ns = now_ns // (3600 * 10**9) * 3600 * 10**9
    first_ns = cycle.minutes[0].began_ns
    return [replace(part, began_ns=hour_ns) for part in cycle.minutes if part.began_ns == first_ns]


def _copy_last_day(connection: sqlite3.Connection, copy: int) -> None:
    """Store the second day once more, so many days later."""
    first, last = _CYCLES_A_DAY + 1, 2 * _CYCLES_A_DAY
    begin_ns, end_ns = START_NS + _DAY_NS, START_NS + 2 * _DAY_NS
    shifts = {"cycle": f"+{copy * _CYCLES_A_DAY}", "order": f"||'-{copy}'"} | dict.fromkeys(
        (
            "started_ns",
            "issued_ns",
            "valid_until_ns",
            "depart_ns",
            "status_ns",
            "time_ns",
            "since_ns",
            "latest_ns",
            "began_ns",
            "hour_ns",
        ),
        f"+{copy * _DAY_NS}",
    )
    of_cycles = f"cycle BETWEEN {first} AND {last}"
    wanted = {
        "cycles": of_cycles,
        "solver_runs": of_cycles,
        "plans": of_cycles,
        "gate_changes": of_cycles,
        "segment_rollups": f"period_s = 3600 AND began_ns >= {begin_ns} AND began_ns < {end_ns}",
        "energy_ledger": f"hour_ns >= {begin_ns} AND hour_ns < {end_ns}",
        "orders": of_cycles,
        "order_changes": of_cycles,
    }
    for table, condition in wanted.items():
        names = [row[1] for row in connection.execute(f'PRAGMA table_info("{table}")')]
        values = ", ".join(f'"{name}"{shifts.get(name, "")}' for name in names)
        columns = ", ".join(f'"{name}"' for name in names)
        connection.execute(
            f'INSERT OR IGNORE INTO "{table}" ({columns}) SELECT {values} FROM "{table}" '
            f"WHERE {condition}"
        )


def _plans(number: int, now_ns: int, names: list[str], drawn: random.Random) -> list[VehiclePlan]:
    """Tours of the vans that leave now: each begins `_PLANS_A_DAY` a day."""
    every = _CYCLES_A_DAY // _PLANS_A_DAY
    return [
        _plan(f"van-{van:03d}", number, now_ns, names, drawn)
        for van in range(VANS)
        if van % every == number % every
    ]


def _plan(
    vehicle: str, number: int, now_ns: int, names: list[str], drawn: random.Random
) -> VehiclePlan:
    lasts_ns = 120 * 10**9
    times = [now_ns + 60 * 10**9 + place * lasts_ns for place in range(61)]
    return VehiclePlan(
        vehicle=vehicle,
        cycle=number,
        issued_ns=now_ns,
        valid_until_ns=times[-1],
        depart_ns=times[0],
        stops=tuple(
            PlannedStop(
                stop=f"o-{number}-{place}",
                node=f"n{drawn.randrange(ROADS)}",
                arrival_ns=times[6 * place],
                departure_ns=times[6 * place] + 60 * 10**9,
            )
            for place in range(10)
        ),
        segments=tuple(
            PlannedSegment(
                segment=drawn.choice(names),
                entry_ns=times[place],
                exit_ns=times[place + 1],
                speed_mps=13.9,
                platoon=f"p-{number}" if place % 5 == 4 else None,
                place=0 if place % 5 == 4 else None,
                gap_m=None,
                leg=place // 6,
            )
            for place in range(60)
        ),
        distance_m=24_000.0,
        energy_kwh=5.0,
    )


def _orders(number: int, now_ns: int) -> Iterator[tuple[OrderRecord, tuple[OrderChange, ...]]]:
    """New orders of a cycle with their whole lives: they are open for an hour or so."""
    for place in range(_ORDERS_A_DAY * CYCLE_S // 86_400):
        name = f"o-{number}-{place}"
        steps: list[tuple[int, Any]] = [
            (0, "open"),
            (300, "planned"),
            (1800, "under_way"),
            (5400, "served"),
        ]
        last_s, state = steps[-1]
        record = OrderRecord(
            name,
            f"n{(number * 7 + place) % ROADS}",
            60.0,
            1,
            None,
            now_ns + 7200 * 10**9,
            state,
            now_ns + last_s * 10**9,
            "as planned",
            f"van-{(number + place) % VANS:03d}",
            number,
            listed=False,
        )
        yield (
            record,
            tuple(
                OrderChange(
                    name, now_ns + after_s * 10**9, step, "as planned", record.vehicle, number
                )
                for after_s, step in steps
            ),
        )


def _driven(now_ns: int) -> tuple[EnergyHour, ...]:
    hour_ns = now_ns // (3600 * 10**9) * 3600 * 10**9
    return tuple(
        EnergyHour(hour_ns, f"van-{van:03d}", 0.5, 0.45, 0.01, 0.02, 0.02, 2000.0, 300.0)
        for van in range(VANS)
    )


def _network(names: list[str]) -> RoadNetwork:
    """The city's roads, in a row."""
    junctions = {f"n{number}": (100.0 * number, 0.0) for number in range(len(names) + 1)}
    roads = [
        Segment(
            name,
            f"n{number}",
            f"n{number + 1}",
            100.0,
            13.9,
            1,
            ((100.0 * number, 0.0), (100.0 * (number + 1), 0.0)),
        )
        for number, name in enumerate(names)
    ]
    return build_network("city", roads, junctions)


def _look(url: str, path: Path, days: int) -> PastFigures:
    names = [f"city_segment_{number:05d}" for number in range(ROADS)]
    watched = {f"rsu-{n // 20:02d}": names[n : n + 20] for n in range(0, ROADS, 20)}
    scene = Scene(Places(_network(names)))
    with storage.open_reader(url) as reader:
        span = reader.span()
        assert span is not None
        # Late on the first day: 200 cycles lie before it.
        begin_ns = span[0] + 70_000 * 10**9
        book = EnergyBook(reader, None, Factors(0.4, 0.3))
        past = StoredPast(reader, scene, book, watched)

        cpu = []

        def look(time_ns: int) -> tuple[float, Mapping[str, Any], int]:
            begun, begun_cpu = time.monotonic(), time.thread_time()
            moment = past.at(time_ns).moment
            size = len(encoded(moment))
            cpu.append(time.thread_time() - begun_cpu)
            return time.monotonic() - begun, moment, size

        first_s, moment, size = look(begin_ns)
        if len(moment["roads"]) != ROADS or len(moment["vehicles"]) != VANS:
            raise RuntimeError("the moment is not whole")
        if not (moment["orders"] and len(moment["cycles"]) == 200 and moment["energy"]["today"]):
            raise RuntimeError("the moment has no orders, cycles or energy")
        if not any(row["x"] is not None for row in moment["vehicles"].values()):
            raise RuntimeError("no vehicle has a place")
        hours = [look(begin_ns + n * 3601 * 10**9)[0] for n in range(1, 12)]
        played = [look(begin_ns + 500 * 10**9 + n * 30 * 10**9)[0] for n in range(20)]
    return PastFigures(
        days,
        first_s,
        (median(hours), max(hours)),
        (median(played), max(played)),
        (median(cpu), max(cpu)),
        size,
        path.stat().st_size / 1e9,
    )


def checks(figures: PastFigures) -> list[Check]:
    """The aim, and what else was measured."""
    slowest = max(figures.first_s, figures.moment_s[1], figures.play_s[1])
    return [
        at_most(
            f"a moment {figures.days} days back, the slowest of 32",
            f"{slowest:.2f} s",
            slowest,
            MAX_S,
        ),
        Check("such a moment, median", f"{figures.moment_s[0]:.2f} s", "–", None),
        Check("played at 60 times, median", f"{figures.play_s[0]:.2f} s", "–", None),
        Check("its processor time, longest", f"{figures.cpu_s[1]:.2f} s", "–", None),
        Check("such a moment as JSON", f"{figures.bytes / 1e3:.0f} kB", "–", None),
    ]
