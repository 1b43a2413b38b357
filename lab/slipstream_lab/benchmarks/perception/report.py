"""The benchmark's report: what was measured beside what was aimed at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from slipstream_lab.benchmarks.aims import Check, at_least, at_most, report_head, write_report
from slipstream_lab.benchmarks.perception.daemons import DaemonRun
from slipstream_lab.benchmarks.perception.speed import Speed

ROAD, WHOLE, LIVE = "slipstream", "slipstream, whole picture", "slipstream, live"
TORCH, SAME_EXPORT = "Ultralytics, PyTorch", "Ultralytics, same export"
TORCH_ALL = "Ultralytics, PyTorch, told to use all cores"

MAX_MS: Final = 8.0
MAX_LATENCY_MS: Final = 21.9
MIN_OVER_TORCH: Final = 8.0
MIN_OVER_EXPORT: Final = 1.5
MAX_RSS_MB: Final = 450.0
MAX_OVERLOAD_MS: Final = 250.0


@dataclass(frozen=True)
class PerceptionResults:
    """All that was measured."""

    rounds: tuple[Mapping[str, Speed], ...]
    cameras: tuple[DaemonRun, ...] = ()
    overload: tuple[DaemonRun, ...] = ()
    fast: DaemonRun | None = None
    missing: tuple[str, ...] = ()

    def of(self, name: str) -> list[Speed]:
        """A runner's figures over the rounds."""
        return [speeds[name] for speeds in self.rounds if name in speeds]


def checks(results: PerceptionResults) -> list[Check]:
    """Each aim with what was measured."""
    ours = results.of(ROAD)
    found = []
    if ours:
        ms = _median([s.ms_per_frame for s in ours])
        found.append(at_most("whole pipeline, ms a frame", f"{ms:.2f}", ms, MAX_MS))
    latencies = [s.latency_ms_p95 for s in results.of(LIVE) if s.latency_ms_p95 is not None]
    if latencies:
        p95 = _median(latencies)
        found.append(at_most("latency p95 of a live camera, ms", f"{p95:.1f}", p95, MAX_LATENCY_MS))
    for name, least in ((TORCH, MIN_OVER_TORCH), (SAME_EXPORT, MIN_OVER_EXPORT)):
        found.append(_times_faster(results, name, least))
    if results.cameras:
        skipped = sum(c.skipped for c in results.cameras)
        frames = sum(c.frames for c in results.cameras)
        seconds = min(c.seconds for c in results.cameras)
        rates = ", ".join(f"{c.fps:.1f}" for c in results.cameras)
        found.append(
            Check(
                f"{len(results.cameras)} cameras at {rates} frames/s, {seconds:.0f} s: skipped",
                f"{skipped} of {frames + skipped}",
                "0",
                skipped == 0,
            )
        )
    ages = [c.latency_ms_p95 for c in results.overload if c.latency_ms_p95 is not None]
    if ages:
        rates = ", ".join(f"{c.fps:.1f}" for c in results.overload)
        found.append(
            at_most(
                f"overloaded cameras at {rates} frames/s: age p95, ms, worst",
                f"{max(ages):.0f}",
                max(ages),
                MAX_OVERLOAD_MS,
            )
        )
    if results.fast is not None:
        memory = results.fast.memory
        found.append(
            at_most(
                "resident memory at full speed, MB",
                f"{memory.largest:.0f}",
                memory.largest,
                MAX_RSS_MB,
            )
        )
        if (slope := memory.slope) is not None:
            found.append(
                Check(
                    f"its slope over {results.fast.seconds / 60:.0f} min, MB/h (95 %)",
                    f"{slope.per_h:+.1f} ({slope.low_per_h:+.1f} to {slope.high_per_h:+.1f})",
                    "holds 0",
                    not slope.is_growth,
                )
            )
    return found


def _times_faster(results: PerceptionResults, name: str, least: float) -> Check:
    ratios = [
        speeds[name].ms_per_frame / speeds[ROAD].ms_per_frame
        for speeds in results.rounds
        if name in speeds and ROAD in speeds
    ]
    if not ratios:
        return Check(f"times faster than {name}", "not measured", f"≥ {least:g}", None)
    ratio = _median(ratios)
    spread = f"{ratio:.1f} ({min(ratios):.1f} to {max(ratios):.1f})"
    return at_least(f"times faster than {name}", spread, ratio, least)


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def markdown(results: PerceptionResults, about: Mapping[str, object]) -> str:
    """The report as people read it."""
    lines = report_head("Perception: how fast", about, checks(results), results.missing)
    lines += [
        "",
        "| runner (median of rounds) | ms a frame | p95 of blocks | latency p50 | p95 "
        "| processor ms a frame | boxes a frame | RSS, MB |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name in (ROAD, WHOLE, LIVE, TORCH, TORCH_ALL, SAME_EXPORT):
        speeds = results.of(name)
        if not speeds:
            continue
        p50 = [s.latency_ms_p50 for s in speeds if s.latency_ms_p50 is not None]
        p95 = [s.latency_ms_p95 for s in speeds if s.latency_ms_p95 is not None]
        lines.append(
            f"| {name} | {_median([s.ms_per_frame for s in speeds]):.2f} "
            f"| {_median([s.ms_per_frame_p95 for s in speeds]):.2f} "
            f"| {f'{_median(p50):.1f}' if p50 else '–'} | {f'{_median(p95):.1f}' if p95 else '–'} "
            f"| {_median([s.cpu_ms_per_frame for s in speeds]):.2f} "
            f"| {_median([s.vehicles_per_frame for s in speeds]):.1f} "
            f"| {max(s.rss_mb for s in speeds):.0f} |"
        )
    runs = [*results.cameras, *results.overload, *([results.fast] if results.fast else [])]
    if runs:
        lines += [
            "",
            "| daemon | s | frames/s | skipped | latency p95, ms | cores | RSS median, MB | max |",
            "|---|--:|--:|--:|--:|--:|--:|--:|",
        ]
        lines += [
            f"| {r.rsu} | {r.seconds:.0f} | {r.fps:.1f} | {r.skipped} "
            f"| {'–' if r.latency_ms_p95 is None else f'{r.latency_ms_p95:.1f}'} "
            f"| {r.cpu_cores:.2f} | {r.memory.median:.0f} | {r.memory.largest:.0f} |"
            for r in runs
        ]
    return "\n".join(lines) + "\n"


def write(folder: Path, results: PerceptionResults, about: Mapping[str, object]) -> None:
    """Write report.md and report.json into an existing folder."""
    content = {
        "checks": [asdict(check) for check in checks(results)],
        "rounds": [{name: asdict(s) for name, s in speeds.items()} for speeds in results.rounds],
        "cameras": [asdict(run) for run in results.cameras],
        "overload": [asdict(run) for run in results.overload],
        "fast": asdict(results.fast) if results.fast else None,
        "missing": list(results.missing),
    }
    write_report(folder, markdown(results, about), about, content)
