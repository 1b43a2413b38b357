"""The benchmark of the agents: made-up traffic that agents take, and the short form."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from msgspec.structs import replace

from slipstream.messages import SegmentState, VehicleAdvice
from slipstream_lab.benchmarks.agents import __main__ as command
from slipstream_lab.benchmarks.agents.bench import AgentFigures, checks
from slipstream_lab.benchmarks.agents.traffic import GROUP, BenchVan, roadside
from vehicle_agent.agent import AgentParameters
from vehicle_agent.host import AgentHost


def test_its_traffic_is_advised_and_its_pairs_are_close() -> None:
    """Agents in this process take the plans, and the second of each pair follows the first."""
    began_ns = time.time_ns()
    vans = [BenchVan(i, began_ns) for i in range(GROUP)]
    host = AgentHost({van.name: AgentParameters() for van in vans})
    for van in vans:
        host.receive(van.plan(), began_ns)
    latest: dict[str, VehicleAdvice] = {}
    for tick in range(60):
        now_ns = began_ns + tick * 10**8
        for message in roadside(GROUP, tick):
            if isinstance(message, SegmentState):
                message = replace(message, time_ns=now_ns)
            host.receive(message, now_ns)
        for van in vans:
            latest[van.name], outgoing = host.advise(van.sensing(now_ns), now_ns)
            for _, message in outgoing:
                host.receive(message, now_ns)
    assert [latest[van.name].mode in ("follow", "open_gap") for van in vans] == [
        *(False, True, False, True),
    ]


def test_a_missed_aim_is_one() -> None:
    """Each aim by its own figure."""
    one = AgentFigures(1, 60, 0.02, 0.5, 3.0, 9.0, 1.0, 55.0, {"cruise": 1.0})
    assert all(check.reached for check in checks(one, one))
    bad = AgentFigures(100, 60, 1.1, 2.1, 3.0, 9.0, 0.98, 61.0, {"cruise": 1.0})
    assert not any(check.reached for check in checks(bad, bad))


@pytest.mark.nightly
@pytest.mark.process
def test_the_short_form_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Real processes; on a loaded machine aims may be missed, but nothing is left out."""
    status = command.main(["--short", "--json", "--out", str(tmp_path)])
    assert status in (0, 1)
    figures = json.loads(capsys.readouterr().out)
    assert figures["one"]["rss_mb"] < 80
    assert figures["many"]["vans"] == 20
    assert figures["many"]["advised"] > 0.3
    assert figures["many"]["modes"].get("none", 0.0) < 0.5
