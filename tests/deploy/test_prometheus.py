"""Prometheus' rules and Grafana's dashboard ask for what the daemons measure."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from prometheus_client import REGISTRY

from .conftest import ROOT

RULES = ROOT / "deploy" / "prometheus" / "rules.yml"
DASHBOARD = ROOT / "deploy" / "grafana" / "slipstream.json"
OWN = re.compile(r"\b(?:slipstream|process)_[a-z0-9_]+")
SUFFIXES = {
    "counter": ("_total", "_created"),
    "histogram": ("_bucket", "_sum", "_count", "_created"),
    "gauge": ("",),
}


@pytest.fixture(scope="module")
def measured() -> set[str]:
    """Names of all series that the daemons have."""
    for module in (
        "dashboard.metrics",
        "dispatcher_daemon.metrics",
        "edge_daemon.metrics",
        "slipstream.bus.inbox",
        "slipstream.messages.base",
        "vehicle_agent.metrics",
    ):
        importlib.import_module(module)
    return {
        family.name + suffix
        for family in REGISTRY.collect()
        for suffix in SUFFIXES.get(family.type, ("",))
    }


def rules() -> list[dict[str, Any]]:
    """All alerts."""
    groups = yaml.safe_load(RULES.read_text())["groups"]
    return [rule for group in groups for rule in group["rules"]]


def panels() -> list[dict[str, Any]]:
    """All panels with queries."""
    found = json.loads(DASHBOARD.read_text())["panels"]
    return [panel for panel in found if panel["type"] != "row"]


def expressions() -> Iterator[str]:
    """What both ask Prometheus."""
    for rule in rules():
        yield rule["expr"]
    for panel in panels():
        for target in panel["targets"]:
            yield target["expr"]


def test_every_metric_that_is_asked_for_exists(measured: set[str]) -> None:
    """By the names under which the daemons serve them."""
    asked = {name for expression in expressions() for name in OWN.findall(expression)}
    assert len(asked) > 20
    assert asked - measured == set()


def test_each_alert_says_how_bad_it_is_and_what_to_do() -> None:
    """Names differ; severities are those of the alarms."""
    found = rules()
    assert len({rule["alert"] for rule in found}) == len(found)
    for rule in found:
        assert rule["labels"]["severity"] in ("critical", "warning", "info")
        assert set(rule["annotations"]) == {"summary", "description"}


def test_panels_lie_beside_each_other() -> None:
    """None over another one, none beyond the 24 columns; ids and titles are unique."""
    cells: set[tuple[int, int]] = set()
    for panel in json.loads(DASHBOARD.read_text())["panels"]:
        place = panel["gridPos"]
        assert place["x"] + place["w"] <= 24
        own = {
            (place["x"] + across, place["y"] + down)
            for across in range(place["w"])
            for down in range(place["h"])
        }
        assert not own & cells
        cells |= own
    for field in ("id", "title"):
        values = [panel[field] for panel in panels()]
        assert len(set(values)) == len(values)
    for panel in panels():
        assert panel["datasource"]["uid"] == "${datasource}"


def test_promtool_reads_the_rules_and_queries(tool: Callable[[str], str], tmp_path: Path) -> None:
    """As alerts and, the dashboard's, as rules that record."""
    queries = [
        {"record": f"query:{number}", "expr": target["expr"]}
        for number, target in enumerate(target for panel in panels() for target in panel["targets"])
    ]
    recorded = tmp_path / "queries.yml"
    recorded.write_text(yaml.safe_dump({"groups": [{"name": "queries", "rules": queries}]}))
    done = subprocess.run(
        [tool("promtool"), "check", "rules", str(RULES), str(recorded)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(queries)} rules found" in done.stdout


@pytest.mark.slow
def test_alerts_fire_when_they_should_and_only_then(
    tool: Callable[[str], str], tmp_path: Path
) -> None:
    """A server without cycles, a standby, a camera with a fault, and all well before."""
    cycles = 'slipstream_dispatcher_cycles_total{status="ok",instance="%s"}'
    standby = 'slipstream_dispatcher_standby{instance="%s"}'
    fault = 'slipstream_edge_camera_fault{instance="e",reason="dark"}'
    series = {
        cycles % "a": "0+1x30 30x60",
        standby % "a": "0x90",
        cycles % "b": "0x90",
        standby % "b": "1x90",
        fault: "0x40 1x10 0x40",
    }

    def firing(alert: str, at: str, **labels: str) -> dict[str, Any]:
        rule = next(rule for rule in rules() if rule["alert"] == alert)
        texts = {name: text.strip() for name, text in rule["annotations"].items()}
        for name, value in labels.items():
            texts["summary"] = texts["summary"].replace(f"{{{{ $labels.{name} }}}}", value)
        expected = {"exp_labels": {**rule["labels"], **labels}, "exp_annotations": texts}
        return {"eval_time": at, "alertname": alert, "exp_alerts": [expected] if labels else []}

    test = {
        "rule_files": [str(RULES)],
        "evaluation_interval": "1m",
        "tests": [
            {
                "interval": "1m",
                "input_series": [{"series": k, "values": v} for k, v in series.items()],
                "alert_rule_test": [
                    firing("SlipstreamNoCycle", "29m"),
                    firing("SlipstreamNoCycle", "60m", instance="a"),
                    firing("SlipstreamCameraFault", "39m"),
                    firing("SlipstreamCameraFault", "45m", instance="e", reason="dark"),
                    firing("SlipstreamCameraFault", "60m"),
                ],
            }
        ],
    }
    path = tmp_path / "test.yml"
    path.write_text(yaml.safe_dump(test))
    done = subprocess.run(
        [tool("promtool"), "test", "rules", str(path)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
