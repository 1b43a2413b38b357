"""What waits for a handler: bounded in number and bytes, the latest of each key, all counted."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count

import pytest
import zenoh

from slipstream.bus.inbox import (
    INBOX_BYTES,
    INBOX_SAMPLES,
    MAX_MESSAGE_BYTES,
    OUTCOMES,
    SAMPLES,
    Inbox,
    lost,
)
from slipstream.messages import ENCODING, SCHEMA

Open = Callable[[bool], "Slow"]
_names = count()


@dataclass(frozen=True)
class Payload:
    """As zenoh's ZBytes."""

    content: bytes

    def __len__(self) -> int:
        return len(self.content)

    def to_bytes(self) -> bytes:
        """The payload."""
        return self.content


@dataclass(frozen=True)
class Sample:
    """As zenoh's Sample."""

    key_expr: str
    payload: Payload
    encoding: zenoh.Encoding = field(default_factory=lambda: zenoh.Encoding(ENCODING))


class Slow:
    """An inbox whose handler holds its first sample until `release`."""

    def __init__(self, every: bool) -> None:
        self.taken: list[tuple[str, bytes]] = []
        self._name = f"test {next(_names)}"
        self._holding, self._released = threading.Event(), threading.Event()
        self._changed = threading.Condition()
        self._inbox = Inbox(self._name, self._handle, every=every)
        self.put("first", b"")
        assert self._holding.wait(30)

    def _handle(self, key: str, payload: bytes) -> None:
        self._holding.set()
        assert self._released.wait(30)
        with self._changed:
            self.taken.append((key, payload))
            self._changed.notify()

    def put(self, key: str, content: bytes, encoding: str = ENCODING) -> None:
        """A sample arrives."""
        self._inbox.accept(Sample(key, Payload(content), zenoh.Encoding(encoding)))

    def release(self, number: int) -> list[tuple[str, bytes]]:
        """Let the handler go on; returns what it has got after the first, once that is so many."""
        self._released.set()
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.taken) == number + 1, 30)
        return self.taken[1:]

    def counts(self) -> dict[str, int]:
        """Samples by what became of them; the first is not among them."""
        found = {o: int(SAMPLES.labels(self._name, o)._value.get()) for o in OUTCOMES}
        return found | {"taken": found["taken"] - 1}

    def close(self) -> None:
        """End its thread."""
        self._released.set()
        self._inbox.close()


def counts(**expected: int) -> dict[str, int]:
    """Samples by what became of them, 0 where it is not named."""
    return dict.fromkeys(OUTCOMES, 0) | expected


@pytest.fixture
def slow() -> Iterator[Open]:
    """Makes inboxes that are closed at the end."""
    opened = []

    def make(every: bool) -> Slow:
        opened.append(Slow(every))
        return opened[-1]

    yield make
    for inbox in opened:
        inbox.close()


def test_the_latest_of_each_key_is_kept(slow: Open) -> None:
    """A later sample takes the place of the one that waits, and comes in its own turn."""
    inbox = slow(False)
    for key, content in (("a", b"1"), ("b", b"1"), ("a", b"2"), ("a", b"3")):
        inbox.put(key, content)
    assert inbox.release(2) == [("b", b"1"), ("a", b"3")]
    assert inbox.counts() == counts(taken=2, superseded=2)


def test_every_sample_is_kept_where_each_one_counts(slow: Open) -> None:
    """A count of messages, or the reports of cycles."""
    inbox = slow(True)
    for content in (b"1", b"2"):
        inbox.put("a", content)
    assert inbox.release(2) == [("a", b"1"), ("a", b"2")]
    assert inbox.counts()["superseded"] == 0


@pytest.mark.attack
@pytest.mark.parametrize("every", [True, False])
def test_the_newest_of_each_key_outlives_a_burst(slow: Open, every: bool) -> None:
    """10,000 messages of 1,000 keys in a quarter of their room, some keys early only."""
    inbox, room = slow(every), INBOX_BYTES // 2500
    newest = {}
    for number in range(10_000):
        key = f"key {number % 1000 if number < 2000 else number % 900}"
        newest[key] = str(number).encode().ljust(room)
        inbox.put(key, newest[key])
    kept = 2500 if every else 1000
    taken = inbox.release(kept)
    assert dict(taken) == newest
    if every:
        numbers = [int(content) for _, content in taken]
        assert numbers == sorted(numbers)
    dropped, superseded = (7500, 0) if every else (0, 9000)
    assert inbox.counts() == counts(taken=kept, superseded=superseded, dropped=dropped)


