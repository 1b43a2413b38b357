"""What intersections have told of their signals: greens to come, and what shows now.

A message counts for two seconds: intersections send at each change and once a second, so one that
is older, or dated ahead of the vehicle's clock, may have been overtaken by a change.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from slipstream.messages import MAY_GO, MovementState, PhaseState, SignalPhaseAndTiming
from vehicle_agent.leg import Leg

HORIZON_M: Final = 600.0
"""Signals further off change before they are reached."""

STALE_S: Final = 2.0
AHEAD_S: Final = 0.1
_CURRENT_S: Final = 0.2
"""A green that may end at any time is known to run in a message no older than this."""

_CLEARING: Final[frozenset[PhaseState]] = frozenset({"permissive-clearance", "protected-clearance"})


class Green(NamedTuple):
    """A time in which a movement may go.

    Attributes:
        begin_s: past for a green that runs.
        end_s: when yellow begins.
        certain: whether both ends are fixed. If not (actuated signal), `end_s` is the earliest end
            and `begin_s` the earliest begin.
        protected: whether the movement has right of way in all of it.
    """

    begin_s: float
    end_s: float
    certain: bool
    protected: bool


class Indication(NamedTuple):
    """What a movement's signal shows: green, yellow, and when red begins, past where it shows,
    infinite where that is open.
    """

    may_go: bool
    clearing: bool
    red_s: float


class _Event(NamedTuple):
    """A phase; `certain`: its begin and its end are fixed."""

    state: PhaseState
    begin_s: float
    end_s: float
    certain: bool


@dataclass
class _Heard:
    """The latest message of an intersection; phases are converted when a group is asked for."""

    message: SignalPhaseAndTiming
    time_s: float
    movements: dict[int, MovementState]
    events: dict[int, tuple[_Event, ...]] = field(default_factory=dict)
    greens: dict[int, tuple[Green, ...]] = field(default_factory=dict)


class SignalTimings:
    """The signal phases and timings that were received; agents of one process may share it."""

    def __init__(self) -> None:
        self._heard: dict[str, _Heard] = {}

    def receive(self, message: SignalPhaseAndTiming) -> None:
        """Take in a message; one that is older than the known one is left out."""
        known = self._heard.get(message.intersection)
        if known is not None:
            if message.time_ns <= known.message.time_ns:
                return
            if message.movements is known.message.movements:
                known.message, known.time_s = message, message.time_ns / 1e9
                return
        movements = {movement.signal_group: movement for movement in message.movements}
        self._heard[message.intersection] = _Heard(message, message.time_ns / 1e9, movements)

    def upcoming(self, intersection: str, group: int, now_s: float) -> tuple[Green, ...]:
        """When the movement of a signal group may go, soonest first, from now on, UTC or simulated;
        empty: not known.

        Fixed times: all greens that were told. Actuated: the running green and its earliest end, or
        the next one from its earliest begin on.
        """
        heard = self._fresh(intersection, now_s)
        return () if heard is None else _to_come(_told(heard, group), now_s)

    def predicted(
        self, intersection: str, group: int, now_s: float, ahead_s: float
    ) -> tuple[Green, ...]:
        """`upcoming`, and where fixed times repeat, their repetitions as far ahead as asked."""
        heard = self._fresh(intersection, now_s)
        if heard is None:
            return ()
        told = _told(heard, group)
        pattern = _pattern(told, heard.time_s)
        if pattern is None:
            return _to_come(told, now_s)
        period_s, repeated = pattern
        found = list(told)
        until_s = now_s + ahead_s
        turn = 1
        while found[-1].end_s < until_s:
            shift_s = turn * period_s
            found += [
                green._replace(begin_s=green.begin_s + shift_s, end_s=green.end_s + shift_s)
                for green in repeated
            ]
            turn += 1
        return _to_come(found, now_s)

    def indication(self, intersection: str, group: int, now_s: float) -> Indication | None:
        """What a movement's signal shows now; None: not known, or no signal works there. A green is
        known only until its earliest end, or as long as messages still tell it.
        """
        heard = self._fresh(intersection, now_s)
        if heard is None:
            return None
        events = _events(heard, group)
        for number, event in enumerate(events):
            if event.certain and event.end_s <= now_s:
                continue
            if event.state == "dark":
                return None
            may_go = event.state in MAY_GO
            if may_go and now_s >= event.end_s and now_s > heard.time_s + _CURRENT_S:
                return None
            return Indication(may_go, event.state in _CLEARING, _red_s(events[number:]))
        return None

    def _fresh(self, intersection: str, now_s: float) -> _Heard | None:
        heard = self._heard.get(intersection)
        if heard is None or not -AHEAD_S <= now_s - heard.time_s <= STALE_S:
            return None
        return heard


def intersections_ahead(leg: Leg, place_m: float, horizon_m: float = HORIZON_M) -> tuple[str, ...]:
    """Intersections whose timing a vehicle at a place on its leg needs, the nearest first."""
    first = bisect_right(leg.lines, place_m, key=lambda line: line.at_m)
    beyond = bisect_right(leg.lines, place_m + horizon_m, key=lambda line: line.at_m)
    return tuple(dict.fromkeys(line.intersection for line in leg.lines[first:beyond]))


def _events(heard: _Heard, group: int) -> tuple[_Event, ...]:
    """A movement's phases; empty for one that the intersection does not tell of."""
    known = heard.events.get(group)
    if known is None:
        movement = heard.movements.get(group)
        found = []
        certain = True
        for event in () if movement is None else movement.events:
            certain = certain and event.min_end_ns == event.max_end_ns
            found.append(_Event(event.state, event.start_ns / 1e9, event.min_end_ns / 1e9, certain))
        known = heard.events[group] = tuple(found)
    return known


