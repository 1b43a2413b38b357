"""What is wrong now, in words, the worst first; pure. Texts have no ages, which would run."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from dashboard.live import Snapshot
from dashboard.view import labels
from dashboard.view.dispatcher import cycle_problem
from dashboard.view.labels import Level
from dashboard.view.model import RoadView, RsuView, VehicleView
from slipstream import freshness

_RANK: Final[dict[Level, int]] = {"bad": 0, "warn": 1, "ok": 2}
_KINDS: Final = (
    *("bus", "dispatcher", "database", "cluster", "solver"),
    *("rsu", "road", "order", "vehicle"),
)
"""Of subjects: what else depends on the first ones."""


@dataclass(frozen=True)
class Trouble:
    """One thing that is wrong.

    Attributes:
        subject: as of `slipstream.messages.Alarm`, or "bus".
        level: how bad.
        text: what it is.
        since_ns: UTC since when; None: not known.
        mend: what to do; None: it says itself.
    """

    subject: str
    level: Literal["warn", "bad"]
    text: str
    since_ns: int | None = None
    mend: str | None = None


def troubles(
    snapshot: Snapshot,
    roads: Collection[RoadView],
    rsus: Collection[RsuView],
    vans: Collection[VehicleView],
    now_ns: int,
    silent_after_s: float,
) -> tuple[Trouble, ...]:
    """All that is wrong, the worst first.

    Where the bus does not answer, silence of all others is no trouble of theirs.

    Args:
        snapshot: the latest messages.
        roads: views of the watched roads.
        rsus: of the roadside units.
        vans: of the vehicles.
        now_ns: UTC.
        silent_after_s: age above which the dispatcher counts as silent, s.
    """
    found: list[Trouble] = []
    if not snapshot.connected:
        mend = "start the router, or mend the network; the page goes on by itself"
        text = "The message bus does not answer: nothing here is up to date"
        found.append(Trouble("bus", "bad", text, mend=mend))
    else:
        found += _of_dispatcher(snapshot, now_ns, silent_after_s)
    found += _of_database(snapshot)
    for rsu in rsus:
        if rsu.level != "ok" and (snapshot.connected or rsu.fps is not None):
            level: Literal["warn", "bad"] = "bad" if rsu.level == "bad" else "warn"
            silent_ns = rsu.health.time_ns if rsu.fps is None else None
            found.append(
                Trouble(f"rsu/{rsu.rsu}", level, f"Camera {rsu.rsu}: {rsu.status}", silent_ns)
            )
    found += [
        Trouble(f"road/{road.segment}", "warn", f"A vehicle stands on {road.segment}")
        for road in roads
        if road.stopped
    ]
    if snapshot.connected:
        found += [
            Trouble(f"vehicle/{van.vehicle}", "warn", f"{van.vehicle} tells no position any more")
            for van in vans
            if van.silent and not van.idle
        ]
    told = {trouble.subject for trouble in found}
    found += [trouble for trouble in _of_alarms(snapshot) if trouble.subject not in told]
    return tuple(sorted(found, key=_rank))


def _of_alarms(snapshot: Snapshot) -> Iterator[Trouble]:
    """What the dispatcher alarms of and the page does not see by itself."""
    for alarm in () if snapshot.alarms is None else snapshot.alarms.alarms:
        if alarm.ended_ns is None and alarm.severity != "info":
            grave = alarm.severity == "critical" and alarm.acknowledged_by is None
            level: Literal["warn", "bad"] = "bad" if grave else "warn"
            yield Trouble(alarm.subject, level, alarm.text, alarm.since_ns, alarm.mend)


def _rank(trouble: Trouble) -> tuple[int, int, str]:
    kind = trouble.subject.partition("/")[0]
    place = _KINDS.index(kind) if kind in _KINDS else len(_KINDS)
    return _RANK[trouble.level], place, trouble.subject


def _of_dispatcher(snapshot: Snapshot, now_ns: int, silent_after_s: float) -> Iterator[Trouble]:
    health = snapshot.dispatcher
    mend = "look at its service and its log; vehicles go on by the plans that they have"
    if health is None:
        text = "The dispatcher has not been heard: no plans are made"
        yield Trouble("dispatcher", "bad", text, mend=mend)
        return
    fault = freshness.fault(health.time_ns, now_ns, stale_after_s=silent_after_s)
    if fault == "stale":
        text = "The dispatcher is silent: no plans are made"
        yield Trouble("dispatcher", "bad", text, health.time_ns, mend)
        return
    if fault == "future":
        yield Trouble("dispatcher", "bad", "The dispatcher's clock is ahead of this one's")
        return
    if health.paused:
        text, mend = "Planning is paused", "resume it when it is to go on"
        yield Trouble("dispatcher", "warn", text, mend=mend)
        return
    problem = cycle_problem(snapshot, health, now_ns)
    if problem is not None:
        yield Trouble("dispatcher", "bad", problem, mend="see the dispatcher's log")
    told = [
        (health.states_refused, f"{labels.plural(health.states_refused, 'state')} refused"),
        (health.messages_lost, f"{labels.plural(health.messages_lost, 'message')} lost"),
    ]
    counts = ", ".join(text for count, text in told if count)
    if counts:
        yield Trouble("dispatcher", "warn", f"The dispatcher has {counts}")
    if health.database_set_aside is not None:
        text = f"A damaged database was set aside as {health.database_set_aside}"
        yield Trouble("database", "warn", text)


def _of_database(snapshot: Snapshot) -> Sequence[Trouble]:
    if snapshot.history_problem is not None:
        return [Trouble("database", "bad", snapshot.history_problem)]
    if not snapshot.has_database:
        text = "There is no database: no past, no orders"
        mend = "give the dispatcher's database_url in the dashboard's settings"
        return [Trouble("database", "bad", text, mend=mend)]
    return []
