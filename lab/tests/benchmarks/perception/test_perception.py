"""The perception benchmark: its report on made-up figures, and a short run of its parts."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from edge_daemon.settings import DetectorSettings
from slipstream_lab.benchmarks.perception import report
from slipstream_lab.benchmarks.perception.__main__ import main
from slipstream_lab.benchmarks.perception.daemons import DaemonRun
from slipstream_lab.benchmarks.perception.ours import measure
from slipstream_lab.benchmarks.perception.report import (
    LIVE,
    ROAD,
    SAME_EXPORT,
    TORCH,
    PerceptionResults,
    checks,
)
from slipstream_lab.benchmarks.perception.slope import MemoryUse, Slope
from slipstream_lab.benchmarks.perception.speed import Speed, measured, speed_of, written
from slipstream_lab.simulation.streetdrive import ClipSettings, render_clip


def speed(ms: float, latency_p95: float | None = None) -> Speed:
    """A run that took so long a frame."""
    return Speed(300, ms, 1.2 * ms, latency_p95, latency_p95, 2 * ms, 9.0, 250.0)


def memory(largest: float, slope: float, half_width: float) -> MemoryUse:
    """Memory with a slope and its interval."""
    return MemoryUse(300, largest, Slope(slope, slope - half_width, slope + half_width))


def daemon(
    skipped: int,
    largest: float = 300.0,
    slope: float = 0.5,
    width: float = 2.0,
    p95: float = 15.0,
) -> DaemonRun:
    """A daemon that ran for ten minutes."""
    return DaemonRun(
        "r", 600.0, 27_360 - skipped, skipped, 45.6, p95, 0.8, memory(largest, slope, width)
    )


def reached(results: PerceptionResults) -> dict[str, bool | None]:
    """What became of each aim, by the beginning of its name."""
    return {check.what.split(",")[0][:24]: check.reached for check in checks(results)}


GOOD = PerceptionResults(
    rounds=(
        {ROAD: speed(7.0), LIVE: speed(21.9, 15.0), TORCH: speed(70.0), SAME_EXPORT: speed(21.0)},
        {ROAD: speed(6.0), LIVE: speed(21.9, 16.0), TORCH: speed(66.0), SAME_EXPORT: speed(20.0)},
    ),
    cameras=(daemon(0), daemon(0)),
    overload=(daemon(9000, p95=180.0), daemon(9000, p95=249.0)),
    fast=daemon(0),
)


def test_aims_that_are_reached() -> None:
    """All of them, with medians of rounds and ratios within a round."""
    assert set(reached(GOOD).values()) == {True}
    found = {check.what: check.measured for check in checks(GOOD)}
    assert found["whole pipeline, ms a frame"] == "6.50"
    assert found["times faster than Ultralytics, PyTorch"] == "10.5 (10.0 to 11.0)"


@pytest.mark.parametrize(
    ("results", "missed"),
    [
        (PerceptionResults(({ROAD: speed(8.1)},)), "whole pipeline"),
        (PerceptionResults(({LIVE: speed(21.9, 22.0)},)), "latency p95 of a live ca"),
        (PerceptionResults(({ROAD: speed(5.0), TORCH: speed(39.9)},)), "times faster than Ultral"),
        (PerceptionResults((), cameras=(daemon(0), daemon(1))), "2 cameras at 45.6"),
        (
            PerceptionResults((), overload=(daemon(9, p95=180.0), daemon(9, p95=251.0))),
            "overloaded cameras at 45",
        ),
        (PerceptionResults((), fast=daemon(0, largest=451.0)), "resident memory at full "),
        (PerceptionResults((), fast=daemon(0, slope=3.0)), "its slope over 10 min"),
    ],
)
def test_aims_that_are_missed(results: PerceptionResults, missed: str) -> None:
    """Each is named for itself; what was not measured is neither reached nor missed."""
    names = [c.what for c in checks(results) if c.reached is False]
    assert len(names) == 1
    assert names[0].startswith(missed)
    assert "MISSED" in report.markdown(results, {})


def test_missing_peers_are_said(tmp_path: Path) -> None:
    """The report stands without them, and holds no number in their place."""
    results = PerceptionResults(({ROAD: speed(7.0)},), missing=("Ultralytics: not there",))
    report.write(tmp_path, results, {"machine": "made up"})
    text = (tmp_path / "report.md").read_text()
    assert "**not measured:** Ultralytics: not there" in text
    assert "| times faster than Ultralytics, PyTorch | not measured | ≥ 8 | – |" in text
    content = json.loads((tmp_path / "report.json").read_text())
    assert content["rounds"][0][ROAD]["ms_per_frame"] == 7.0
    assert [c["reached"] for c in content["checks"]] == [True, None, None]


def test_bursts_do_not_count_as_speed() -> None:
    """Results that come two at a time take what they take on average; a stall is in the tail."""
    done = np.repeat(np.arange(0.0, 6.1, 0.02), 2)[1:602]
    done[-30:] += 0.3
    got = speed_of(done, [0.01] * 600, 6.0, 1800, 200.0)
    assert got.frames == 600
    assert got.ms_per_frame == pytest.approx(10.0, rel=0.04)
    assert got.ms_per_frame_p95 > 10.0
    assert got.cpu_ms_per_frame == pytest.approx(10.0)
    assert got.vehicles_per_frame == 3.0
    assert got.latency_ms_p95 == pytest.approx(10.0)


def test_a_measuring_process_tells_or_fails(tmp_path: Path) -> None:
    """The last line is the answer; a failure names the log."""
    log = tmp_path / "log"
    command = [sys.executable, "-c", f"print('chatter'); print({written(speed(7.0))!r})"]
    assert measured(command, log, 30) == speed(7.0)
    with pytest.raises(RuntimeError, match="status 3"):
        measured([sys.executable, "-c", "raise SystemExit(3)"], log, 30)


@pytest.mark.long
def test_our_pipeline_goes_through_every_frame(tmp_path: Path) -> None:
    """A smoke run on a short loop; nothing about how long it takes."""
    clip = tmp_path / "clip"
    render_clip(ClipSettings(seconds=0.5, fps=10, scenario="stable", seed=77), clip)
    got = measure(clip, DetectorSettings(), frames=10, warm_up=3, live=False)
    assert got.frames == 10
    assert got.vehicles_per_frame > 1
    assert got.latency_ms_p50 is not None
    assert got.cpu_ms_per_frame > 0


def test_bad_options_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit status 2."""
    assert main(["--rounds", "0"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
