"""Rows of the watched roads, moment after moment; only what says something new is made anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Final

from dashboard.live import Snapshot
from dashboard.view.model import LIST_FOR_S, RoadView
from dashboard.view.roads import (
    RoadData,
    RoadLimits,
    measured,
    open_roads,
    road_data,
    road_view,
)
from dashboard.web.tables import rows
from dashboard.web.tables.rows import Row, Rows
from slipstream.messages import CycleReport, SegmentState, StoppedVehicles

_LIST_FOR_NS: Final = round(LIST_FOR_S * 1e9)
_NEVER_NS: Final = 2**63
_NO_LIMITS: Final = RoadLimits(0.0, 0.0)


@dataclass(slots=True)
class _Road:
    """A road as it was told last.

    Attributes:
        data: its messages when it was made; later states that say the same are not among them.
        view: of them.
        row: of the page.
        expires_ns: UTC at which these change though no message comes.
        plain: it is judged by the fresh state of the only unit that watches it, and nobody stands.
    """

    data: RoadData
    view: RoadView
    row: Row
    expires_ns: int
    plain: bool


@dataclass(frozen=True)
class _TableFrame:
    """What decides which roads are watched, and by what beside their states."""

    limits: RoadLimits
    last: CycleReport | None
    watching: Mapping[str, tuple[str, ...]]
    stopped: tuple[StoppedVehicles, ...]

    def holds(self, other: _TableFrame) -> bool:
        """Whether both are the same; messages are replaced, never changed."""
        return (
            self.last is other.last
            and self.limits == other.limits
            and identical(self.stopped, other.stopped)
            and self.watching == other.watching
        )


class RoadTable:
    """The watched roads.

    Args:
        rsus: roads by RSU that are watched whether or not the unit was heard.

    Attributes:
        rows: of the page, by road.
        before: the rows of the moment before.
        changes: fields of the rows that differ from those, by road; None: they are not known, nor
            which roads are gone.
        open: roads on which platoons may drive close now.
        standing: views of the roads on which a vehicle stands as in no queue.
    """

    def __init__(self, rsus: Mapping[str, Sequence[str]] | None = None) -> None:
        self._watching = {road: rsu for rsu, roads in (rsus or {}).items() for road in roads}
        self.rows: Rows = {}
        self.before: Rows = {}
        self.changes: Rows | None = None
        self.open: frozenset[str] = frozenset()
        self.standing: tuple[RoadView, ...] = ()
        self._roads: dict[str, _Road] = {}
        self._frame = _TableFrame(_NO_LIMITS, None, {}, ())
        self._states: Mapping[tuple[str, str], SegmentState] = {}
        self._complete_until_ns = 0

    def update(self, snapshot: Snapshot, now_ns: int, limits: RoadLimits) -> None:
        """Bring the roads up to a snapshot."""
        frame = _TableFrame(
            limits,
            snapshot.cycles[-1] if snapshot.cycles else None,
            {name: health.segments for name, health in snapshot.rsus.items()},
            tuple(snapshot.stopped.values()),
        )
        changed = self._changed(snapshot.states, now_ns)
        if changed is None or now_ns >= self._complete_until_ns or not self._frame.holds(frame):
            self._rebuild(snapshot, now_ns, frame)
        else:
            self._advance(snapshot, now_ns, limits, changed)
        self._frame, self._states = frame, snapshot.states

    def _changed(
        self, states: Mapping[tuple[str, str], SegmentState], now_ns: int
    ) -> list[tuple[tuple[str, str], SegmentState]] | None:
        """States that are new since the last moment; None: other roads than then have states."""
        before, oldest_ns = self._states, now_ns - _LIST_FOR_NS
        if len(before) != len(states):
            return None
        changed = []
        for name, state in states.items():
            known = before.get(name)
            if known is not state:
                if known is None or state.time_ns <= oldest_ns:
                    return None
                changed.append((name, state))
        return changed

    def _rebuild(self, snapshot: Snapshot, now_ns: int, frame: _TableFrame) -> None:
        """Look at all roads; those whose messages are the same stay as they are."""
        old = self._roads if frame.limits == self._frame.limits else {}
        self._roads = {}
        for name, data in road_data(snapshot, now_ns, self._watching).items():
            known = old.get(name)
            if known is None or now_ns >= known.expires_ns or not _same(known.data, data):
                known = _made(data, frame, now_ns)
            self._roads[name] = known
        times = [
            message.time_ns
            for messages in (snapshot.states, snapshot.rsus)
            for message in messages.values()
            if message.time_ns > now_ns - _LIST_FOR_NS
        ]
        self.changes = None
        self._complete_until_ns = min(times, default=_NEVER_NS - _LIST_FOR_NS) + _LIST_FOR_NS
        self._collect(views=True)

    def _advance(
        self,
        snapshot: Snapshot,
        now_ns: int,
        limits: RoadLimits,
        changed: list[tuple[tuple[str, str], SegmentState]],
    ) -> None:
        """Look at the roads with new states, and at those whose time has come."""
        stale_ns = round(limits.stale_after_s * 1e9)
        oldest_ns = now_ns - stale_ns
        latest_ns = now_ns + round(limits.future_tolerance_s * 1e9)
        roads, remade, changes = self._roads, set(), {}
        for name, state in changed:
            road, time_ns = roads[name[0]], state.time_ns
            data = road.data
            if (
                road.plain
                and data.states[0].y_e == state.y_e
                and data.states[0].reason == state.reason
                and data.flag_since[0] == snapshot.flag_since.get(name)
                and oldest_ns <= time_ns <= latest_ns
                and now_ns < road.expires_ns
            ):
                kmh, cv, vehicles = measured(state)
                figures = rows.road_figures(kmh, cv, vehicles)
                row = road.row
                told = {key: value for key, value in figures.items() if row[key] != value}
                if told:
                    changes[name[0]] = told
                    road.row = {**row, **told}
                road.expires_ns = time_ns + stale_ns + 1
            else:
                remade.add(name[0])
        remade.update(segment for segment, road in roads.items() if now_ns >= road.expires_ns)
        for segment in remade:
            data = roads[segment].data
            data = data.with_states(
                [snapshot.states[state.segment, state.rsu] for state in data.states],
                snapshot.flag_since,
            )
            row, made = roads[segment].row, _made(data, self._frame, now_ns)
            told = {key: value for key, value in made.row.items() if row[key] != value}
            if told:
                changes[segment] = told
            roads[segment] = made
        self.changes = changes
        self._collect(views=bool(remade))

    def _collect(self, *, views: bool) -> None:
        roads = self._roads.values()
        self.before, self.rows = self.rows, {road.data.segment: road.row for road in roads}
        if views:
            self.open = open_roads([road.view for road in roads])
            self.standing = tuple(road.view for road in roads if road.view.stopped)


def _made(data: RoadData, frame: _TableFrame, now_ns: int) -> _Road:
    cycle = None if frame.last is None else frame.last.cycle
    view = road_view(data, cycle, now_ns, frame.limits)
    plain = len(data.states) == 1 and not data.stopped
    if plain:
        plain = frame.limits.fault(data.states[0].time_ns, now_ns) is None
    expires_ns = _expires_ns(data, now_ns, frame.limits)
    return _Road(data, view, rows.road_row(view), expires_ns, plain)


def _same(a: RoadData, b: RoadData) -> bool:
    """Whether both have the same messages; these are replaced, never changed."""
    return (
        a.gate is b.gate
        and a.watched_by == b.watched_by
        and identical(a.states, b.states)
        and identical(a.stopped, b.stopped)
    )


def identical(a: Sequence[object], b: Sequence[object]) -> bool:
    """Whether both hold the same objects."""
    return len(a) == len(b) and all(map(is_, a, b))


def _expires_ns(data: RoadData, now_ns: int, limits: RoadLimits) -> int:
    """When its view changes by itself: as a message becomes stale, or no longer lies ahead."""
    stale_ns = round(limits.stale_after_s * 1e9)
    ahead_ns = round(limits.future_tolerance_s * 1e9)
    if len(data.states) == 1 and not data.stopped and data.states[0].time_ns <= now_ns + ahead_ns:
        # The usual case, once a second for each road.
        stale_at_ns = data.states[0].time_ns + stale_ns + 1
        return stale_at_ns if stale_at_ns > now_ns else _NEVER_NS
    times = [state.time_ns for state in data.states] + [told.time_ns for told in data.stopped]
    changes = [at for t in times for at in (t + stale_ns + 1, t - ahead_ns) if at > now_ns]
    return min(changes, default=_NEVER_NS)