def _told(heard: _Heard, group: int) -> tuple[Green, ...]:
    """All greens of a message for one movement."""
    greens = heard.greens.get(group)
    if greens is None:
        greens = heard.greens[group] = _greens(_events(heard, group))
    return greens


def _to_come(greens: Sequence[Green], now_s: float) -> tuple[Green, ...]:
    """Without those that have ended; one that may have been extended since stays."""
    if greens and greens[0].certain and greens[0].end_s <= now_s:
        greens = [green for green in greens if not (green.certain and green.end_s <= now_s)]
    return tuple(greens)


def _greens(events: Sequence[_Event]) -> tuple[Green, ...]:
    """Phases in a row in which the movement may go are one green; none is told behind an open one,
    for what follows that may come at any later time.
    """
    found: list[Green] = []
    for before, event in zip((None, *events), events, strict=False):
        if event.state not in MAY_GO:
            if found and not found[-1].certain:
                break
            continue
        protected = event.state == "protected-Movement-Allowed"
        if before is not None and before.state in MAY_GO:
            last = found.pop()
            found.append(
                Green(last.begin_s, event.end_s, event.certain, last.protected and protected)
            )
        else:
            found.append(Green(event.begin_s, event.end_s, event.certain, protected))
    return tuple(found)


def _red_s(events: Sequence[_Event]) -> float:
    """When the first of some phases that is red begins; infinite where that is open."""
    for event in events:
        if event.state not in MAY_GO and event.state not in _CLEARING:
            return event.begin_s
        if not event.certain:
            return math.inf
    return events[-1].end_s


def _pattern(
    greens: Sequence[Green], told_s: float, tolerance_s: float = 1e-6
) -> tuple[float, tuple[Green, ...]] | None:
    """The period of greens of fixed times and those of its last turn; None: they do not repeat.
    Begins are compared but for the running green's, which may have begun before it was told.
    """
    if len(greens) < 2 or not all(green.certain for green in greens):
        return None
    for count in range(1, len(greens)):
        pairs = list(zip(greens, greens[count:], strict=False))
        shifts = [after.end_s - before.end_s for before, after in pairs]
        shifts += [
            after.begin_s - before.begin_s for before, after in pairs if before.begin_s > told_s
        ]
        if max(shifts) - min(shifts) <= tolerance_s:
            return shifts[0], tuple(greens[-count:])
    return None
