"""A dispatcher on a bus and a store that write down what happens."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.settings import DispatcherSettings, OrderSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import Solve, solve_in_process
from slipstream.energy.ledger import PlanEnergy
from slipstream.messages import (
    CycleReport,
    Message,
    SegmentState,
    VehiclePlan,
    state_key,
)
from slipstream.orders import FleetRecords
from storage import CycleInputs, Event, RollUp, Room, StorageError

State = Callable[..., SegmentState]


SETTINGS = DispatcherSettings(solvers=("exact",), orders=OrderSettings(bundle_s=0.0))


@dataclass
class Log:
    """A bus and a store that write down what happens, in order."""

    events: list[tuple[str, object]] = field(default_factory=list)
    broken: bool = False
    old: int = 0
    pruned: list[int] = field(default_factory=list)
    rollups: list[RollUp] = field(default_factory=list)
    told: list[Event] = field(default_factory=list)

    def publisher(self, key: str) -> _Outlet:
        """A publisher that writes down."""
        return _Outlet(self, key)

    def record_cycle(
        self,
        report: CycleReport,
        plans: Sequence[VehiclePlan],
        states: Sequence[SegmentState],
        records: FleetRecords | None = None,
        made_from: CycleInputs | None = None,
        energies: Mapping[str, PlanEnergy] | None = None,
    ) -> None:
        """Store, or fail as a full disk does."""
        if self.broken:
            raise StorageError("x.db: disk full")
        self.events.append(("stored", (report, plans, states)))

    def next_cycle_number(self) -> int:
        """Six cycles came before."""
        return 7

    def prune(self, keep_days: float, now_ns: int, *, limit: int, budget_s: float) -> int:
        """Delete of what is old as much as is allowed."""
        deleted = min(self.old, limit)
        self.old -= deleted
        self.pruned.append(deleted)
        return deleted

    def note_time(self, now_ns: int) -> None:
        """It is as trusted as before."""

    def trust_clock(self, now_ns: int) -> None:
        """It is right."""

    def trim(self, keep_mb: float, *, limit: int) -> int:
        """Nothing is too much."""
        return 0

    def add_rollups(self, minutes: Sequence[RollUp]) -> None:
        """Store, or fail as a full disk does."""
        if self.broken:
            raise StorageError("x.db: disk full")
        self.rollups += minutes

    def save_fleet(self, records: FleetRecords) -> None:
        """Store what vehicles reported."""
        self.events.append(("stored", records))

    def save_events(self, changed: Sequence[Event]) -> None:
        """Store, or fail as a full disk does."""
        if self.broken:
            raise StorageError("x.db: disk full")
        self.told += changed

    def load_alarms(self, ended_ns: int) -> tuple[Event, ...]:
        """None was in force."""
        return ()

    def last_event(self, kinds: Collection[str]) -> Event | None:
        """As `Database.last_event`."""
        return next((event for event in reversed(self.told) if event.kind in kinds), None)

    def room(self) -> Room | None:
        """Enough."""
        return Room(10**6, 10**12)

    def tidy(self, now_ns: int, *, budget_s: float) -> bool:
        """No traffic is old."""
        return False

    def published(self, kind: type[Message]) -> list[object]:
        """Messages of one type, in order."""
        return [what for _, what in self.events if isinstance(what, kind)]


@dataclass
class _Outlet:
    log: Log
    key: str

    def put(self, message: Message | bytes) -> None:
        self.log.events.append((self.key, message))


def make(demo: RoutingProblem, log: Log, solve: Solve | None = None) -> Dispatcher:
    """A dispatcher on a written-down bus."""
    return Dispatcher(
        SETTINGS, demo.network, demo.fleet, log, log, solve or solve_in_process([ExactSolver()])
    )


def feed(dispatcher: Dispatcher, state: State, segment: str, y_e: int | None) -> None:
    """Send a fresh state."""
    seen = state(segment, y_e, time_ns=time.time_ns())
    dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
