"""Units are asked for pictures only while somebody looks."""

from __future__ import annotations

import asyncio

from dashboard.web import pictures as module
from dashboard.web.pictures import Pictures
from slipstream.messages import preview_key, with_capture_time


def test_a_picture_has_the_time_that_it_was_taken(world, now_ns):
    """Not that of its arrival: a unit whose camera stopped sends its last one again."""
    key, clock = preview_key("rsu-1"), [now_ns]
    pictures = Pictures(clock_ns=lambda: clock[0])
    taken_ns = now_ns - 210 * 10**9
    pictures.accept(key, with_capture_time(world.jpeg(), taken_ns))
    told = pictures.latest(key)
    assert told is not None
    assert told.taken_ns == taken_ns
    pictures.accept(key, world.jpeg())
    told = pictures.latest(key)
    assert told is not None
    assert told.taken_ns == now_ns


class Asked:
    """What was listened for, one after the other."""

    def __init__(self) -> None:
        self.keys: list[frozenset[str]] = []

    def listen(self, key_expressions: frozenset[str]) -> None:
        """Remember it."""
        self.keys.append(key_expressions)


def test_whoever_asks_for_single_pictures_looks_on_for_a_while(monkeypatch):
    """A second one in time lengthens the look and asks for nothing anew; then it ends."""
    monkeypatch.setattr(module, "GLANCE_S", 0.2)
    asked, pictures = Asked(), Pictures()
    pictures.listen_by(asked)
    assert asked.keys == [frozenset()]

    async def look() -> float:
        begin = asyncio.get_running_loop().time()
        pictures.glance(preview_key("rsu-1"))
        await asyncio.sleep(0.1)
        pictures.glance(preview_key("rsu-1"))
        async with asyncio.timeout(30):
            while asked.keys[-1]:
                await asyncio.sleep(0.01)
        return asyncio.get_running_loop().time() - begin

    assert asyncio.run(look()) >= 0.3
    assert asked.keys == [frozenset(), frozenset({preview_key("rsu-1")}), frozenset()]
