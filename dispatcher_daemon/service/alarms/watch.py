"""The alarms between what finds conditions, the database, the bus and callers of the API."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable
from typing import Final

from dispatcher_daemon import metrics
from dispatcher_daemon.service.alarms.book import TOLD_S, AlarmBook
from dispatcher_daemon.service.alarms.conditions import Condition
from slipstream.messages import SEVERITIES, Alarm, Alarms
from slipstream.orders import with_reason
from slipstream.service import LogLimiter
from storage import Database, Event, StorageError

log = logging.getLogger(__name__)

TELL_EVERY_S: Final = 5.0
SAVE_AGAIN_S: Final = 10.0
"""Alarms that could not be stored are tried again after this, s."""
_FIELDS: Final = (
    "kind",
    "severity",
    "subject",
    "text",
    "mend",
    "ended_ns",
    "acknowledged_by",
    "acknowledged_ns",
)


class AlarmWatch:
    """The alarms; safe for threads.

    Args:
        store: database, for what was in force in the run before, and for what changes.
        wake: called when `save` has something to do; it does not wait.
    """

    def __init__(
        self,
        store: Database,
        publish: Callable[[Alarms], None] = lambda alarms: None,
        announce: Callable[[Alarm], None] = lambda alarm: None,
        wake: Callable[[Collection[str]], None] = lambda names: None,
    ) -> None:
        self._store, self._publish = store, publish
        self._announce, self._wake = announce, wake
        stored = store.load_alarms(time.time_ns() - round(1e9 * TOLD_S))
        self._book = AlarmBook(map(alarm_of, stored), time.monotonic())
        self._lock = threading.Lock()
        self._unsaved: dict[str, Alarm] = {}
        self._save_from_s = 0.0
        self._told_s = -TELL_EVERY_S
        self._limiter = LogLimiter()

    def update(self, conditions: Iterable[Condition]) -> None:
        """Take over what is wrong now, and tell of it."""
        found, now_s = list(conditions), time.monotonic()
        with self._lock:
            changed = self._book.update(found, time.time_ns(), now_s)
            self._note(changed)
        for alarm in changed:
            state = "over" if alarm.ended_ns is not None else alarm.severity
            log.info("alarm %s, %s %s: %s", state, alarm.subject, alarm.kind, alarm.text)
        if changed or now_s - self._told_s >= TELL_EVERY_S:
            self._tell(now_s)

    def told(self) -> Alarms:
        """The alarms in force and those that ended lately."""
        with self._lock:
            alarms, more = self._book.alarms()
        return Alarms(time_ns=time.time_ns(), alarms=alarms, more=more)

    def acknowledge(
        self, alarm: str, by: str, actor: str, reason: str | None = None
    ) -> Alarm | None:
        """Somebody knows of an alarm. It returns when that is durable.

        Returns:
            the alarm, with the first who acknowledged it; None: there is none of this id.

        Raises:
            StorageError: the database cannot be written; nothing has happened.
        """
        with self._lock:
            found = self._book.find(alarm)
        if found is None or found.acknowledged_by is not None:
            return found
        now_ns = time.time_ns()
        acknowledged = {"acknowledged_by": by, "acknowledged_ns": now_ns}
        text = with_reason(f"{found.kind} acknowledged by {by}", reason)
        done = Event(now_ns, "acknowledge", "info", found.subject, text, actor=actor)
        self._store.save_events([event_of(found.model_copy(update=acknowledged)), done])
        with self._lock:
            told = self._book.acknowledge(alarm, by, now_ns)
            # What was being stored meanwhile may lack it.
            self._note([told or found])
        self._tell(time.monotonic())
        return told

    def save(self) -> None:
        """Store what has changed; what cannot be stored now is tried again later."""
        with self._lock:
            waiting = dict(self._unsaved)
        if not waiting:
            return
        try:
            self._store.save_events([event_of(alarm) for alarm in waiting.values()])
        except StorageError as error:
            self._save_from_s = time.monotonic() + SAVE_AGAIN_S
            self._limiter.warn(log, "save", f"alarms could not be stored: {error}")
            return
        with self._lock:
            for name, alarm in waiting.items():
                if self._unsaved.get(name) is alarm:
                    del self._unsaved[name]

    def save_all(self) -> None:
        """Have all alarms that are told stored."""
        with self._lock:
            self._unsaved |= {alarm.id: alarm for alarm in self._book.alarms()[0]}

    def _note(self, changed: Iterable[Alarm]) -> None:
        for alarm in changed:
            self._unsaved[alarm.id] = alarm
            self._announce(alarm)
        if self._unsaved and time.monotonic() >= self._save_from_s:
            self._wake(tuple(self._unsaved))

    def _tell(self, now_s: float) -> None:
        self._told_s = now_s
        alarms = self.told()
        counts = dict.fromkeys(SEVERITIES, 0)
        with self._lock:
            for alarm in self._book.in_force():
                counts[alarm.severity] += 1
        for severity, count in counts.items():
            metrics.ALARMS.labels(severity).set(count)
        self._publish(alarms)


def event_of(alarm: Alarm) -> Event:
    """An alarm as it is stored."""
    values = {name: getattr(alarm, name) for name in _FIELDS}
    return Event(alarm=alarm.id, time_ns=alarm.since_ns, **values)


def alarm_of(event: Event) -> Alarm:
    """An alarm from what was stored of it."""
    values = {name: getattr(event, name) for name in _FIELDS}
    return Alarm(id=str(event.alarm), since_ns=event.time_ns, **values)
