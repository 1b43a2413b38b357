"""The feeds of a running dispatcher: made when asked for, and not too often."""

from __future__ import annotations

import gzip
import hashlib
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from dispatcher_daemon.service.feeds.datex2 import measured_data, site_table, table_version
from dispatcher_daemon.service.feeds.measurements import Measurement, measurements
from dispatcher_daemon.service.feeds.sites import Pair, Site, find_sites, watched_pairs
from dispatcher_daemon.service.feeds.wzdx import device_feed
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.messages import RsuHealth, SegmentCounts, SegmentState
from slipstream.roads import RoadNetwork

MIN_INTERVAL_S: Final = 1.0
"""A document of states is that old at least before another one is made: RSUs send each second."""
IDLE_SHARE: Final = 10.0
"""After a document has been made no other of its kind is for so many times as long as that took."""
FORGOTTEN_AFTER: Final = 6.0
"""Times the age limit of a state after which the health of a silent one is forgotten."""


@dataclass(frozen=True)
class Document:
    """One publication."""

    body: bytes
    time_ns: int

    @cached_property
    def digest(self) -> str:
        """Another one for each other body."""
        return hashlib.sha256(self.body).hexdigest()[:32]

    @cached_property
    def packed(self) -> bytes:
        """The body, packed with gzip."""
        return gzip.compress(self.body, 5, mtime=0)


@dataclass(frozen=True)
class _Made:
    document: Document
    key: str
    next_s: float


class Feeds:
    """What road authorities get. The bus's thread tells of RSUs' health, others ask."""

    def __init__(
        self,
        network: RoadNetwork,
        settings: DispatcherSettings,
        states: Callable[[], tuple[SegmentState, ...]],
        healths: Callable[[], Mapping[str, tuple[int, RsuHealth]]],
        now_ns: Callable[[], int] = time.time_ns,
        counts: Callable[[], tuple[SegmentCounts, ...]] = tuple,
    ) -> None:
        self._network = network
        self._settings = settings
        self._states = states
        self._now_ns = now_ns
        self._healths, self._counts = healths, counts
        self._sites: tuple[frozenset[Pair], tuple[Site, ...]] = (frozenset(), ())
        self._made: dict[str, _Made] = {}
        # Documents are made one at a time: a city's takes a second of a core.
        self._lock = threading.Lock()

    def _heard(self, now_ns: int) -> dict[str, RsuHealth]:
        """The latest health of each RSU that has not been silent for long."""
        silent_ns = round(1e9 * FORGOTTEN_AFTER * self._settings.stale_after_s)
        known = self._healths().items()
        return {rsu: told for rsu, (heard_ns, told) in known if now_ns - heard_ns <= silent_ns}

    def sites(self) -> Document:
        """DATEX II: the measurement site table.

        Raises:
            InputError: no site is known yet, or the network has no latitude and longitude.
        """
        with self._lock:
            now_ns = self._now_ns()
            sites = self._find_sites(self._states(), now_ns)
            version = table_version(sites)
            return self._kept(
                "sites",
                version,
                lambda: site_table(sites, self._settings.feeds, now_ns),
                now_ns,
            )

    def measured(self) -> Document:
        """DATEX II: the measured data; errors as of `sites`."""

        def make(now_ns: int) -> bytes:
            return measured_data(self._measurements(now_ns), self._settings.feeds, now_ns)

        return self._timed("measured", make)

    def devices(self) -> Document:
        """WZDx: the device feed.

        Raises:
            InputError: the network has no latitude and longitude.
        """

        def make(now_ns: int) -> bytes:
            return device_feed(
                self._measurements(now_ns),
                self._heard(now_ns),
                self._settings.feeds,
                now_ns,
                stale_after_s=self._settings.stale_after_s,
            )

        return self._timed("devices", make)

    def _timed(self, kind: str, make: Callable[[int], bytes]) -> Document:
        with self._lock:
            made = self._made.get(kind)
            if made is not None and time.monotonic() < made.next_s:
                return made.document
            now_ns = self._now_ns()
            return self._kept(kind, str(now_ns), lambda: make(now_ns), now_ns)

    def _kept(self, kind: str, key: str, make: Callable[[], bytes], now_ns: int) -> Document:
        """The document of a key, made unless it is the one that was made last."""
        made = self._made.get(kind)
        if made is None or made.key != key:
            began = time.monotonic()
            document = Document(make(), now_ns)
            ended = time.monotonic()
            pause_s = max(MIN_INTERVAL_S, IDLE_SHARE * (ended - began))
            made = self._made[kind] = _Made(document, key, ended + pause_s)
        return made.document

    def _measurements(self, now_ns: int) -> tuple[Measurement, ...]:
        states = self._states()
        return measurements(
            self._find_sites(states, now_ns),
            states,
            self._network,
            now_ns,
            stale_after_s=self._settings.stale_after_s,
            counts=self._counts(),
        )

    def _find_sites(self, states: tuple[SegmentState, ...], now_ns: int) -> tuple[Site, ...]:
        heard = self._heard(now_ns).values()
        pairs = watched_pairs(self._settings.rsus, states, heard)
        if pairs != self._sites[0] or not pairs:
            self._sites = pairs, find_sites(self._network, pairs)
        return self._sites[1]
