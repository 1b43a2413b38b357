"""The feeds of a running dispatcher: made when asked for, and not too often."""

from __future__ import annotations

import gzip
import hashlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from dispatcher_daemon.service.feeds.datex2 import measured_data, site_table, table_version
from dispatcher_daemon.service.feeds.measurements import Measurement, measurements
from dispatcher_daemon.service.feeds.sites import Pair, Site, find_sites, watched_pairs
from dispatcher_daemon.service.feeds.wzdx import device_feed
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.messages import RsuHealth, SegmentState
from slipstream.roads import RoadNetwork

MIN_INTERVAL_S: Final = 1.0
"""A document of states is that old at least before another one is made: RSUs send each second."""
IDLE_SHARE: Final = 10.0
"""After a document has been made no other of its kind is for so many times as long as that took."""
MAX_RSUS: Final = 20_000
"""RSUs whose health is kept where the settings list none."""
MAX_RSUS_PER_SEGMENT: Final = 16
"""Of these, those that tell of the same segment: as many as their states are kept of."""
FORGOTTEN_AFTER: Final = 6.0
"""Times the age limit of a state after which the health of a silent one is forgotten."""


@dataclass(frozen=True)
class Document:
    """One publication.

    Attributes:
        body: as it is sent.
        time_ns: UTC at which it was made.
    """

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
    """What road authorities get. The bus's thread tells of RSUs' health, others ask.

    Args:
        network: the roads.
        settings: of the dispatcher.
        states: gives the latest admitted states.
        now_ns: the clock, UTC.
    """

    def __init__(
        self,
        network: RoadNetwork,
        settings: DispatcherSettings,
        states: Callable[[], tuple[SegmentState, ...]],
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._network = network
        self._settings = settings
        self._states = states
        self._now_ns = now_ns
        # When each was heard last, and its health; the one heard last at the end.
        self._healths: dict[str, tuple[int, RsuHealth]] = {}
        self._rsus_of: dict[str, set[str]] = {}
        self._health_lock = threading.Lock()
        self._sites: tuple[frozenset[Pair], tuple[Site, ...]] = (frozenset(), ())
        self._made: dict[str, _Made] = {}
        # Documents are made one at a time: a city's takes a second of a core.
        self._lock = threading.Lock()

    def on_health(self, health: RsuHealth) -> None:
        """Take in what an RSU says of itself."""
        listed = self._settings.rsus
        if listed is not None and health.rsu not in listed:
            return
        known = [name for name in set(health.segments) if name in self._network.segments]
        now_ns = self._now_ns()
        with self._health_lock:
            self._drop(health.rsu)
            if listed is None:
                self._forget_silent(now_ns)
            if len(self._healths) >= MAX_RSUS:
                return
            kept = []
            for name in sorted(known):
                rsus = self._rsus_of.setdefault(name, set())
                if listed is not None or len(rsus) < MAX_RSUS_PER_SEGMENT:
                    rsus.add(health.rsu)
                    kept.append(name)
            told = health.model_copy(update={"segments": tuple(kept)})
            self._healths[health.rsu] = now_ns, told

    def _forget_silent(self, now_ns: int) -> None:
        """Forget RSUs that have not been heard of for long; the others come after them."""
        before_ns = now_ns - round(1e9 * FORGOTTEN_AFTER * self._settings.stale_after_s)
        while self._healths:
            rsu, (heard_ns, _) = next(iter(self._healths.items()))
            if heard_ns >= before_ns:
                return
            self._drop(rsu)

    def _drop(self, rsu: str) -> None:
        _, health = self._healths.pop(rsu, (0, None))
        for name in () if health is None else health.segments:
            self._rsus_of[name].discard(rsu)

    def _heard(self, now_ns: int) -> dict[str, RsuHealth]:
        """The latest health of each RSU."""
        with self._health_lock:
            if self._settings.rsus is None:
                self._forget_silent(now_ns)
            return {rsu: health for rsu, (_, health) in self._healths.items()}

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
        )

    def _find_sites(self, states: tuple[SegmentState, ...], now_ns: int) -> tuple[Site, ...]:
        pairs = watched_pairs(self._settings.rsus, states, self._heard(now_ns).values())
        if pairs != self._sites[0] or not pairs:
            self._sites = pairs, find_sites(self._network, pairs)
        return self._sites[1]