@pytest.mark.attack
@pytest.mark.parametrize("every", [True, False])
def test_bytes_that_wait_are_bounded(slow: Open, every: bool) -> None:
    """The oldest go first, and each one is counted."""
    inbox = slow(every)
    content = bytes(INBOX_BYTES // 8)
    for number in range(20):
        inbox.put(f"key {number}", content)
    assert [key for key, _ in inbox.release(8)] == [f"key {number}" for number in range(12, 20)]
    assert inbox.counts() == counts(taken=8, dropped=12)


@pytest.mark.slow
@pytest.mark.attack
@pytest.mark.parametrize("size", [0, INBOX_BYTES // 100])
def test_of_too_many_keys_those_that_are_silent_go(slow: Open, size: int) -> None:
    """A key that is told again before the limit is reached keeps its newest sample."""
    inbox, room = slow(False), INBOX_SAMPLES if size == 0 else 100
    for number in range(room):
        inbox.put(f"key {number}", b"1".ljust(size))
    told_again = [f"key {number}" for number in range(0, room, 2)]
    for key in told_again:
        inbox.put(key, b"2".ljust(size))
    for number in range(room // 2):
        inbox.put(f"new {number}", b"1".ljust(size))
    taken = dict(inbox.release(room))
    assert taken.keys() == {*told_again, *(f"new {number}" for number in range(room // 2))}
    assert {taken[key].strip() for key in told_again} == {b"2"}
    assert inbox.counts() == counts(taken=room, superseded=room // 2, dropped=room // 2)


def test_another_version_is_refused(slow: Open, caplog: pytest.LogCaptureFixture) -> None:
    """And counted as lost, with a line that names both; what says nothing of it is taken."""
    inbox, before, mark = slow(False), lost(), ENCODING.removesuffix(str(SCHEMA))
    for version in ("2", "1.1", "two"):
        inbox.put("a", b"{}", mark + version)
    for number, encoding in enumerate(("zenoh/bytes", "application/json", ENCODING)):
        inbox.put(f"key {number}", b"{}", encoding)
    assert inbox.release(3) == [(f"key {number}", b"{}") for number in range(3)]
    assert inbox.counts() == counts(taken=3, version=3)
    assert lost() == before + 3
    (line,) = [record.getMessage() for record in caplog.records]
    assert "a: a message of schema '2', where 1 is read, is refused" in line


@pytest.mark.attack
def test_a_flood_of_new_keys_is_bounded(slow: Open) -> None:
    """Small samples are bounded by their number."""
    inbox = slow(False)
    for number in range(INBOX_SAMPLES + 7):
        inbox.put(f"key {number}", b"")
    inbox.release(INBOX_SAMPLES)
    assert inbox.counts()["dropped"] == 7


@pytest.mark.attack
def test_a_message_that_is_too_large_is_refused(
    slow: Open, caplog: pytest.LogCaptureFixture
) -> None:
    """It never waits; a line a minute names the key and the size."""
    inbox, before = slow(False), lost()
    for _ in range(3):
        inbox.put("a", bytes(MAX_MESSAGE_BYTES + 1))
    inbox.put("a", bytes(MAX_MESSAGE_BYTES))
    inbox.release(1)
    assert inbox.counts() == counts(taken=1, oversized=3)
    assert lost() == before + 3
    (line,) = [record.getMessage() for record in caplog.records]
    assert f"a: a message of {MAX_MESSAGE_BYTES + 1} bytes is refused" in line


@pytest.mark.attack
def test_counts_agree_under_a_flood_from_many_threads() -> None:
    """taken + superseded + dropped = received, once nothing waits."""
    name = f"test {next(_names)}"
    last = threading.Event()
    inbox = Inbox(name, lambda key, _: last.set() if key == "last" else None, every=False)

    def send(sender: int) -> None:
        for number in range(2000):
            inbox.accept(Sample(f"{sender} {number % 50}", Payload(b"state")))

    threads = [threading.Thread(target=send, args=(sender,)) for sender in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    inbox.accept(Sample("last", Payload(b"")))
    assert last.wait(30)
    inbox.close()
    assert sum(int(SAMPLES.labels(name, outcome)._value.get()) for outcome in OUTCOMES) == 8001
