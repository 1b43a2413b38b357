"""Log lines as JSON."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.service.logs import JsonFormatter, readable

_DAEMON = """
import logging, threading, warnings
from slipstream.config import ServiceSettings
from slipstream.service import configure_logging
configure_logging("edge rsu-1", ServiceSettings(log_format="json"))
log = logging.getLogger("x")
log.info("%d frames", 3)
log.debug("below the level")
try:
    1 / 0
except ZeroDivisionError:
    log.exception("two\\nlines")
warnings.warn("old")
thread = threading.Thread(target=lambda: [][0], name="states")
thread.start()
thread.join()
raise RuntimeError("the end")
"""


@pytest.mark.process
def test_all_that_a_daemon_writes_is_one_object_a_line() -> None:
    """Faults with their stack, warnings, threads and the end that nothing caught."""
    run = subprocess.run([sys.executable, "-c", _DAEMON], capture_output=True, text=True)
    lines = [json.loads(line) for line in run.stderr.splitlines()]
    assert [(line["level"], line["message"].splitlines()[0]) for line in lines if line] == [
        ("INFO", "3 frames"),
        ("ERROR", "two"),
        ("WARNING", lines[2]["message"].splitlines()[0]),
        ("CRITICAL", "thread states ended"),
        ("CRITICAL", "ended by a fault"),
    ]
    assert "UserWarning: old" in lines[2]["message"]
    assert {line["daemon"] for line in lines} == {"edge rsu-1"}
    written = datetime.fromisoformat(lines[0]["time"])
    assert abs(datetime.now(UTC) - written) < timedelta(minutes=1)
    stacks = [line["exception"].splitlines()[-1] for line in lines if "exception" in line]
    assert [stack.partition(":")[0] for stack in stacks] == [
        "ZeroDivisionError",
        "IndexError",
        "RuntimeError",
    ]


@pytest.mark.long
@pytest.mark.process
def test_bad_input_is_an_object_too(tmp_path: Path) -> None:
    """The line that ends a daemon, and exit status 2."""
    config = tmp_path / "dispatcher.toml"
    config.write_text('network = "nowhere.net.xml"\n[service]\nlog_format = "json"\n')
    run = subprocess.run(
        [sys.executable, "-m", "slipstream_cli", "dispatcher", "--config", str(config)],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 2
    (line,) = [json.loads(text) for text in run.stderr.splitlines()]
    assert line["level"] == "ERROR"
    assert "nowhere.net.xml" in line["message"]


@pytest.mark.long
@pytest.mark.slow
@given(st.text(), st.text(min_size=1).filter(lambda name: name.isprintable()))
def test_any_message_is_one_line_and_comes_back(message: str, name: str) -> None:
    """What stands in a message cannot begin another line; the supervisor shows the text."""
    record = logging.LogRecord("x", logging.INFO, "f", 1, message, None, None)
    line = JsonFormatter(name).format(record)
    assert len(line.splitlines()) == 1
    assert readable(line) == [f"{name} INFO {message}"]


@given(st.text() | st.text().map(lambda text: f'{{"time": "{text}'))
def test_other_lines_stay_as_they_are(line: str) -> None:
    """A daemon may write what it wants, also what looks like JSON and is none."""
    assert readable(line) == [line]
