"""Stores the cycles of weeks one after the other, as the dispatcher does, and measures."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final

import storage
from dispatcher_daemon.service.store import PRUNE_BATCH, TIDY_S, delete_old_traffic
from slipstream.messages import VehiclePlan
from slipstream.orders import FleetRecords, PlanRecord
from slipstream_lab.benchmarks.aims import Check, at_most, report_head, write_report
from slipstream_lab.benchmarks.storage.city import CYCLE_S, START_NS, CityCycle, StoredCity

CYCLES_A_DAY: Final = 86_400 // CYCLE_S
MAX_GB: Final = 2.0
MAX_QUARTER_GB: Final = 5.0
MAX_QUERY_MS: Final = 50.0
MIN_DAYS: Final = 5
"""Days whose second half is later than all minutes that are still kept."""
MAX_PURGE_MS: Final = 100.0
_KEEP_DAYS: Final = 90.0
_KEEP_MB: Final = 10_000.0
_REPEATS: Final = 21
_BACKLOG_CALLS: Final = 10


@dataclass(frozen=True)
class StorageFigures:
    """What was measured of one database.

    Attributes:
        purge_ms: what is deleted after a cycle: median, and the longest of its calls, between
            which others write.
        backlog_ms: longest call that deletes cycles of half the time, up to 50 each.
        purge_cpu_ms: processor time of the deletion after a cycle in this process, where SQLite
            does all its work: median and longest. It says what other work on the machine hides.
    """

    kind: str
    days: int
    segments: int
    gb: float
    gb_a_day: float
    record_ms: tuple[float, float]
    rollup_ms: tuple[float, float]
    purge_ms: tuple[float, float]
    backlog_ms: float
    queries_ms: Mapping[str, float]
    purge_cpu_ms: tuple[float, float]
    queries_cpu_ms: Mapping[str, float]

    def gb_after(self, days: int) -> float:
        """Size after so many days, GB: by the growth of the second half where they are more."""
        return self.gb + self.gb_a_day * (days - self.days)


def measure(
    kind: str,
    url: str,
    size: Callable[[], int],
    days: int,
    segments: int,
    say: Callable[[str], None],
) -> StorageFigures:
    """Store so many days in an empty database and measure it."""
    city = StoredCity(segments)
    record, rollup, purge, purge_cpu = [], [], [], []
    cycles = days * CYCLES_A_DAY
    half, longest_ms = 0, 0.0
    before: Sequence[VehiclePlan] = ()
    with storage.open_database(url, owned=True) as database:
        for number in range(1, cycles + 1):
            cycle = city.cycle(number)
            now_ns = cycle.report.started_ns
            # Vehicles end their tours: a plan is in force until the next cycle.
            ended = FleetRecords(plans=tuple(PlanRecord(plan, "done", now_ns) for plan in before))
            before = cycle.plans

            def store(cycle: CityCycle = cycle, ended: FleetRecords = ended) -> None:
                database.record_cycle(cycle.report, cycle.plans, cycle.states, ended)

            record.append(_ms(store))
            rollup.append(_ms(lambda c=cycle: database.add_rollups(c.minutes)))  # type: ignore[misc]

            began_cpu = time.thread_time()
            steps = _Steps(database)
            steps.ms.append(_ms(lambda: database.trim(_KEEP_MB, limit=PRUNE_BATCH)))
            delete_old_traffic(steps.tidy, now_ns)
            prune = partial(database.prune, limit=PRUNE_BATCH, budget_s=TIDY_S)
            steps.ms.append(_ms(lambda: prune(_KEEP_DAYS, now_ns)))  # noqa: B023 - called here
            purge.append(sum(steps.ms))
            longest_ms = max(longest_ms, *steps.ms)
            purge_cpu.append(1e3 * (time.thread_time() - began_cpu))
            if number == cycles // 2:
                half = size()
            if number % CYCLES_A_DAY == 0:
                say(f"{kind}: day {number // CYCLES_A_DAY} of {days}, {size() / 1e6:.0f} MB")
        whole = size()
        queries, queries_cpu = _queries(url, city.cycle(cycles + 1).states[0].segment, now_ns)
        backlog = [
            _ms(lambda: database.prune(days / 2, now_ns, limit=PRUNE_BATCH, budget_s=TIDY_S))
            for _ in range(_BACKLOG_CALLS)
        ]
    return StorageFigures(
        kind,
        days,
        segments,
        whole / 1e9,
        (whole - half) / 1e9 / (days / 2),
        (median(record), max(record)),
        (median(rollup), max(rollup)),
        (median(purge), longest_ms),
        max(backlog),
        queries,
        (median(purge_cpu), max(purge_cpu)),
        queries_cpu,
    )


class _Steps:
    """Deletes old traffic and notes how long each call takes."""

    def __init__(self, database: storage.Database) -> None:
        self._database = database
        self.ms: list[float] = []

    def tidy(self, now_ns: int, *, budget_s: float) -> bool:
        """As `storage.Database.tidy`."""
        began = time.monotonic()
        more = self._database.tidy(now_ns, budget_s=budget_s)
        self.ms.append(1e3 * (time.monotonic() - began))
        return more


def _queries(url: str, segment: str, now_ns: int) -> tuple[dict[str, float], dict[str, float]]:
    """By query, ms: median time, and mean processor time in this process."""
    hour_ns = 3600 * 10**9
    with storage.open_reader(url) as reader:
        calls: dict[str, Callable[[], object]] = {
            "the latest cycle with its gates": reader.latest_cycle,
            "200 cycles for the page": lambda: reader.cycles(200, gates=False),
            "the latest plans": reader.latest_plan_records,
            "states of the latest cycle": lambda: reader.states(
                (now_ns - START_NS) // (CYCLE_S * 10**9)
            ),
            "all segments an hour ago": lambda: reader.segments_at(now_ns - hour_ns),
            "all segments half the time ago": lambda: reader.segments_at((now_ns + START_NS) // 2),
            "a segment's last hour by minute": lambda: reader.rollups(
                segment, now_ns - hour_ns, now_ns
            ),
            "a segment's last day by minute": lambda: reader.rollups(
                segment, now_ns - 24 * hour_ns, now_ns
            ),
            "a segment by hour, the whole time": lambda: reader.rollups(
                segment, 0, now_ns, period_s=3600
            ),
        }
        found, cpu = {}, {}
        for name, call in calls.items():
            if not call():
                raise RuntimeError(f"nothing was found: {name}")
            began_cpu = time.thread_time()
            found[name] = median(_ms(call) for _ in range(_REPEATS))
            cpu[name] = 1e3 * (time.thread_time() - began_cpu) / _REPEATS
        return found, cpu


def _ms(call: Callable[[], object]) -> float:
    began = time.monotonic()
    call()
    return 1e3 * (time.monotonic() - began)


def checks(figures: StorageFigures) -> list[Check]:
    """The aims of one database; those of sizes from `MIN_DAYS` of 1,000 segments on."""
    slowest = max(figures.queries_ms.values())
    purge = max(figures.purge_ms[1], figures.backlog_ms)
    # By then minutes go as they come, and the growth is the one that lasts.
    lasting = figures.days >= MIN_DAYS and figures.segments >= 1000
    sizes = []
    for days, limit_gb in ((30, MAX_GB), (90, MAX_QUARTER_GB)):
        gb = figures.gb_after(days)
        how = "" if days == figures.days else f", by the growth until day {figures.days}"
        sizes.append(
            Check(
                f"{figures.kind}: size after {days} days{how}",
                f"{gb:.2f} GB" if lasting else "–",
                f"≤ {limit_gb:g}",
                gb <= limit_gb if lasting else None,
            )
        )
    return [
        *sizes,
        at_most(
            f"{figures.kind}: slowest query, median", f"{slowest:.0f} ms", slowest, MAX_QUERY_MS
        ),
        at_most(
            f"{figures.kind}: longest deletion after a cycle",
            f"{purge:.0f} ms",
            purge,
            MAX_PURGE_MS,
        ),
    ]


def write(folder: Path, all_figures: list[StorageFigures], about: Mapping[str, str]) -> None:
    """Write report.md and report.json."""
    folder.mkdir(parents=True, exist_ok=True)
    aims = [check for figures in all_figures for check in checks(figures)]
    lines = report_head("Storage", about, aims)
    for figures in all_figures:
        about_size = (
            f"{figures.gb:.2f} GB after {figures.days} days, {figures.gb_a_day:.3f} more a day"
        )
        lines += [
            "",
            f"## {figures.kind}",
            "",
            about_size,
            "",
            "| what | ms (median, longest) |",
            "|---|--:|",
        ]
        for name, (middle, longest) in (
            ("a cycle with plans and states", figures.record_ms),
            ("its roll-ups", figures.rollup_ms),
            ("deletion after it", figures.purge_ms),
        ):
            lines.append(f"| {name} | {middle:.1f}, {longest:.0f} |")
        lines.append(f"| up to {PRUNE_BATCH} cycles of a backlog | –, {figures.backlog_ms:.0f} |")
        middle, longest = figures.purge_cpu_ms
        lines.append(
            f"| processor time of deletion in this process | {middle:.1f}, {longest:.0f} |"
        )
        lines += ["", "| query | ms (median) | processor time in this process, ms (mean) |"]
        lines.append("|---|--:|--:|")
        lines += [
            f"| {name} | {value:.1f} | {figures.queries_cpu_ms[name]:.1f} |"
            for name, value in figures.queries_ms.items()
        ]
    content = {"databases": [asdict(figures) for figures in all_figures]}
    write_report(folder, "\n".join(lines) + "\n", about, content)
