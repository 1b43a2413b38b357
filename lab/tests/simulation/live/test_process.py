"""The world's process, where it ends before it has begun."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterator
from multiprocessing import resource_tracker, spawn
from pathlib import Path

import pytest

from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream_lab.simulation.live.process import WorldProcess
from slipstream_lab.simulation.live.town import town

_PIPE_BYTES = 65536


@pytest.fixture
def dying() -> Iterator[None]:
    """New processes end at once, as a signal to all of a terminal's processes ends them."""
    resource_tracker.ensure_running()
    spawn.set_executable("/bin/false")
    yield
    spawn.set_executable(sys.executable)


@pytest.mark.timeout(60)
@pytest.mark.usefixtures("dying")
def test_a_process_that_dies_as_it_starts_is_not_waited_for(tmp_path: Path) -> None:
    """Though its order is more than a pipe holds; it is named, or nothing if all is to stop."""
    spec = town(tmp_path, BusSettings())
    assert len(pickle.dumps(spec)) > _PIPE_BYTES
    with WorldProcess(spec) as stopped:
        assert stopped.open(lambda: True, lambda _: None) == ()
    with WorldProcess(spec) as world, pytest.raises(InputError, match="exit status 1"):
        world.open(lambda: False, lambda _: None)
