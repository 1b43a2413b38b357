"""Progress of long work: percent and remaining time, on a terminal only."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest

from slipstream_cli.progress import ProgressLine


class Terminal(io.StringIO):
    """A stream that says it is one."""

    def isatty(self) -> bool:
        """As a terminal."""
        return True


def test_remaining_time_follows_the_rate_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter in a minute leaves three; nothing is told in the first seconds, nothing remains of
    the line before."""
    times_s = iter([100.0, 101.0, 160.0, 300.0, 340.0])
    clock = SimpleNamespace(monotonic=lambda: next(times_s))
    monkeypatch.setattr("slipstream_cli.progress.time", clock)
    stream = Terminal()
    with ProgressLine("planning", stream) as shown:
        for done in (1, 25, 90, 100):
            shown.update(done, 100)
    lines = [line.rstrip() for line in stream.getvalue().split("\r")[1:]]
    assert lines == [
        "planning   1 %",
        "planning  25 %, 3 min left",
        "planning  90 %, 22 s left",
        "planning 100 %, 0 s left",
    ]
    widths = {len(line.rstrip("\n")) for line in stream.getvalue().split("\r")[1:]}
    assert len(widths) == 1


def test_a_pipe_gets_nothing() -> None:
    """No line, no end of one."""
    stream = io.StringIO()
    with ProgressLine("planning", stream) as shown:
        shown.update(1, 2)
    assert stream.getvalue() == ""
