"""The dispatcher's use of the database: open it, record cycles, delete what is old or too much."""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from dispatcher_daemon import metrics
from slipstream.energy.ledger import PlanEnergy
from slipstream.messages import CycleReport, SegmentState, VehiclePlan
from slipstream.orders import FleetRecords
from slipstream.service import LogLimiter, Service, notify
from storage import (
    CycleInputs,
    Database,
    OwnedError,
    Reader,
    StorageError,
    UntrustedClockError,
    open_or_set_aside,
)

log = logging.getLogger(__name__)

PRUNE_EVERY_S = 3600.0
PRUNE_BATCH = 50
"""Maximum number of cycles deleted at once; a backlog is deleted in several cycles."""
TIDY_S = 0.05
"""Time after which no further step of one call that deletes begins, s."""
CATCH_UP_S = 1.0
"""Time after which no further call begins after a cycle, s. What is new in a cycle goes in one or
two; a machine on which a step takes long needs more, or old traffic piles up. Others write between
steps."""
STEADY_S = 20 * 3600.0
"""A clock that was not set for so long while the dispatcher ran is trusted, s: less than a day, so
that one that is started anew each night gets there."""
CLOCK_SET_S = 60.0
"""A wall clock that goes this far from the monotonic one was set, s: more than slewing in a day."""
CHECK_LIMIT_S = 3600.0
"""How long the check of the database may hold up the start, s; it takes some seconds a GB."""
TURN_PERIOD_S = 1.0
"""Time between two looks of a standby for the database, s."""
START_LIMIT_S = 180.0
"""Time to be ready after that, s: as TimeoutStartSec= of the unit."""


class PlanStore(Protocol):
    """What storing cycles and their plans needs of the database."""

    def record_cycle(
        self,
        report: CycleReport,
        plans: Sequence[VehiclePlan],
        states: Sequence[SegmentState],
        records: FleetRecords | None = None,
        made_from: CycleInputs | None = None,
        energies: Mapping[str, PlanEnergy] | None = None,
    ) -> None:
        """Store one cycle durably, or raise."""
        ...

    def save_fleet(self, records: FleetRecords) -> None:
        """Store what has changed of orders, plans and vehicles beside a cycle."""
        ...

    def next_cycle_number(self) -> int:
        """Number of the next cycle; opens the database anew where it was replaced."""
        ...


def database_fault(reader: Reader) -> str | None:
    """Why a database cannot be used now; None: it can."""
    try:
        return None if reader.exists() else "there is none yet"
    except StorageError as error:
        return str(error)


def delete_old_traffic(tidy: Callable[..., bool], now_ns: int) -> None:
    """Delete traffic that is too old after a cycle: until there is none, for `CATCH_UP_S` at most,
    in calls of `TIDY_S`.
    """
    ends = time.monotonic() + CATCH_UP_S
    while tidy(now_ns, budget_s=TIDY_S) and time.monotonic() < ends:
        pass


class SteadyClock:
    """Tells how long the wall clock has run with the monotonic one, without having been set."""

    def __init__(self) -> None:
        self._since: tuple[float, float] | None = None

    def steady_s(self, now_ns: int, monotonic_s: float) -> float:
        """Since the first call, or since the clock was set, s."""
        apart_s = now_ns / 1e9 - monotonic_s
        if self._since is None or abs(apart_s - self._since[0]) > CLOCK_SET_S:
            self._since = apart_s, monotonic_s
        return monotonic_s - self._since[1]


