"""Feeds of the live data: the bus, and the dispatcher's database for the history."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Final

import storage
from dashboard import metrics
from dashboard.live import HISTORY_CYCLES, LiveData
from dashboard.web.pictures import Pictures
from dashboard.web.tables.rows import ENDED_ORDERS_FOR_S
from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.messages import (
    ALARMS_KEY,
    ALL_COUNTS,
    ALL_PLANS,
    ALL_POSITIONS,
    ALL_RSU_HEALTH,
    ALL_RUNNING_COUNTS,
    ALL_STATES,
    ALL_STOPPED,
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    CycleReport,
    state_key,
)
from slipstream.orders import OrderRecord, drafting_kwh
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

HISTORY_PERIOD_S: Final = 5.0
MORE_PERIOD_S: Final = 60.0
"""What depends on cycles is read after each new one, and so often: a day ends without one too."""


def subscribe(
    bus: Bus, live: LiveData, limiter: LogLimiter, rsus: Mapping[str, Iterable[str]] | None = None
) -> None:
    """Subscribe the live data to all messages but camera pictures."""

    def on_plan(key: str, payload: bytes) -> None:
        live.on_plan(key, payload)
        # The key was checked to be that of its vehicle.
        bus.expect([f"{key.removesuffix('plan')}position"])

    for kind, key_expression, handler in (
        ("state", ALL_STATES, live.on_state),
        ("stopped", ALL_STOPPED, live.on_stopped),
        ("counts", ALL_COUNTS, live.on_counts),
        ("running_counts", ALL_RUNNING_COUNTS, live.on_counts),
        ("rsu_health", ALL_RSU_HEALTH, live.on_rsu_health),
        ("plan", ALL_PLANS, on_plan),
        ("position", ALL_POSITIONS, live.on_position),
        ("cycle", CYCLE_KEY, live.on_cycle),
        ("dispatcher_health", DISPATCHER_HEALTH_KEY, live.on_dispatcher_health),
        ("alarms", ALARMS_KEY, live.on_alarms),
    ):
        bus.subscribe(
            key_expression,
            _counting_handler(kind, handler, limiter),
            # The others come each second, or each minute.
            history=kind in ("counts", "plan", "cycle", "dispatcher_health", "alarms"),
            every=kind == "cycle",
        )
    bus.expect(state_key(rsu, road) for rsu, roads in (rsus or {}).items() for road in roads)


def listen_to_pictures(bus: Bus, pictures: Pictures, limiter: LogLimiter) -> None:
    """Have pictures come in of those units that are looked at."""
    handler = _counting_handler("preview", pictures.accept, limiter)
    pictures.listen_by(bus.listener("pictures", handler))


class HistoryFeed(threading.Thread):
    """A thread that reads stored orders, and cycles and plans at its start and after each new one.

    It is a thread because a busy database may block a reader for seconds.

    Raises:
        InputError: the database URL is invalid.
    """

    def __init__(
        self,
        url: str,
        live: LiveData,
        limiter: LogLimiter,
        read_more: Callable[[int], None] = lambda _: None,
    ) -> None:
        super().__init__(name="history", daemon=True)
        self._read_more = read_more
        self._read_more_at = -MORE_PERIOD_S
        self._reader = storage.open_reader(url)
        self._live = live
        self._limiter = limiter
        self._latest: tuple[int, int] | None = None
        self._orders: dict[str, OrderRecord] = {}
        self._stopping = threading.Event()

    def run(self) -> None:
        """Read every `HISTORY_PERIOD_S` until stopped."""
        while True:
            self.refresh()
            if self._stopping.wait(HISTORY_PERIOD_S):
                break
        self._reader.close()

    def refresh(self) -> None:
        """Read once; if the database cannot be read, the page shows the reason."""
        try:
            latest = self._reader.latest_cycle()
            is_new = latest is not None and (latest.cycle, latest.started_ns) != self._latest
            if latest is not None and is_new:
                history = self._reader.cycles(self._cycles_to_read(latest), gates=False)
                records = self._reader.latest_plan_records()
                self._live.add_history(history, [record.plan for record in records])
                self._live.set_drafting(drafting_kwh(records))
                self._latest = (latest.cycle, latest.started_ns)
            oldest_ns = time.time_ns() - round(ENDED_ORDERS_FOR_S * 1e9)
            orders = self._reader.orders(ended_since_ns=oldest_ns)
            # One that has not changed stays the same object: nothing is made of it anew.
            self._orders = {order.order: self._known(order) for order in orders}
            self._live.tell(orders=tuple(self._orders.values()), has_database=self._reader.exists())
            if is_new or time.monotonic() - self._read_more_at >= MORE_PERIOD_S:
                self._read_more_at = time.monotonic()
                self._read_more(time.time_ns())
            self._live.tell(history_problem=None)
        except (storage.StorageError, ValueError) as error:
            self._live.tell(history_problem=f"No stored history: {error}")
            if self._limiter.allow("history"):
                log.warning("no stored history: %s", error)

    def _known(self, order: OrderRecord) -> OrderRecord:
        before = self._orders.get(order.order)
        return before if before == order else order

    def _cycles_to_read(self, latest: CycleReport) -> int:
        """Number of cycles to read: those since the last read, or all if numbers start again."""
        if self._latest is None:
            return HISTORY_CYCLES
        number, started_ns = self._latest
        if latest.cycle <= number or latest.started_ns <= started_ns:
            return HISTORY_CYCLES
        return min(latest.cycle - number, HISTORY_CYCLES)

    def stop(self) -> None:
        """Stop reading; does not wait for a read in progress."""
        self._stopping.set()


def _counting_handler(
    kind: str, handler: Callable[[str, bytes], None], limiter: LogLimiter
) -> Callable[[str, bytes], None]:
    messages = metrics.MESSAGES.labels(kind)
    bad_messages = metrics.BAD_MESSAGES.labels(kind)

    def handle(key: str, payload: bytes) -> None:
        messages.inc()
        try:
            handler(key, payload)
        except InputError as error:
            bad_messages.inc()
            if limiter.allow(kind):
                log.warning("%s (%d more like it)", error, limiter.suppressed(kind))

    return handle
