"""The report of a soak: Markdown for people, JSON and CSV for programs, a plot of the memory."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from slipstream_lab.benchmarks.aims import write_report
from slipstream_lab.benchmarks.soak.processes import ProcessSample
from slipstream_lab.benchmarks.soak.trend import LIMIT_MB_PER_H, Trend
from slipstream_lab.benchmarks.soak.verdict import SoakVerdict


def write(
    folder: Path,
    verdict: SoakVerdict,
    samples: Sequence[ProcessSample],
    about: Mapping[str, object],
) -> None:
    """Write report.md, report.json, processes.csv. `folder`: an existing folder; files of an
    earlier soak are replaced.
    """
    content = {"colour": verdict.colour, **asdict(verdict)}
    write_report(folder, markdown(verdict, about), about, content)
    with (folder / "processes.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(
            ("at_s", "name", "pid", "rss_mb", "memory_mb", "descriptors", "threads", "cpu_share")
        )
        for s in samples:
            rows.writerow(
                (
                    *(f"{s.at_s:.2f}", s.name, s.pid, f"{s.rss_mb:.3f}", f"{s.memory_mb:.3f}"),
                    *(s.descriptors, s.threads, f"{s.cpu_share:.3f}"),
                )
            )


def markdown(verdict: SoakVerdict, about: Mapping[str, object]) -> str:
    """The report as people read it."""
    begin, end = verdict.window.begin_s, verdict.window.end_s
    lines = [f"# Soak: {verdict.colour}", ""]
    lines += [f"- **{fault}**" for fault in verdict.faults]
    lines += [f"- cannot tell: {doubt}" for doubt in verdict.doubts]
    if verdict.colour == "green":
        lines += [f"Nothing failed, and no process grows by {LIMIT_MB_PER_H:g} MB an hour or more."]
    lines += ["", f"Judged from {begin:.0f} s to {end:.0f} s; what came before was warm-up.", ""]
    lines += [f"- {name}: {value}" for name, value in about.items()]
    lines += [
        "",
        "## Processes",
        "",
        "| process | memory at begin | end | median | max, MB | slope, MB/h (95 %) | | RSS max "
        "| descriptors (max) | threads (max) | CPU, cores | restarts |",
        "|---|--:|--:|--:|--:|--:|---|--:|--:|--:|--:|--:|",
    ]
    for p in verdict.processes:
        m, d, t = p.memory_mb, p.descriptors, p.threads
        lines.append(
            f"| {p.name} | {m.start:.1f} | {m.end:.1f} | {m.median:.1f} | {m.largest:.1f} "
            f"| {_slope(m)} | {m.word} | {p.rss_mb:.0f} | {d.end:.0f} ({d.largest:.0f}) "
            f"| {t.end:.0f} ({t.largest:.0f}) | {p.cpu_share:.2f} | {p.restarts} |"
        )
    lines += [
        "",
        "## Roadside units",
        "",
        "| RSU | frames | fps | skipped | latency p50, ms | p95 | worst p95 | unreadable "
        "| reconnects |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    lines += [
        f"| {r.rsu} | {r.frames} | {r.fps:.1f} | {100 * r.skipped_share:.1f} % "
        f"| {_number(r.latency_ms_p50)} | {_number(r.latency_ms_p95)} "
        f"| {_number(r.latency_ms_p95_worst)} | {r.decode_errors} | {r.reconnects} |"
        for r in verdict.rsus
    ]
    lines += [
        "",
        "| segment | states | longest silence, s | age p50, s | p95 | worst |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    lines += [
        f"| {s.segment} | {s.states} | {s.longest_silence_s:.2f} | {_number(s.age_s_p50, 3)} "
        f"| {_number(s.age_s_p95, 3)} | {_number(s.age_s_worst, 3)} |"
        for s in verdict.segments
    ]
    lines += [
        "",
        f"Dispatcher: {verdict.cycles} cycles, {verdict.cycles_failed} failed; "
        f"{verdict.bad_messages} bad messages.",
        "",
        "Memory is anonymous memory; a leak of the upper end of an interval, or more, would have "
        "been seen. What counts as growth: lab/slipstream_lab/benchmarks/soak/trend.py.",
    ]
    return "\n".join(lines) + "\n"


def _slope(trend: Trend) -> str:
    found = trend.slope
    if found is None:
        return "–"
    return f"{found.per_h:+.2f} ({found.low_per_h:+.2f} to {found.high_per_h:+.2f})"


def _number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
