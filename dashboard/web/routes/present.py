"""The present: a thread that brings the tables up to the latest messages, and tells browsers."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from dashboard import metrics
from dashboard.live import LiveData, Snapshot
from dashboard.web.hub import PageHub
from dashboard.web.tables.rows import Known
from dashboard.web.tables.tables import PageTables
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.8
"""Of changes sent to browsers: what is visible is at most so old."""
IDLE_PERIOD_S: Final = 5.0
"""The same where no browser follows."""
MAX_BUSY_SHARE: Final = 0.2
"""Of one core, that updates take; where one takes long, the next one comes later."""
STOOD_S: Final = 1.5
"""Where an update comes so much later than it was due, the page itself stood: what has come in
meanwhile is taken in before anybody is called silent."""
BEAT_S: Final = 2.0
"""A browser hears something at least so often, so that it knows within 5 s that it is cut off."""


class Present(threading.Thread):
    """Brings `tables` up to `live` until it is stopped."""

    def __init__(
        self,
        live: LiveData,
        tables: PageTables,
        hub: PageHub,
        connected: Callable[[], bool],
        energy: Callable[[], Mapping[str, Any] | None] = lambda: None,
    ) -> None:
        super().__init__(name="present", daemon=True)
        self._live, self._tables, self._hub = live, tables, hub
        self._connected, self._energy = connected, energy
        self._snapshot = Snapshot()
        self._now_ns = 0
        self._sent_at = 0.0
        self._stopping = threading.Event()
        self._limiter = LogLimiter()
        self.progress_at = time.monotonic()
        """Monotonic time of the last update, s."""

    def known(self) -> Known:
        """What is known now, as browsers were told last."""
        return Known(self._snapshot, self._tables.moment, self._now_ns)

    def run(self) -> None:
        """Update until stopped."""
        while not self._stopping.is_set():
            begun, worked_s = time.monotonic(), time.thread_time()
            try:
                self.update(time.time_ns())
            except Exception:
                # One message that nobody thought of must not end the page.
                if self._limiter.allow(""):
                    log.exception("the page could not be brought up to date")
            self.progress_at = time.monotonic()
            self._wait(begun, time.thread_time() - worked_s)

    def update(self, now_ns: int) -> None:
        """Bring the tables up to the latest messages, and tell browsers."""
        self._live.tell(connected=self._connected())
        snapshot = self._live.snapshot()
        delta = self._tables.update(snapshot, now_ns, energy=self._energy())
        self._snapshot, self._now_ns = snapshot, now_ns
        moment = self._tables.moment
        if delta is None and time.monotonic() - self._sent_at >= BEAT_S:
            delta = {"t": moment["t"], "seq": moment["seq"], "set": {}, "del": {}}
        if delta is not None:
            self._sent_at = time.monotonic()
        metrics.DELTA_BYTES.inc(self._hub.publish(moment, delta))
        metrics.VIEWERS.set(self._hub.viewers)

    def stop(self) -> None:
        """Stop; it returns once no update runs."""
        self._stopping.set()
        self._hub.connected.set()
        if self.is_alive():
            self.join(timeout=5.0)

    def _wait(self, begun: float, worked_s: float) -> None:
        """Wait for the next update; not longer than usual once a browser has come."""
        period_s = max(PERIOD_S, worked_s / MAX_BUSY_SHARE)
        if self._hub.viewers:
            self._hub.connected.clear()
            due = max(begun + period_s, time.monotonic())
            self._stopping.wait(due - time.monotonic())
        else:
            due = max(begun + max(period_s, IDLE_PERIOD_S), time.monotonic())
            self._hub.connected.wait(due - time.monotonic())
            self._hub.connected.clear()
        if time.monotonic() - due > STOOD_S:
            self._stopping.wait(PERIOD_S)
