"""Reads past moments from the database, a few of them kept for those who look at the same."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Final

from dashboard.live import without_details
from dashboard.web.energy import EnergyBook
from dashboard.web.past.moment import moment_at, snapshot_at
from dashboard.web.past.views import ALARMS_BEGAN_S, Facts
from dashboard.web.tables import rows
from dashboard.web.tables.rows import Known, Scene
from slipstream.http.problems import Problem
from slipstream.messages import CycleReport
from storage import Reader

MAX_EVENTS: Final = 2000
KEPT_MOMENTS: Final = 32
KEPT_CYCLES: Final = 8
_STEP_NS: Final = 500_000_000
"""Moments that lie so near to each other are one."""


class StoredPast:
    """Moments that the database keeps; from any thread, one is read at a time.

    Args:
        rsus: roads by RSU as the settings have them; None: they do not.
        heard: roads by RSU as these tell now.
    """

    def __init__(
        self,
        reader: Reader,
        scene: Scene,
        energy: EnergyBook,
        rsus: Mapping[str, Sequence[str]] | None,
        heard: Callable[[], Mapping[str, Sequence[str]]] = dict,
    ) -> None:
        self._reader, self._scene, self.energy = reader, scene, energy
        self._rsus, self._heard = rsus, heard
        self._seen: dict[str, list[str]] | None = None
        self._lock = threading.Lock()
        self._moment = lru_cache(KEPT_MOMENTS)(self._read)
        # Whoever plays the past asks for a cycle's moments one after the other.
        self._cycles = lru_cache(KEPT_CYCLES)(self._read_cycles)

    def span(self) -> tuple[int, int] | None:
        """First and last moment that is kept, UTC ns; None: nothing is.

        Raises:
            StorageError: the database cannot be read.
        """
        return self._reader.span()

    def watched(self) -> Mapping[str, Sequence[str]]:
        """Roads by RSU: of the settings, else of those that are heard now and those whose states
        the last cycle used.

        Raises:
            StorageError: the database cannot be read.
        """
        if self._rsus is not None:
            return self._rsus
        if self._seen is None:
            latest, seen = self._reader.latest_cycle(), dict[str, list[str]]()
            for state in () if latest is None else self._reader.states(latest.cycle):
                seen.setdefault(state.rsu, []).append(state.segment)
            self._seen = seen
        return {**self._seen, **self._heard()}

    def at(self, time_ns: int) -> Known:
        """What was known at a moment.

        Raises:
            Problem: 404, nothing is kept of it.
            StorageError: the database cannot be read.
        """
        # The last moment itself must not become a later one.
        time_ns = time_ns // _STEP_NS * _STEP_NS + _STEP_NS - 1
        with self._lock:
            return self._moment(time_ns)

    def _read(self, time_ns: int) -> Known:
        span = self._reader.span()
        if span is None:
            raise Problem(404, "nothing is stored yet", "wait for the first cycle")
        if not span[0] - _STEP_NS < time_ns < span[1] + _STEP_NS:
            raise Problem(404, "nothing is kept of that moment", "ask /api/past for the range")
        facts = self._facts(time_ns)
        snapshot = snapshot_at(facts)
        return Known(snapshot, moment_at(facts, snapshot, self._scene), time_ns)

    def _read_cycles(self, number: int) -> tuple[CycleReport, ...]:
        cycles = self._reader.cycles(rows.MAX_CYCLES, before=number + 1, gates=False)
        return (*map(without_details, cycles[:-1]), *cycles[-1:])

    def _facts(self, time_ns: int) -> Facts:
        reader = self._reader
        number = reader.cycle_at(time_ns)
        return Facts(
            time_ns,
            cycles=() if number is None else self._cycles(number),
            plans=reader.plans_at(time_ns),
            orders=reader.orders_at(time_ns, rows.MAX_ORDERS),
            segments=reader.segments_at(time_ns),
            events=reader.events(
                time_ns - round(ALARMS_BEGAN_S * 1e9), time_ns + 1, limit=MAX_EVENTS
            ),
            energy=self.energy.at(time_ns),
            watched=self.watched(),
        )
