"""Counts as an edge publishes them: complete ones once, those of the running one each minute."""

from __future__ import annotations

import queue

import pytest

from edge_daemon.camera import Camera
from edge_daemon.publishing import CountsPublisher
from slipstream.bus import Bus, Router
from slipstream.config import BusSettings
from slipstream.messages import (
    ALL_COUNTS,
    SegmentCounts,
    counts_key,
    decode,
    running_counts_key,
)
from tests.dispatcher_daemon.service.feeds.states import counts

from .features.test_counts import NOON_S, QUARTER_S, Watched, drive


class Wire:
    """A bus that keeps what is put."""

    def __init__(self) -> None:
        self.put: list[tuple[str, SegmentCounts]] = []

    def publisher(self, key: str, *, history: int | None = None) -> WirePublisher:
        return WirePublisher(self, key)


class WirePublisher:
    def __init__(self, wire: Wire, key: str) -> None:
        self._wire, self._key = wire, key

    def put(self, told: SegmentCounts) -> None:
        self._wire.put.append((self._key, told))


@pytest.mark.long
def test_the_running_one_is_told_each_minute_and_a_complete_one_once(camera: Camera) -> None:
    """With each state the publisher is asked; it says no more than there is to tell."""
    wire = Wire()
    publisher = CountsPublisher("rsu", camera, wire)  # type: ignore[arg-type]
    watched = Watched(camera, NOON_S + QUARTER_S - 150)
    for second in range(200):
        step(watched)
        publisher.publish("approach", watched.pipeline.counts, float(second))
    running = [told for key, told in wire.put if key == running_counts_key("rsu", "approach")]
    complete = [told for key, told in wire.put if key == counts_key("rsu", "approach")]
    assert len(running) == 4
    assert not any(told.complete for told in running)
    assert [told.began_ns for told in complete] == [round(NOON_S * 1e9)]
    assert complete[0].watched_s == pytest.approx(150, abs=0.5)


def step(watched: Watched) -> None:
    """A second, in which only the publisher takes what is complete."""
    counts = watched.pipeline.counts
    taken, counts.complete = counts.complete, lambda _: []  # type: ignore[method-assign]
    watched.look(1.0, [drive(15.0)])
    counts.complete = taken  # type: ignore[method-assign]


@pytest.mark.process
def test_who_comes_late_gets_the_complete_ones_of_the_last_hour(
    camera: Camera, router: Router
) -> None:
    """A dispatcher that was down for less loses none."""
    settings = BusSettings(connect=(router.endpoint,))
    with Bus.open(settings) as edge, Bus.open(settings) as late:
        publisher = CountsPublisher("rsu", camera, edge)
        heard: queue.Queue[SegmentCounts] = queue.Queue()

        def hear(key: str, payload: bytes) -> None:
            heard.put(decode(SegmentCounts, payload, key))

        complete = [counts("approach", rsu="rsu", quarters_ago=ago) for ago in range(5, -1, -1)]
        for one in complete:
            publisher._publishers["approach"][0].put(one)
        late.subscribe(ALL_COUNTS, hear, every=True)
        got = [heard.get(timeout=30) for _ in range(4)]
        assert got == complete[-4:]
