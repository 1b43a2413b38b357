"""What happens, on its way from the dispatcher's threads to each caller that listens.

Plans, cycles, alarms and changes of orders are numbered and kept for a while, so that a caller that
was away goes on where it stopped. States are not: the newest of an RSU replaces one that a caller
has not taken yet. Nothing here ever waits for a caller.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Final, Literal, get_args

from slipstream.http.queue import EventQueue, check_room
from slipstream.messages import Message, SegmentState
from slipstream.orders import OrderChange

Kind = Literal["plan", "state", "cycle", "order", "alarm"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)

KEPT_EVENTS: Final = 1000
KEPT_BYTES: Final = 16 * 2**20
"""Numbered events that are kept for callers that come back: so many, or fewer where they would be
larger than this, as reports that name thousands of orders are."""
MAX_WAITING: Final = 2000
"""Numbered events that a caller may have ahead of it; beyond, one `reset` takes their place, as a
burst may be larger than what any caller reads meanwhile."""
MAX_STREAMS: Final = 32
MAX_STREAMS_OF_ONE: Final = 8
"""Of one token, or of one address without a token."""


@dataclass(frozen=True)
class HubEvent:
    """One thing that happened.

    Attributes:
        kind: of it, or "reset": events between the caller's last one and now are lost.
        value: a state, of which most are replaced before anybody takes them; or all else as
            `text/event-stream` has it, which is a seventh of the object.
        id: its number, with the run of the dispatcher; None: not numbered.
    """

    kind: Kind | Literal["reset"]
    value: SegmentState | bytes
    id: str | None = None

    @cached_property
    def encoded(self) -> bytes:
        """As `text/event-stream` has it."""
        if isinstance(self.value, bytes):
            return self.value
        return _encoded(self.kind, self.value.to_bytes())


class Stream(EventQueue[HubEvent]):
    """The events that one caller has not taken yet."""

    def __init__(
        self, kinds: Collection[Kind], loop: asyncio.AbstractEventLoop, caller: str
    ) -> None:
        super().__init__(loop, caller)
        self.kinds = frozenset(kinds)
        self._states: dict[tuple[str, str], HubEvent] = {}

    def put(self, event: HubEvent) -> None:
        """Add an event of a kind that it wants."""
        with self._lock:
            if isinstance(event.value, SegmentState):
                self._states[event.value.segment, event.value.rsu] = event
            elif len(self._waiting) >= MAX_WAITING:
                self._waiting.clear()
                self._waiting.append(_reset("too many events at once"))
            elif not self.closed:
                self._waiting.append(event)
        self._notify()

    def _drained(self) -> list[HubEvent]:
        found = [*super()._drained(), *self._states.values()]
        self._states.clear()
        return found


class EventHub:
    """Passes events on to streams; safe for threads.

    Args:
        run: what tells this run of the dispatcher from others, in the ids of events.
    """

    def __init__(self, run: int) -> None:
        self._run = run
        self._count = 0
        self._lock = threading.Lock()
        self._kept: deque[HubEvent] = deque()
        self._kept_bytes = 0
        self._streams: set[Stream] = set()

    def publish(self, kind: Kind, value: Message | OrderChange) -> None:
        """Tell all that listen; from any thread, and without waiting for any of them."""
        if kind == "state" and not self._streams:
            return
        data = value if isinstance(value, SegmentState) else _json(value)
        with self._lock:
            event = (
                HubEvent(kind, data) if isinstance(data, SegmentState) else self._next(kind, data)
            )
            for stream in self._streams:
                if kind in stream.kinds:
                    stream.put(event)

    def open(self, kinds: Collection[Kind], last_id: str | None, caller: str) -> Stream:
        """A new stream in the running event loop.

        Args:
            last_id: of the last event that its caller has had; None: it wants what comes from now.
            caller: who wants it, in words.

        Raises:
            Problem: there are too many, of this caller or of all.
        """
        stream = Stream(kinds, asyncio.get_running_loop(), caller)
        with self._lock:
            self._streams = {s for s in self._streams if not s.closed}
            check_room(self._streams, caller, MAX_STREAMS, MAX_STREAMS_OF_ONE)
            for event in () if last_id is None else self._since(last_id):
                if event.kind == "reset" or event.kind in stream.kinds:
                    stream.put(event)
            self._streams.add(stream)
        return stream

    def close(self, stream: Stream) -> None:
        """End a stream."""
        stream.close()
        with self._lock:
            self._streams.discard(stream)

    def close_all(self) -> None:
        """End all streams."""
        with self._lock:
            for stream in self._streams:
                stream.close()
            self._streams = set()

    def _next(self, kind: Kind, data: bytes) -> HubEvent:
        """A numbered event, which is kept."""
        self._count += 1
        number = f"{self._run}-{self._count}"
        event = HubEvent(kind, _encoded(kind, data, number), number)
        self._kept.append(event)
        self._kept_bytes += len(event.encoded)
        while len(self._kept) > KEPT_EVENTS or self._kept_bytes > KEPT_BYTES:
            self._kept_bytes -= len(self._kept.popleft().encoded)
        return event

    def _since(self, last_id: str) -> Iterator[HubEvent]:
        run, _, text = last_id.partition("-")
        number = int(text) if text.isdecimal() and len(text) < 20 else -1
        first = self._count - len(self._kept) + 1
        if run != str(self._run) or not first - 1 <= number <= self._count:
            yield _reset("events since your last one are no longer kept")
            return
        for event in self._kept:
            if event.id is not None and int(event.id.rpartition("-")[2]) > number:
                yield event


def _reset(why: str) -> HubEvent:
    told = {"reason": f"{why}; read the present state again"}
    return HubEvent("reset", _encoded("reset", json.dumps(told).encode()))


def _encoded(kind: str, data: bytes, number: str | None = None) -> bytes:
    head = "" if number is None else f"id: {number}\n"
    # JSON has no line ends of its own.
    return f"{head}event: {kind}\ndata: ".encode() + data + b"\n\n"


def _json(value: Message | OrderChange) -> bytes:
    if isinstance(value, OrderChange):
        return json.dumps(asdict(value)).encode()
    return value.to_bytes()
