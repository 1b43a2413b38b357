"""The latest message of each kind, in bounded memory, shared by the bus threads and the page."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeVar

from slipstream.errors import InputError
from slipstream.freshness import FUTURE_TOLERANCE_S, is_ahead
from slipstream.messages import (
    ALARMS_KEY,
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    Alarms,
    CycleReport,
    DispatcherHealth,
    RsuHealth,
    SegmentCounts,
    SegmentState,
    StoppedVehicles,
    Unserved,
    VehiclePlan,
    VehiclePosition,
    counts_key,
    decode,
    plan_key,
    position_key,
    rsu_health_key,
    running_counts_key,
    state_key,
    stopped_key,
)
from slipstream.orders import OrderRecord
from slipstream.roads.admission import Refusal

HISTORY_CYCLES: Final = 200
"""Cycles that are kept."""
MAX_ENTRIES: Final = 20_000
"""Maximum number of segment states, RSUs and vehicles kept, each; the oldest are dropped first."""

_K = TypeVar("_K")
_V = TypeVar("_V")
_Roadside = TypeVar("_Roadside", SegmentState, StoppedVehicles)
OfSegment = SegmentState | StoppedVehicles | SegmentCounts
"""What an RSU tells of a segment."""


@dataclass(frozen=True)
class Snapshot:
    """The latest messages at one moment.

    Attributes:
        counts: of the last complete quarter hour, by segment and RSU; of the one that runs.
        followed: the plan that each vehicle last reported to follow; it may be older than its
            latest one.
        cycles: reports in ascending order of their numbers; only the last one has its solvers,
            gates and the orders that it leaves unserved.
        cycle_failed_ns: UTC of the last increase of its count of failed cycles.
        flag_since: UTC since when each state's flag is what it is, by segment and RSU.
        has_database: whether there is one; True until it was looked for.
        drafting_kwh: what platoons save of a plan, by vehicle and cycle, as far as it is stored.
    """

    states: Mapping[tuple[str, str], SegmentState] = field(default_factory=dict)
    stopped: Mapping[tuple[str, str], StoppedVehicles] = field(default_factory=dict)
    counts: Mapping[tuple[str, str], SegmentCounts] = field(default_factory=dict)
    running_counts: Mapping[tuple[str, str], SegmentCounts] = field(default_factory=dict)
    rsus: Mapping[str, RsuHealth] = field(default_factory=dict)
    plans: Mapping[str, VehiclePlan] = field(default_factory=dict)
    positions: Mapping[str, VehiclePosition] = field(default_factory=dict)
    followed: Mapping[str, VehiclePlan] = field(default_factory=dict)
    cycles: Sequence[CycleReport] = ()
    dispatcher: DispatcherHealth | None = None
    cycle_failed_ns: int | None = None
    history_problem: str | None = None
    flag_since: Mapping[tuple[str, str], int] = field(default_factory=dict)
    orders: Sequence[OrderRecord] = ()
    alarms: Alarms | None = None
    connected: bool = True
    has_database: bool = True
    drafting_kwh: Mapping[tuple[str, int], float] = field(default_factory=dict)


class LiveData:
    """Stores messages from any thread and returns consistent snapshots of the latest.

    Args:
        clock_ns: UTC in ns. A message dated ahead of it is replaced by any other, so that a clock
            that was set back does not block the page.
        refusal: why what an RSU tells of a segment is not admitted; None: it is.
    """

    def __init__(
        self,
        clock_ns: Callable[[], int],
        refusal: Callable[[OfSegment], Refusal | None] = lambda _: None,
    ) -> None:
        self._refusal = refusal
        self._clock_ns = clock_ns
        self._lock = threading.Lock()
        self._states: OrderedDict[tuple[str, str], SegmentState] = OrderedDict()
        self._stopped: OrderedDict[tuple[str, str], StoppedVehicles] = OrderedDict()
        self._counts: OrderedDict[tuple[str, str], SegmentCounts] = OrderedDict()
        self._running_counts: OrderedDict[tuple[str, str], SegmentCounts] = OrderedDict()
        self._rsus: OrderedDict[str, RsuHealth] = OrderedDict()
        self._plans: OrderedDict[str, VehiclePlan] = OrderedDict()
        self._positions: OrderedDict[str, VehiclePosition] = OrderedDict()
        self._followed: OrderedDict[str, VehiclePlan] = OrderedDict()
        self._cycles: dict[int, CycleReport] = {}
        # What is no table; its tables stay empty.
        self._told = Snapshot()
        self._flag_since: dict[tuple[str, str], int] = {}
        self._drafting: dict[tuple[str, int], float] = {}

    def on_state(self, key: str, payload: bytes) -> None:
        """Store a SegmentState.

        Raises:
            InputError: the payload is no SegmentState, or belongs under another key (so for each
                of the methods ``on_...``), or it is not admitted.
        """
        state = decode(SegmentState, payload, key)
        _check_key(key, state_key(state.rsu, state.segment))
        self._check_admitted(key, state, "state")
        self._put_of_road(self._states, state)

    def on_stopped(self, key: str, payload: bytes) -> None:
        """Store a StoppedVehicles: admitted as a SegmentState is."""
        stopped = decode(StoppedVehicles, payload, key)
        _check_key(key, stopped_key(stopped.rsu, stopped.segment))
        self._check_admitted(key, stopped, "stopped vehicles")
        self._put_of_road(self._stopped, stopped)

    def on_counts(self, key: str, payload: bytes) -> None:
        """Store a SegmentCounts, complete or of the running quarter hour by its key: admitted as a
        SegmentState is.
        """
        counts = decode(SegmentCounts, payload, key)
        name = (counts.segment, counts.rsu)
        of_key = counts_key if counts.complete else running_counts_key
        _check_key(key, of_key(counts.rsu, counts.segment))
        self._check_admitted(key, counts, "counts")
        entries = self._counts if counts.complete else self._running_counts
        self._put(entries, name, counts, counts.until_ns, lambda old: old.until_ns)

    def on_rsu_health(self, key: str, payload: bytes) -> None:
        """Store an RsuHealth."""
        health = decode(RsuHealth, payload, key)
        _check_key(key, rsu_health_key(health.rsu))
        self._put(self._rsus, health.rsu, health, health.time_ns, lambda old: old.time_ns)

    def on_plan(self, key: str, payload: bytes) -> None:
        """Store a VehiclePlan."""
        plan = decode(VehiclePlan, payload, key)
        _check_key(key, plan_key(plan.vehicle))
        self._add_plan(plan)

    def on_position(self, key: str, payload: bytes) -> None:
        """Store a VehiclePosition."""
        position = decode(VehiclePosition, payload, key)
        _check_key(key, position_key(position.vehicle))
        name, time_ns = position.vehicle, position.time_ns
        self._put(self._positions, name, position, time_ns, lambda old: old.time_ns)
        with self._lock:
            plan = self._plans.get(name)
        if plan is not None and plan.cycle == position.cycle:
            self._put(self._followed, name, plan, plan.issued_ns, lambda old: old.issued_ns)

    def on_cycle(self, key: str, payload: bytes) -> None:
        """Store a CycleReport."""
        report = decode(CycleReport, payload, key)
        _check_key(key, CYCLE_KEY)
        self.add_history((report,), ())

    def on_dispatcher_health(self, key: str, payload: bytes) -> None:
        """Store a DispatcherHealth."""
        health = decode(DispatcherHealth, payload, key)
        _check_key(key, DISPATCHER_HEALTH_KEY)
        with self._lock:
            previous, failed_ns = self._told.dispatcher, self._told.cycle_failed_ns
            if (
                previous is not None
                and previous.started_ns == health.started_ns
                and previous.cycles_failed < health.cycles_failed
            ):
                failed_ns = self._clock_ns()
            self._told = replace(self._told, dispatcher=health, cycle_failed_ns=failed_ns)

    def on_alarms(self, key: str, payload: bytes) -> None:
        """Store the dispatcher's Alarms."""
        alarms = decode(Alarms, payload, key)
        _check_key(key, ALARMS_KEY)
        self.tell(alarms=alarms)

    def add_history(self, cycles: Sequence[CycleReport], plans: Sequence[VehiclePlan]) -> None:
        """Add cycles and plans from the bus or the database; newer ones are kept."""
        # Plans first, as the dispatcher sends them: a vehicle without a new one becomes idle.
        for plan in plans:
            self._add_plan(plan)
        with self._lock:
            for report in cycles:
                self._add_cycle(report)
            for number in sorted(self._cycles)[:-HISTORY_CYCLES]:
                del self._cycles[number]
            # In a city each report has hundreds of gates; only those of the last one are shown.
            for number in sorted(self._cycles)[:-1]:
                self._cycles[number] = without_details(self._cycles[number])

    def set_drafting(self, saved_kwh: dict[tuple[str, int], float]) -> None:
        """Set what platoons save of the latest stored plans, by vehicle and cycle; those before
        are kept once, as a vehicle follows its older plan for a while.
        """
        self.tell(drafting_kwh=self._drafting | saved_kwh)
        self._drafting = saved_kwh

    def tell(self, **facts: Any) -> None:
        """Set fields of the snapshot that are no table of messages."""
        with self._lock:
            self._told = replace(self._told, **facts)

    def snapshot(self) -> Snapshot:
        """A copy of the latest messages."""
        with self._lock:
            return replace(
                self._told,
                states=dict(self._states),
                stopped=dict(self._stopped),
                counts=dict(self._counts),
                running_counts=dict(self._running_counts),
                rsus=dict(self._rsus),
                plans=dict(self._plans),
                positions=dict(self._positions),
                followed=dict(self._followed),
                cycles=tuple(report for _, report in sorted(self._cycles.items())),
                flag_since=dict(self._flag_since),
            )

    def watched(self) -> dict[str, tuple[str, ...]]:
        """The roads of each RSU, as it told last."""
        with self._lock:
            return {name: health.segments for name, health in self._rsus.items()}

    def _add_cycle(self, report: CycleReport) -> None:
        if self._cycles.get(report.cycle) in (report, without_details(report)):
            return
        now_ns = self._clock_ns()
        last = self._cycles[max(self._cycles)] if self._cycles else None
        if (
            last is not None
            and report.cycle <= last.cycle
            and not is_ahead(report.started_ns, now_ns)
            and (report.started_ns > last.started_ns or is_ahead(last.started_ns, now_ns))
        ):
            # A lower number that began later: the dispatcher has another database, or reuses the
            # numbers of cycles that it could not store.
            for number in [n for n in self._cycles if n >= report.cycle]:
                del self._cycles[number]
        self._cycles[report.cycle] = report

    def _add_plan(self, plan: VehiclePlan) -> None:
        self._put(self._plans, plan.vehicle, plan, plan.issued_ns, lambda old: old.issued_ns)

    def _check_admitted(self, key: str, message: OfSegment, what: str) -> None:
        if (refusal := self._refusal(message)) is not None:
            raise InputError(key, f"{what} refused: {refusal.text}", "check the sender")

    def _put_of_road(
        self, entries: OrderedDict[tuple[str, str], _Roadside], message: _Roadside
    ) -> None:
        name = (message.segment, message.rsu)
        tolerance_s = published_tolerance_s(self._told.dispatcher)
        self._put(entries, name, message, message.time_ns, lambda old: old.time_ns, tolerance_s)

    def _put(
        self,
        entries: OrderedDict[_K, _V],
        name: _K,
        value: _V,
        time_ns: int,
        time_of: Callable[[_V], int],
        tolerance_s: float = FUTURE_TOLERANCE_S,
    ) -> None:
        with self._lock:
            old = entries.get(name)
            # Retransmitted samples arrive late: an older one must not replace a newer one.
            if (
                old is not None
                and time_of(old) > time_ns
                and not is_ahead(time_of(old), self._clock_ns(), tolerance_s)
            ):
                return
            entries[name] = value
            entries.move_to_end(name)
            if isinstance(value, SegmentState) and (
                not isinstance(old, SegmentState) or old.y_e != value.y_e
            ):
                # A snapshot has both, or neither.
                self._flag_since[value.segment, value.rsu] = value.time_ns
            if len(entries) > MAX_ENTRIES:
                oldest, _ = entries.popitem(last=False)
                self._flag_since.pop(oldest, None)  # type: ignore[call-overload]


def published_tolerance_s(dispatcher: DispatcherHealth | None) -> float:
    """How far a SegmentState may be dated ahead for the gates, s; the default if not published."""
    tolerance_s = None if dispatcher is None else dispatcher.future_tolerance_s
    return FUTURE_TOLERANCE_S if tolerance_s is None else tolerance_s


_NOT_KEPT: Final = Unserved(stop="?", reason="only those of the last cycle are kept")


def without_details(report: CycleReport) -> CycleReport:
    """The report without solvers, gates, and names of the orders that it leaves unserved: these
    have 1 kB each, and what waits for hours is in each report of it. Their number stays.
    """
    names = report.unserved[:1] not in ((), (_NOT_KEPT,))
    if not (report.solvers or report.gates or names):
        return report
    unserved = (_NOT_KEPT,) * len(report.unserved)
    return report.model_copy(update={"solvers": (), "gates": (), "unserved": unserved})


def _check_key(key: str, expected: str) -> None:
    if key != expected:
        raise InputError(key, f"its message belongs under {expected}", "check the sender")
