"""What is wrong with the dispatcher, its database, its solvers, the bus and the cluster."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.service.alarms.conditions import Condition
from slipstream.messages import CycleReport, HardwareHealth, Severity
from storage import Room

NEARLY_FULL: Final = 0.9
"""Share of keep_mb from which the database is nearly full."""
DISK_LOW_BYTES: Final = 1e9
DISK_EMPTY_BYTES: Final = 2e8
"""Free room of its disk below which the alarm is critical: some cycles of a large city."""


UNANSWERED: Final = 3
"""Cycles in a row without an answer of any solver that is asked, from which none of them works."""


@dataclass(frozen=True)
class ServiceFacts:
    """The dispatcher and what it needs, at one moment.

    Attributes:
        unanswered: cycles in a row until the last one in which each solver died, raised or hung.
        running_s: how long the cycle that runs now has been; None: none runs.
        paused: by whom, and UTC ns since when; None: it is not.
        storage_fault: why the last cycle could not be stored; None: it could.
        clock_fault: why nothing is deleted for its age; None: it is.
        set_aside: file that a damaged database became.
        room: of the database and on its disk; None: it is on a server.
    """

    interval_s: float
    cycle: CycleReport | None = None
    unanswered: int = 0
    running_s: float | None = None
    paused: tuple[str, int] | None = None
    storage_fault: str | None = None
    clock_fault: str | None = None
    bus_fault: str | None = None
    set_aside: str | None = None
    keep_mb: float = 10_000.0
    room: Room | None = None
    device: HardwareHealth | None = None
    solver_fault: str | None = None
    cluster_slots: int | None = None


def service_conditions(facts: ServiceFacts) -> Iterator[Condition]:
    """What is wrong."""
    if facts.paused is not None:
        by, since_ns = facts.paused
        text = f"paused by {by}: no cycle runs, vehicles go on by the plans that they have"
        yield Condition("paused", "dispatcher", text, since_ns)
    if facts.bus_fault is not None:
        text = f"{facts.bus_fault}: nothing comes in, and no plan goes out"
        yield Condition("bus_lost", "dispatcher", text)
    if facts.cycle is not None:
        yield from _of_cycle(facts.cycle, facts)
    if facts.running_s is not None and facts.running_s > facts.interval_s:
        text = f"a cycle has run for longer than {facts.interval_s:g} s, the time between two"
        yield Condition("cycle_overran", "dispatcher", text)
    yield from _of_database(facts)
    broken = [
        f"{run.solver}: {run.reason or 'failed'}"
        for run in (() if facts.cycle is None else facts.cycle.solvers)
        if run.status == "failed"
    ]
    if facts.device is not None and facts.device.breaker == "open":
        broken.append(f"{facts.device.backend}: {facts.device.line or 'its breaker is open'}")
    if facts.solver_fault is not None:
        yield Condition("solver_broken", "dispatcher", facts.solver_fault, severity="critical")
    elif broken:
        yield Condition("solver_broken", "dispatcher", "; ".join(broken)[:1000])
    if facts.cluster_slots == 0:
        text = "no worker of the cluster is ready: this machine solves alone"
        yield Condition("cluster_lost", "cluster", text)


def _of_cycle(cycle: CycleReport, facts: ServiceFacts) -> Iterator[Condition]:
    # One that could not be stored is the database's fault, which is told of itself.
    if cycle.status == "failed" and facts.storage_fault is None:
        text = f"cycle {cycle.cycle} failed: {cycle.reason}; vehicles keep the plans that they have"
        yield Condition("cycle_failed", "dispatcher", text, cycle.started_ns)
    if cycle.wall_s > facts.interval_s:
        text = (
            f"cycle {cycle.cycle} took {cycle.wall_s:.0f} s, with {facts.interval_s:g} between two"
        )
        yield Condition("cycle_overran", "dispatcher", text, cycle.started_ns)
    solved = any(run.status in ("optimal", "feasible") for run in cycle.solvers)
    if cycle.status == "baseline" and not solved:
        text = f"cycle {cycle.cycle}: {cycle.reason}"
        severity: Severity | None = None
        if facts.unanswered >= UNANSWERED:
            severity, text = "critical", f"no solver answers, for {facts.unanswered} cycles: {text}"
        yield Condition("baseline_only", "dispatcher", text, severity=severity)


def _of_database(facts: ServiceFacts) -> Iterator[Condition]:
    if facts.storage_fault is not None:
        yield Condition("database_fault", "database", facts.storage_fault)
    if facts.set_aside is not None:
        text = f"it was damaged and set aside as {facts.set_aside}; a new one began"
        yield Condition("database_set_aside", "database", text)
    if facts.clock_fault is not None:
        yield Condition("clock_untrusted", "database", facts.clock_fault)
    if facts.room is None:
        return
    if facts.room.size_bytes > NEARLY_FULL * facts.keep_mb * 1e6:
        text = f"nine tenths of keep_mb, {facts.keep_mb:g} MB, are in use: beyond it the oldest "
        yield Condition("database_nearly_full", "database", f"{text}cycles go before keep_days")
    if facts.room.free_bytes < DISK_LOW_BYTES:
        text = f"{facts.room.free_bytes / 1e6:.0f} MB are left on the disk of the database"
        empty = facts.room.free_bytes < DISK_EMPTY_BYTES
        severity: Severity | None = "critical" if empty else None
        yield Condition("disk_nearly_full", "database", text, severity=severity)
