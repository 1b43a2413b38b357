"""Conditions of now and alarms in force in; what is raised, has changed and has ended out."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.service.alarms.conditions import KINDS, Condition
from slipstream.messages import MAX_ALARMS, SEVERITIES, Alarm

TOLD_S: Final = 600.0
"""An alarm that ended is told of for so long, and goes on if its condition comes back, s."""
TEXT_EVERY_S: Final = 60.0
"""A text that changes alone, as a count does, is told anew that often at most, s."""
MANY: Final = 5
"""Beyond so many conditions of a kind one alarm stands for all of them."""
FEW: Final = 2
"""It stands for them until so few are left, so that a count about `MANY` is no change of alarms."""
_MAX_NAMED: Final = 10
_ALL: Final = "dispatcher"
"""Subject of what stands for many."""
RESTART_S: Final = 60.0
"""For so long after a restart alarms of the run before last unseen, s: facts come in first."""
_PENDING_S: Final = 10.0
"""A condition that is gone for so long before it is an alarm begins anew, s."""

Key = tuple[str, str]


@dataclass
class _Held:
    alarm: Alarm
    seen_s: float
    told_s: float


class AlarmBook:
    """The alarms of a dispatcher. Not safe for threads.

    A condition that comes and goes is one alarm: it begins once it has lasted (`AlarmKind`), ends
    once it has been gone for a while, and goes on if it is back within `TOLD_S`.

    Args:
        alarms: of the run before: in force, or ended within `TOLD_S`.
    """

    def __init__(self, alarms: Iterable[Alarm] = (), now_s: float = 0.0) -> None:
        self._held: dict[Key, _Held] = {}
        self._ended: dict[Key, _Held] = {}
        self._pending: dict[Key, tuple[float, float, int]] = {}
        for alarm in alarms:
            known = self._held if alarm.ended_ns is None else self._ended
            seen_s = now_s + RESTART_S if alarm.ended_ns is None else now_s
            if alarm.kind in KINDS:
                known[alarm.kind, alarm.subject] = _Held(alarm, seen_s, now_s)

    def update(
        self, conditions: Iterable[Condition], now_ns: int, now_s: float
    ) -> tuple[Alarm, ...]:
        """Take over what is wrong now; the alarms that are new or have changed.

        Args:
            conditions: all of now; those of a kind in the order of their weight, or of no order.
        """
        changed: list[Alarm] = []
        seen: set[Key] = set()
        for condition in self._summed_up(conditions):
            key = condition.kind, condition.subject
            if key in seen:
                continue
            held = self._held.get(key)
            seen.add(key)
            if held is None:
                held = self._raised(condition, now_ns, now_s)
                if held is None:
                    continue
                self._held[key] = held
                changed.append(held.alarm)
            elif self._has_changed(held, condition, now_s):
                changed.append(held.alarm)
            held.seen_s = max(held.seen_s, now_s)
        changed += self._end(seen, now_ns, now_s)
        self._forget(now_s)
        return tuple(changed)

    def acknowledge(self, alarm: str, by: str, now_ns: int) -> Alarm | None:
        """Somebody knows of an alarm; the alarm, or None if there is none of this id. The first who
        acknowledges it stays.
        """
        held = self._find(alarm)
        if held is not None and held.alarm.acknowledged_by is None:
            told = {"acknowledged_by": by, "acknowledged_ns": now_ns}
            held.alarm = held.alarm.model_copy(update=told)
        return None if held is None else held.alarm

    def find(self, alarm: str) -> Alarm | None:
        """An alarm by its id."""
        held = self._find(alarm)
        return None if held is None else held.alarm

    def alarms(self) -> tuple[tuple[Alarm, ...], int]:
        """(alarms as `Alarms` has them, how many found no place)."""
        found = [held.alarm for known in (self._held, self._ended) for held in known.values()]
        found.sort(
            key=lambda alarm: (
                alarm.ended_ns is not None,
                SEVERITIES.index(alarm.severity),
                -alarm.since_ns,
                alarm.id,
            )
        )
        return tuple(found[:MAX_ALARMS]), max(0, len(found) - MAX_ALARMS)

    def in_force(self) -> tuple[Alarm, ...]:
        """Those that have not ended."""
        return tuple(held.alarm for held in self._held.values())

    def _summed_up(self, conditions: Iterable[Condition]) -> Iterator[Condition]:
        """Conditions, with one for all of a kind that has many subjects now."""
        by_kind: dict[str, dict[str, Condition]] = {}
        for condition in conditions:
            by_kind.setdefault(condition.kind, {}).setdefault(condition.subject, condition)
        for name, found in by_kind.items():
            what = KINDS[name].many
            is_one = (name, _ALL) in self._held
            if what is None or len(found) <= (FEW if is_one else MANY):
                yield from found.values()
                continue
            names = [subject.partition("/")[2] or subject for subject in found]
            more = f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
            text = f"{len(names)} {what}: {', '.join(names[:_MAX_NAMED])}{more}"
            begins = [one.since_ns for one in found.values() if one.since_ns is not None]
            yield Condition(name, _ALL, text, min(begins, default=None))

    def _raised(self, condition: Condition, now_ns: int, now_s: float) -> _Held | None:
        """The alarm of a condition that is in none; None: it has not lasted long enough yet."""
        kind, key = KINDS[condition.kind], (condition.kind, condition.subject)
        first_s, _, first_ns = self._pending.get(key, (now_s, now_s, now_ns))
        if now_s - first_s < kind.raise_after_s:
            self._pending[key] = first_s, now_s, first_ns
            return None
        self._pending.pop(key, None)
        severity = condition.severity or kind.severity
        before = self._ended.pop(key, None)
        if before is not None:
            told = {"ended_ns": None, "severity": severity, "text": condition.text}
            return _Held(before.alarm.model_copy(update=told), now_s, now_s)
        since_ns = condition.since_ns or first_ns
        name = f"{condition.kind} {condition.subject} {since_ns} {now_ns}"
        alarm = Alarm(
            id=hashlib.blake2s(name.encode(), digest_size=8).hexdigest(),
            severity=severity,
            kind=condition.kind,
            subject=condition.subject,
            since_ns=since_ns,
            ended_ns=None,
            text=condition.text,
            mend=kind.mend,
        )
        return _Held(alarm, now_s, now_s)

    @staticmethod
    def _has_changed(held: _Held, condition: Condition, now_s: float) -> bool:
        severity = condition.severity or KINDS[condition.kind].severity
        new_text = held.alarm.text != condition.text and now_s - held.told_s >= TEXT_EVERY_S
        if severity == held.alarm.severity and not new_text:
            return False
        told = {"severity": severity, "text": condition.text}
        held.alarm, held.told_s = held.alarm.model_copy(update=told), now_s
        return True

    def _end(self, seen: set[Key], now_ns: int, now_s: float) -> list[Alarm]:
        ended = []
        for key, held in list(self._held.items()):
            if key in seen or now_s - held.seen_s < KINDS[key[0]].end_after_s:
                continue
            del self._held[key]
            ended_ns = max(now_ns, held.alarm.since_ns)
            held.alarm = held.alarm.model_copy(update={"ended_ns": ended_ns})
            held.told_s = now_s
            self._ended[key] = held
            ended.append(held.alarm)
        return ended

    def _forget(self, now_s: float) -> None:
        for key, (_, last_s, _) in list(self._pending.items()):
            if now_s - last_s > _PENDING_S:
                del self._pending[key]
        for key, held in list(self._ended.items()):
            if now_s - held.told_s > TOLD_S:
                del self._ended[key]

    def _find(self, alarm: str) -> _Held | None:
        known = (*self._held.values(), *self._ended.values())
        return next((held for held in known if held.alarm.id == alarm), None)
