"""What operators may do to the dispatcher: pause it, resume it, have a cycle now."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from slipstream.orders import with_reason
from storage import Database, Event, StorageError

log = logging.getLogger(__name__)

PAUSE: Final = "pause"
RESUME: Final = "resume"
CYCLE: Final = "cycle"


@dataclass(frozen=True)
class Pause:
    """A pause that lasts."""

    by: str
    since_ns: int


class ControlRefused(Exception):
    """What was asked for cannot be done now."""

    def __init__(self, problem: str, mend: str) -> None:
        super().__init__(f"{problem}; {mend}")
        self.problem, self.mend = problem, mend


class Control:
    """Each use is stored as an event before it counts; a pause lasts over restarts. Safe for
    threads. `StorageError` means that nothing has happened.

    Attributes:
        run_soon: has a cycle run at once, False where one runs already; set once cycles are
            scheduled.
    """

    def __init__(self, store: Database) -> None:
        self._store = store
        self._lock = threading.Lock()
        self.run_soon: Callable[[], bool] = lambda: False
        self.paused = self._stored_pause()
        if self.paused is not None:
            log.warning("paused by %s: no cycle runs until it is resumed", self.paused.by)

    def pause(self, actor: str, reason: str | None = None) -> None:
        """Have no cycle begin and no order inserted any more; a cycle that runs goes on."""
        with self._lock:
            now_ns = self._record(PAUSE, actor, with_reason(f"paused by {actor}", reason))
            self.paused = self.paused or Pause(actor, now_ns)

    def store_pause(self) -> None:
        """Store the pause once more where the database is another one by now."""
        with self._lock:
            try:
                if self.paused is not None and self._stored_pause() is None:
                    self._save(PAUSE, self.paused.by, self.paused.since_ns, "dispatcher", "paused")
            except StorageError as error:
                log.warning("the pause is not stored: %s", error)

    def note(self, kind: str, subject: str, actor: str, reason: str | None = None) -> None:
        """Log what somebody did elsewhere, and what cannot be undone for want of a log."""
        try:
            text = with_reason(f"{kind} by {actor}", reason)
            self._save(kind, actor, time.time_ns(), subject, text)
        except StorageError as error:
            log.warning("%s of %s by %s is not stored: %s", kind, subject, actor, error)

    def resume(self, actor: str, reason: str | None = None) -> None:
        """Have cycles run again, the first one now."""
        with self._lock:
            self._record(RESUME, actor, with_reason(f"resumed by {actor}", reason))
            was_paused, self.paused = self.paused is not None, None
        if was_paused:
            self.run_soon()

    def cycle(self, actor: str, reason: str | None = None) -> None:
        """Have a cycle run now; the next ones follow at the usual interval.

        Raises:
            ControlRefused: it is paused, or one runs already.
        """
        with self._lock:
            if self.paused is not None:
                by = self.paused.by
                raise ControlRefused(f"the dispatcher is paused by {by}", "resume it first")
            self._record(CYCLE, actor, with_reason(f"a cycle wanted by {actor}", reason))
        if not self.run_soon():
            raise ControlRefused("a cycle runs now", "try again when it has ended")

    def _record(self, kind: str, actor: str, text: str) -> int:
        now_ns = time.time_ns()
        self._save(kind, actor, now_ns, "dispatcher", text)
        log.warning("%s", text)
        return now_ns

    def _save(self, kind: str, actor: str, time_ns: int, subject: str, text: str) -> None:
        self._store.save_events([Event(time_ns, kind, "info", subject, text, actor=actor)])

    def _stored_pause(self) -> Pause | None:
        last = self._store.last_event((PAUSE, RESUME))
        if last is None or last.kind != PAUSE:
            return None
        return Pause(last.actor or "", last.time_ns)