class CyclePruner:
    """Deletes while the dispatcher runs: after each cycle what is too much and traffic that is too
    old, once an hour cycles that are too old. A fault is logged and does not stop the dispatcher.

    A clock that is far ahead of the cycles stored deletes nothing for its age until it has run
    steadily for `STEADY_S`.

    Attributes:
        clock_fault: why nothing is deleted for its age, and until when; None: it is.
    """

    def __init__(
        self,
        store: Database,
        keep_days: float,
        keep_mb: float,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._store = store
        self._keep_days = keep_days
        self._keep_mb = keep_mb
        self._monotonic = monotonic
        self._clock = SteadyClock()
        self._limiter = LogLimiter()
        self._pruned_at = self._noted_at = -math.inf
        self.clock_fault: str | None = None

    def after_cycle(self, now_ns: int) -> None:
        """Delete what is due after this cycle."""
        steady_s = self._clock.steady_s(now_ns, self._monotonic())
        try:
            trimmed = self._store.trim(self._keep_mb, limit=PRUNE_BATCH)
            if trimmed and self._limiter.allow("trim"):
                log.info("keep_mb reached: %d of the oldest cycles deleted", trimmed)
            self._note_time(now_ns, steady_s)
            # Before what is tidied: a row that cannot be read would keep all cycles for ever.
            self._prune(now_ns)
            delete_old_traffic(self._store.tidy, now_ns)
            self.clock_fault = None
            metrics.CLOCK_UNTRUSTED.set(0)
        except UntrustedClockError as error:
            if self.clock_fault is None:
                log.warning("%s", error)
            hours = math.ceil(max(0.0, STEADY_S - steady_s) / 3600)
            self.clock_fault = f"{error.problem}; it is believed in {hours} h unless it is set"
            metrics.CLOCK_UNTRUSTED.set(1)
            self._pruned_at = -math.inf
        except Exception as error:
            if self._limiter.allow("prune"):
                log.warning("old cycles could not be deleted: %s", error)

    def _note_time(self, now_ns: int, steady_s: float) -> None:
        """Once an hour: cycles move the trusted time on, but not in a pause, nor after a jump."""
        is_steady = steady_s >= STEADY_S
        recovers = is_steady and self.clock_fault is not None
        if self._monotonic() - self._noted_at < PRUNE_EVERY_S and not recovers:
            return
        (self._store.trust_clock if is_steady else self._store.note_time)(now_ns)
        self._noted_at = self._monotonic()
        if recovers:
            log.warning("the clock has run steadily for %.0f h and is trusted", steady_s / 3600)

    def _prune(self, now_ns: int) -> None:
        """Delete old cycles once an hour, and after each cycle while there are more."""
        if self._monotonic() - self._pruned_at < PRUNE_EVERY_S:
            return
        self._pruned_at = self._monotonic()
        pruned = self._store.prune(self._keep_days, now_ns, limit=PRUNE_BATCH, budget_s=TIDY_S)
        if pruned:
            log.info("%d old cycles deleted", pruned)
            self._pruned_at = -math.inf


def open_checked_database(url: str) -> Database:
    """Open the database as its one dispatcher; systemd gives the check of a large one its time.

    A damaged file is set aside, and a new database begins.

    Raises:
        InputError: it cannot be used, or another dispatcher writes it.
    """
    notify(f"EXTEND_TIMEOUT_USEC={CHECK_LIMIT_S * 1e6:.0f}")
    database = open_or_set_aside(url)
    notify(f"EXTEND_TIMEOUT_USEC={START_LIMIT_S * 1e6:.0f}")
    return database


def open_in_turn(url: str, service: Service) -> Database | None:
    """Wait until no other dispatcher writes the database, and open it.

    Returns:
        The database; None: the service was stopped meanwhile.

    Raises:
        InputError: it cannot be used.
    """
    watchdog = os.environ.get("WATCHDOG_USEC")
    if watchdog:
        # The check of a large file is one call.
        notify(f"WATCHDOG_USEC={CHECK_LIMIT_S * 1e6:.0f}")
    service.ready()
    service.wait_for("standby")
    limiter = LogLimiter()
    metrics.STANDBY.set(1)
    try:
        while True:
            try:
                database = open_checked_database(url)
            except OwnedError:
                service.progress("standby")
            except StorageError as error:
                if limiter.allow("standby"):
                    log.warning("standby: %s", error)
            else:
                log.warning("the database is free: this dispatcher is the active one now")
                service.wait_for("starting")
                return database
            if service.wait(TURN_PERIOD_S):
                return None
    finally:
        metrics.STANDBY.set(0)
        if watchdog:
            notify(f"WATCHDOG_USEC={watchdog}")
