"""How samples get from zenoh to an inbox: by callbacks, or from a channel."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Set
from typing import Any, Final

import zenoh

from slipstream.bus.inbox import Inbox
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

_CHANNEL_SAMPLES: Final = 4096
"""Samples that wait for a subscription's thread; beyond them zenoh's thread waits, and the link.

It is 0.4 s of 10,000 states a second. Samples may be of any size up to
`zenoh_config.RECEIVE_LIMIT_BYTES`: a sender of the largest makes a receiver hold what
the link brings while this thread has no turn.
"""
_BATCH: Final = 256
"""Samples that are handed to the inbox at once."""
_GATHER_S: Final = 0.002
"""Samples gather for so long, so that a thread wakes up 500 times a second at most."""
_BUSY_GATHER_S: Final = 0.02
_BUSY: Final = 8
"""Where so many have gathered meanwhile, they gather for longer: each turn costs as much as some of
them."""


class _Declared:
    """A declared subscriber, with the listener for what could not be recovered."""

    def __init__(
        self, session: Any, key: str, to: Any, missed: Callable[[int], None], *, history: bool
    ) -> None:
        if not history:
            self.subscriber, self._misses = session.declare_subscriber(key, to), None
            return
        self.subscriber = zenoh.ext.declare_advanced_subscriber(
            session,
            key,
            to,
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        self._misses = self.subscriber.sample_miss_listener(lambda miss: missed(miss.nb))

    def undeclare(self) -> None:
        """Receive no more."""
        if self._misses is not None:
            self._misses.undeclare()
        self.subscriber.undeclare()


class Listener:
    """Subscriptions that share one inbox and its handler; open it with `Bus.listener`."""

    def __init__(self, session: Any, samples: Inbox) -> None:
        self._session, self._samples = session, samples
        self._subscribers: dict[str, _Declared] = {}

    def listen(self, key_expressions: Set[str], *, history: bool = False) -> None:
        """Receive samples of these key expressions, and of no others from now on.

        Args:
            history: for new ones, also what publishers sent before, and repair gaps.
        """
        for key in self._subscribers.keys() - key_expressions:
            self._subscribers.pop(key).undeclare()
        for key in sorted(key_expressions - self._subscribers.keys()):
            self._subscribers[key] = self._declare(key, history=history)

    def _declare(self, key: str, *, history: bool) -> _Declared:
        samples = self._samples
        return _Declared(self._session, key, samples.accept, samples.count_missed, history=history)

    def close(self) -> None:
        """Receive no more; no handler runs once it has returned."""
        self.listen(frozenset())
        self._samples.close()


class Subscription:
    """One key expression's samples, taken from a channel of zenoh's by a thread.

    A callback needs the interpreter's lock for each sample, which beside a busy thread it gets 200
    times a second; links drop what waits meanwhile. One turn of this thread empties the channel.
    """

    def __init__(self, session: Any, key: str, samples: Inbox, *, history: bool) -> None:
        self._samples = samples
        channel: Any = zenoh.handlers.FifoChannel(_CHANNEL_SAMPLES)
        self._declared = _Declared(session, key, channel, samples.count_missed, history=history)
        self._channel = self._declared.subscriber.handler
        self._limiter = LogLimiter()
        self._thread = threading.Thread(target=self._run, name=f"bus {key} in", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while (sample := self._received(self._channel.recv)) is not None:
            taken = 0
            while sample is not None:
                batch: list[Any] = []
                while sample is not None and len(batch) < _BATCH:
                    batch.append(sample)
                    sample = self._received(self._channel.try_recv)
                self._accept(batch)
                taken += len(batch)
            if taken < _CHANNEL_SAMPLES // 4:
                time.sleep(_BUSY_GATHER_S if taken >= _BUSY else _GATHER_S)

    @staticmethod
    def _received(receive: Callable[[], Any]) -> Any:
        try:
            return receive()
        except zenoh.ZError:
            return None  # the channel is closed and empty

    def _accept(self, batch: list[Any]) -> None:
        try:
            self._samples.accept_all(batch)
        except Exception:
            if self._limiter.allow(""):
                log.exception("samples could not be taken in")

    def close(self) -> None:
        """Receive no more; no handler runs once it has returned."""
        self._declared.undeclare()
        self._thread.join(timeout=2.0)
        self._samples.close()
