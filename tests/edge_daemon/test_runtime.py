"""Stages that take long are reported."""

from __future__ import annotations

import gc
import time

import pytest

from edge_daemon.runtime import StageTimer


def test_the_longest_of_each_part_is_told_once_and_longest_first() -> None:
    """In milliseconds; what was told is forgotten."""
    stages = StageTimer()
    stages.note("states", 0.012)
    stages.note("preview", 0.2)
    stages.note("states", 0.003)
    assert stages.report() == "preview 200 ms, states 12 ms"
    assert stages.report() == ""


def test_a_part_is_timed_also_if_it_fails() -> None:
    """A fault must not hide what took long before it."""
    stages = StageTimer()

    def fail() -> None:
        with stages.measure("states"):
            time.sleep(0.02)
            raise ValueError("x")

    with pytest.raises(ValueError, match="x"):
        fail()
    part, took, _ = stages.report().rsplit(" ", 2)
    assert part == "states"
    assert int(took) >= 20


@pytest.mark.slow
def test_collections_are_noticed_while_asked_for() -> None:
    """And no longer: the hook is taken away."""
    stages, before = StageTimer(), list(gc.callbacks)
    with stages.measure_garbage_collection():
        gc.collect()
    assert "garbage collection" in stages.report()
    gc.collect()
    assert stages.report() == ""
    assert gc.callbacks == before
