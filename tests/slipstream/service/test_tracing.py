"""Traces: off by default, to a collector by one setting."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from slipstream.bus import free_port
from slipstream.config import ServiceSettings, check
from slipstream.errors import InputError
from slipstream.service import Service
from slipstream.service.tracing import (
    MAX_SPARSE_SPANS,
    Tracing,
    is_on,
    note,
    span,
    sparse_span,
    traced,
)
from tests.slipstream.collector import collector


@traced("inner")
def inner() -> int:
    """Something."""
    return 7


@pytest.mark.slow
def test_off_nothing_is_made_or_imported() -> None:
    """A span is one and the same empty object, and OpenTelemetry is not loaded."""
    assert span("a", x=1) is span("b")
    assert sparse_span("a", rsu="r") is span("b")
    note(x=1)
    assert inner() == 7
    assert not is_on()
    code = (
        "import sys, slipstream.service.service as s, slipstream.config as c\n"
        "with s.Service('x', c.ServiceSettings()): pass\n"
        "print([n for n in sys.modules if n.startswith('opentelemetry')])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


def test_spans_come_with_their_places_and_attributes() -> None:
    """All of them by the end, named by daemon; a begin in the past is kept."""
    began_ns = time.time_ns() - 10**9
    with collector() as found:
        service = Service("edge", ServiceSettings(traces=found.endpoint + "/"))
        with service, span("outer", began_ns, rsu="r"):
            note(sequence=3)
            inner()
        (root,) = [each for each in found.spans if not each.parent]
        assert found.tree(root) == {"inner": {}}
    assert (root.service, root.began_ns) == ("slipstream-edge", began_ns)
    assert root.attributes == {"rsu": "r", "sequence": 3}
    assert not is_on()


def test_frequent_spans_are_bounded() -> None:
    """Thousands of states a second leave room for the cycle's spans."""
    with collector() as found:
        with Tracing("dispatcher", found.endpoint):
            began = time.monotonic()
            for _ in range(5000):
                with sparse_span("receive"):
                    pass
            seconds = int(time.monotonic() - began) + 2
            with span("cycle"):
                pass
        names = [each.name for each in found.spans]
    assert names.count("cycle") == 1
    assert MAX_SPARSE_SPANS <= names.count("receive") <= seconds * MAX_SPARSE_SPANS


@pytest.mark.long
def test_a_collector_that_is_away_holds_nothing_up(caplog: pytest.LogCaptureFixture) -> None:
    """The work goes on, one line tells of it, and the end comes soon."""
    with Tracing("x", f"http://127.0.0.1:{free_port()}"):
        for _ in range(2000):
            with span("a"):
                pass
        began = time.monotonic()
    assert time.monotonic() - began < 5.0
    assert 1 <= len([r for r in caplog.records if "traces:" in r.getMessage()]) <= 2


@pytest.mark.process
def test_without_the_extra_a_daemon_says_so(tmp_path: Path) -> None:
    """One line and exit status 2."""
    config = tmp_path / "agent.toml"
    config.write_text(
        f"[agents.a]\nstate = {str(tmp_path / 'state')!r}\nvehicles = [{{id = 'van'}}]\n"
        "[service]\ntraces = 'http://127.0.0.1:4318'\n"
    )
    code = (
        "import sys\n"
        "sys.modules['opentelemetry.sdk'] = sys.modules['opentelemetry.exporter'] = None\n"
        "from slipstream_cli.main import main\n"
        f"sys.exit(main(['agent', '--config', {str(config)!r}]))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.returncode == 2, run.stderr
    (line,) = run.stderr.splitlines()
    assert "service.traces" in line
    assert "pip install 'slipstream[tracing]'" in line


@pytest.mark.parametrize(
    "endpoint", ["", "127.0.0.1:4318", "grpc://host:4317", "http://", "http://a b"]
)
def test_what_is_no_endpoint_is_refused(endpoint: str) -> None:
    """By its key, before anything starts."""
    with pytest.raises(InputError, match="traces"):
        check({"traces": endpoint}, ServiceSettings, "x.toml")


@pytest.mark.long
def test_a_dead_collector_does_not_hold_up_a_stop() -> None:
    """It takes connections and says nothing: each batch that waits would take its whole limit."""
    with socket.create_server(("127.0.0.1", 0)) as dead:
        tracing = Tracing("x", f"http://127.0.0.1:{dead.getsockname()[1]}")
        with tracing:
            for _ in range(2000):
                with span("lost"):
                    pass
            began = time.monotonic()
        assert time.monotonic() - began < 3.5
