"""What is wrong now, in words, the worst first; pure. Texts have no ages, which would run."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from dashboard.live import Snapshot
from dashboard.view import labels
from dashboard.view.dispatcher import SILENT_AFTER_S, cycle_problem
from dashboard.view.labels import Level
from dashboard.view.model import RoadView, RsuView, VehicleView
from slipstream import freshness
from slipstream.messages import Alarm

_RANK: Final[dict[Level, int]] = {"bad": 0, "warn": 1, "ok": 2}
_KINDS: Final = (
    *("bus", "dispatcher", "database", "cluster", "solver"),
    *("fleet", "rsu", "road", "order", "vehicle"),
)
"""Of subjects: what else depends on the first ones."""
QUIET_SHARE: Final = 0.75
"""Of the time after which a dispatcher counts as silent: if nobody at all is heard for so long, it
is the bus. All send each second, so that nobody of them is overdue by itself before."""
_OWN: Final = frozenset({"paused", "cycle_failed", "database_set_aside"})
"""Kinds of alarms that are also found here."""
_BUS: Final = "The message bus or the network does not answer: nothing here is up to date"


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
    *,
    settling: bool = False,
    unheard: Iterable[str] = (),
) -> tuple[Trouble, ...]:
    """All that is wrong, the worst first.

    Where the bus does not answer, silence of all others is no trouble of theirs.
    """
    found: list[Trouble] = []
    down = bus_trouble(snapshot, now_ns)
    answers = down is None and not settling
    if down is not None:
        found.append(down)
    elif answers:
        found += _of_dispatcher(snapshot, now_ns)
    found += _of_database(snapshot)
    for rsu in rsus:
        if rsu.level != "ok" and (answers or rsu.fps is not None):
            level: Literal["warn", "bad"] = "bad" if rsu.level == "bad" else "warn"
            silent_ns = rsu.health.time_ns if rsu.fps is None else None
            found.append(
                Trouble(f"rsu/{rsu.rsu}", level, f"Camera {rsu.rsu}: {rsu.status}", silent_ns)
            )
    if answers:
        mend = "look at its service, its network and the name in its settings"
        found += [
            Trouble(f"rsu/{rsu}", "bad", f"Camera {rsu}: never heard", mend=mend) for rsu in unheard
        ]
    found += [
        Trouble(f"road/{road.segment}", "warn", f"A vehicle stands on {road.segment}")
        for road in roads
        if road.stopped
    ]
    if answers:
        found += _of_fleet(vans)
    told = {trouble.subject for trouble in found}
    alarms = () if snapshot.alarms is None else snapshot.alarms.alarms
    found += of_alarms(alarm for alarm in alarms if not _is_told(alarm, told))
    return tuple(sorted(found, key=_rank))


def _is_told(alarm: Alarm, told: Collection[str]) -> bool:
    """Whether a trouble found here says the same; dispatcher and database may have several."""
    return alarm.subject in told and ("/" in alarm.subject or alarm.kind in _OWN)


def bus_trouble(snapshot: Snapshot, now_ns: int) -> Trouble | None:
    """That of the bus, or of the network that it runs over; None: it answers.

    A router that hangs keeps its links, and zenoh takes 10 s to notice: so silence tells, too.
    """
    quiet_ns = silent_since_ns(snapshot, now_ns)
    if snapshot.connected and quiet_ns is None:
        return None
    mend = "start the router, or mend the network; the page goes on by itself"
    return Trouble("bus", "bad", _BUS, quiet_ns, mend)


def silent_since_ns(snapshot: Snapshot, now_ns: int) -> int | None:
    """UTC since when none of several senders is heard that were heard until then; None: one is.

    Each box may fail by itself, so that the dispatcher, an RSU or the fleet alone is told as such.
    What was silent for long before does not count, and neither does what is dated ahead.
    """
    dispatcher = () if snapshot.dispatcher is None else (snapshot.dispatcher,)
    senders = (
        *(health.time_ns for health in (*dispatcher, *snapshot.rsus.values())),
        # One agent may speak for many vehicles.
        max((told.time_ns for told in snapshot.positions.values()), default=0),
    )
    heard = [time_ns for time_ns in senders if not freshness.is_ahead(time_ns, now_ns)]
    last_ns = max(heard, default=0)
    until_then = [at for at in heard if last_ns - at <= SILENT_AFTER_S * 1e9]
    quiet_s = freshness.age_s(last_ns, now_ns)
    return last_ns if len(until_then) > 1 and quiet_s > QUIET_SHARE * SILENT_AFTER_S else None


def of_alarms(alarms: Iterable[Alarm]) -> Iterator[Trouble]:
    """What the dispatcher alarms of, and is still in force."""
    for alarm in alarms:
        if (level := alarm_level(alarm)) is not None:
            yield Trouble(alarm.subject, level, alarm.text, alarm.since_ns, alarm.mend)


def alarm_level(alarm: Alarm) -> Literal["warn", "bad"] | None:
    """How bad what an alarm tells is: less so once somebody has acknowledged it.

    None: it has ended, or only informs.
    """
    if alarm.ended_ns is not None or alarm.severity == "info":
        return None
    return "bad" if alarm.severity == "critical" and alarm.acknowledged_by is None else "warn"


def _rank(trouble: Trouble) -> tuple[int, int, str]:
    kind = trouble.subject.partition("/")[0]
    place = _KINDS.index(kind) if kind in _KINDS else len(_KINDS)
    return _RANK[trouble.level], place, trouble.subject


def _of_dispatcher(snapshot: Snapshot, now_ns: int) -> Iterator[Trouble]:
    health = snapshot.dispatcher
    mend = "look at its service and its log; vehicles go on by the plans that they have"
    if health is None:
        text = "The dispatcher has not been heard: no plans are made"
        yield Trouble("dispatcher", "bad", text, mend=mend)
        return
    fault = freshness.fault(health.time_ns, now_ns, stale_after_s=SILENT_AFTER_S)
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


def _of_fleet(vans: Collection[VehicleView]) -> Iterator[Trouble]:
    """Vehicles that have work and are silent; where most are, that stands before them."""
    heard = sum(van.progress.source != "planned" for van in vans)
    gone = [van for van in vans if van.silence == "bad"]
    if len(gone) > 1 and 2 * len(gone) >= heard:
        since_ns = max(van.silent_ns or 0 for van in gone)
        text = f"{len(gone)} of {labels.plural(heard, 'vehicle')} that were heard are silent"
        mend = "look at the network that they send over; call their drivers"
        yield Trouble("fleet", "bad", text, since_ns, mend)
    for van in vans:
        if van.silence == "warn" or van.silence == "bad":
            text = f"{van.vehicle} tells no position any more"
            yield Trouble(f"vehicle/{van.vehicle}", van.silence, text, van.silent_ns)


def _of_database(snapshot: Snapshot) -> Sequence[Trouble]:
    if snapshot.history_problem is not None:
        return [Trouble("database", "bad", snapshot.history_problem)]
    if not snapshot.has_database:
        text = "There is no database: no past, no orders"
        mend = "give the dispatcher's database_url in the dashboard's settings"
        return [Trouble("database", "bad", text, mend=mend)]
    return []
