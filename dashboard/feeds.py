"""Feeds of the live data: the bus, and the dispatcher's database for the history."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final

import storage
from dashboard import metrics
from dashboard.live import LiveData
from slipstream.bus import Bus
from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream.messages import (
    ALL_PLANS,
    ALL_POSITIONS,
    ALL_PREVIEWS,
    ALL_RSU_HEALTH,
    ALL_STATES,
    ALL_STOPPED,
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    CycleReport,
)
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

HISTORY_PERIOD_S: Final = 5.0


def subscribe(bus: Bus, live: LiveData, limiter: LogLimiter) -> None:
    """Subscribe the live data to all messages but camera pictures."""
    for kind, key_expression, handler in (
        ("state", ALL_STATES, live.on_state),
        ("stopped", ALL_STOPPED, live.on_stopped),
        ("rsu_health", ALL_RSU_HEALTH, live.on_rsu_health),
        ("plan", ALL_PLANS, live.on_plan),
        ("position", ALL_POSITIONS, live.on_position),
        ("cycle", CYCLE_KEY, live.on_cycle),
        ("dispatcher_health", DISPATCHER_HEALTH_KEY, live.on_dispatcher_health),
    ):
        bus.subscribe(
            key_expression,
            _counting_handler(kind, handler, limiter),
            # The others come each second.
            history=kind in ("plan", "cycle", "dispatcher_health"),
            every=kind == "cycle",
        )


class PreviewFeed:
    """Subscribes to camera pictures only while a browser is connected.

    RSUs encode pictures only for subscribers, so a page without browsers costs them nothing.
    Pictures have a bus session of their own, which can be closed independently.
    """

    def __init__(self, settings: BusSettings, live: LiveData, limiter: LogLimiter) -> None:
        self._settings = settings
        self._live = live
        self._limiter = limiter
        self._bus: Bus | None = None

    def set_active(self, active: bool) -> None:
        """Subscribe or unsubscribe."""
        if active and self._bus is None:
            self._bus = Bus.open(self._settings)
            handler = _counting_handler("preview", self._live.on_preview, self._limiter)
            self._bus.subscribe(ALL_PREVIEWS, handler, history=False)
        elif not active and self._bus is not None:
            self._bus.close()
            self._bus = None


class HistoryFeed(threading.Thread):
    """A thread that reads stored cycles and plans at its start and after each new cycle.

    It is a thread because a busy database may block a reader for seconds.

    Raises:
        InputError: the database URL is invalid.
    """

    def __init__(self, url: str, live: LiveData, cycles: int, limiter: LogLimiter) -> None:
        super().__init__(name="history", daemon=True)
        self._reader = storage.open_reader(url)
        self._live = live
        self._cycles = cycles
        self._limiter = limiter
        self._latest: tuple[int, int] | None = None
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
            if latest is not None and (latest.cycle, latest.started_ns) != self._latest:
                history = self._reader.cycles(self._cycles_to_read(latest), gates=False)
                self._live.add_history(history, self._reader.latest_plans())
                self._latest = (latest.cycle, latest.started_ns)
            self._live.set_history_problem(None)
        except (storage.StorageError, ValueError) as error:
            self._live.set_history_problem(f"No stored history: {error}")
            if self._limiter.allow("history"):
                log.warning("no stored history: %s", error)

    def _cycles_to_read(self, latest: CycleReport) -> int:
        """Number of cycles to read: those since the last read, or all if numbers start again."""
        if self._latest is None:
            return self._cycles
        number, started_ns = self._latest
        if latest.cycle <= number or latest.started_ns <= started_ns:
            return self._cycles
        return min(latest.cycle - number, self._cycles)

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
