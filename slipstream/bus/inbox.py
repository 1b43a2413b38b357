"""What has arrived on a subscription and waits for its handler: bounded and counted.

The newest sample of a key is dropped only where all that waits are such: then the one goes whose
key has been silent for longest.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from typing import Any, Final, Literal, get_args

import zenoh
from prometheus_client import Counter

from slipstream.messages import ENCODING, check_version
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

Handler = Callable[[str, bytes], None]

MAX_MESSAGE_BYTES: Final = 4 * 2**20
"""Largest payload that is taken; the CycleReport of a city of 10,000 segments has 1.2 MB."""
INBOX_BYTES: Final = 16 * 2**20
INBOX_SAMPLES: Final = 16_384
"""Limits of what waits for one handler. Beyond them the oldest sample that another one of its key
has followed is dropped; if each is the newest of its key, the oldest of all. A sample that takes
the place of an earlier one of its key counts from its own arrival."""
BUSY_BATCH: Final = 16
PAUSE_S: Final = 0.01
"""After so many samples at once the handler pauses where callbacks bring them: zenoh's thread needs
the interpreter's lock for each, and a handler that never waits lets go of it 200 times a second."""

_OURS: Final = zenoh.Encoding(ENCODING)

Outcome = Literal["taken", "superseded", "dropped", "oversized", "version"]
OUTCOMES: Final[tuple[Outcome, ...]] = get_args(Outcome)
_LOST: Final = ("dropped", "oversized", "version")
SAMPLES = Counter(
    "slipstream_bus_samples",
    "Samples received, by what became of them: taken by the handler, superseded by a later one of "
    "their key before that, dropped as too many waited, refused as oversized, or as of another "
    "schema version.",
    ["subscription", "outcome"],
)

MISSED = Counter(
    "slipstream_bus_missed_samples",
    "Samples that publishers had kept for too short a time to be recovered, by subscription.",
    ["subscription"],
)


def lost() -> int:
    """Number of samples that this process dropped, or refused as oversized or of another schema
    version, since its start.
    """
    return sum(
        int(sample.value)
        for metric in SAMPLES.collect()
        for sample in metric.samples
        if sample.name.endswith("_total") and sample.labels["outcome"] in _LOST
    )


class Inbox:
    """Samples between zenoh's thread and the handler's own thread.

    Args:
        handler: called for one sample after the other; what it raises is logged.
        every: see `slipstream.bus.session.Bus.subscribe`.
        callback: `accept` is a callback of zenoh's, not called by a thread that empties a channel.
    """

    def __init__(self, name: str, handler: Handler, *, every: bool, callback: bool = False) -> None:
        self._name = name
        self._callback = callback
        self._handler = handler
        self._every = every
        self._waiting: OrderedDict[object, tuple[str, bytes]] = OrderedDict()
        self._newest: dict[str, int] = {}
        self._followed: deque[int] = deque()
        self._bytes = 0
        self._arrived = 0
        self._closed = False
        self._changed = threading.Condition()
        self._limiter = LogLimiter()
        self._outcomes = {outcome: SAMPLES.labels(name, outcome) for outcome in OUTCOMES}
        self._missed = MISSED.labels(name)
        self._thread = threading.Thread(target=self._run, name=f"bus {name}", daemon=True)
        self._thread.start()

    def accept(self, sample: Any) -> None:
        """Take in a zenoh sample; returns at once."""
        self.accept_all((sample,))

    def accept_all(self, samples: Iterable[Any]) -> None:
        """Take in zenoh samples in their order; returns at once."""
        superseded = 0
        lines: list[tuple[Outcome, str]] = []
        with self._changed:
            for sample in samples:
                key, content = str(sample.key_expr), sample.payload
                size = len(content)
                if size > MAX_MESSAGE_BYTES:
                    lines.append(("oversized", f"{key}: a message of {size} bytes is refused"))
                    continue
                payload = content.to_bytes()
                if sample.encoding != _OURS:
                    try:
                        check_version(str(sample.encoding))
                    except ValueError as error:
                        lines.append(("version", f"{key}: a message of {error}, is refused"))
                        continue
                # Taken out and put in again: the newest states are the last to be dropped.
                previous = None if self._every else self._waiting.pop(key, None)
                if previous is not None:
                    superseded += 1
                    self._bytes -= len(previous[1])
                self._waiting[self._name_of_next(key)] = (key, payload)
                self._bytes += len(payload)
                while len(self._waiting) > INBOX_SAMPLES or self._bytes > INBOX_BYTES:
                    self._drop()
                    text = f"messages on {self._name} arrive faster than they are handled"
                    lines.append(("dropped", text))
            self._changed.notify()
        if superseded:
            self._outcomes["superseded"].inc(superseded)
        for outcome, line in lines:
            self._count(outcome, line)

    def count_missed(self, number: int) -> None:
        """Count samples that were published and did not come."""
        self._missed.inc(number)

    def _count(self, outcome: Outcome, line: str) -> None:
        self._outcomes[outcome].inc()
        if self._limiter.allow(outcome):
            log.warning("%s (and %d before)", line, self._limiter.suppressed(outcome))

    def _name_of_next(self, key: str) -> object:
        """What the next sample waits under: its key, or its number where every one is wanted."""
        if not self._every:
            return key
        self._arrived += 1
        before = self._newest.get(key)
        if before is not None:
            self._followed.append(before)
        self._newest[key] = self._arrived
        return self._arrived

    def _drop(self) -> None:
        if self._followed:
            key, payload = self._waiting.pop(self._followed.popleft())
        else:
            _, (key, payload) = self._waiting.popitem(last=False)
            self._newest.pop(key, None)
        self._bytes -= len(payload)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                batch, self._waiting, self._bytes = self._waiting, OrderedDict(), 0
                self._newest.clear()
                self._followed.clear()
            self._outcomes["taken"].inc(len(batch))
            for key, payload in batch.values():
                self._handle(key, payload)
            if self._callback and len(batch) >= BUSY_BATCH:
                time.sleep(PAUSE_S)

    def _handle(self, key: str, payload: bytes) -> None:
        if self._closed:
            return
        try:
            self._handler(key, payload)
        except Exception:
            if self._limiter.allow(""):
                before = self._limiter.suppressed("")
                log.exception("handler for %s failed (and %d times before)", key, before)

    def close(self) -> None:
        """Let go of what waits; no handler runs once it has returned."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)
