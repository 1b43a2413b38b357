"""The report of a soak: Markdown for people, JSON and CSV for programs, a plot of the memory."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final
from xml.sax.saxutils import escape

from slipstream_lab.benchmarks.aims import write_report
from slipstream_lab.benchmarks.soak.observer import Observer
from slipstream_lab.benchmarks.soak.processes import Sample
from slipstream_lab.benchmarks.soak.trend import Trend
from slipstream_lab.benchmarks.soak.verdict import Verdict

_COLOURS: Final = ("#1b6ca8", "#c2452d", "#2f8f4e", "#8a5fb0", "#b8860b", "#4a4a4a", "#d1679a")


def write(
    folder: Path,
    verdict: Verdict,
    samples: Sequence[Sample],
    observer: Observer,
    about: Mapping[str, object],
) -> None:
    """Write report.md, report.json, processes.csv, rsus.csv and memory.svg.

    Args:
        folder: an existing folder; files of an earlier soak are replaced.
    """
    content = {"green": verdict.green, **asdict(verdict)}
    write_report(folder, markdown(verdict, about), about, content)
    (folder / "memory.svg").write_text(memory_svg(samples, verdict))
    with (folder / "processes.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("at_s", "name", "pid", "rss_mb", "descriptors", "threads", "cpu_share"))
        for s in samples:
            rows.writerow(
                (
                    *(f"{s.at_s:.2f}", s.name, s.pid, f"{s.rss_mb:.3f}"),
                    *(s.descriptors, s.threads, f"{s.cpu_share:.3f}"),
                )
            )
    with (folder / "rsus.csv").open("w", newline="") as file:
        fields = ("frames", "frames_skipped", "states", "fps", "latency_ms_p50", "latency_ms_p95")
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("at_s", "rsu", *fields))
        for rsu, heard in sorted(observer.rsus.items()):
            for at_s, health in heard:
                rows.writerow((f"{at_s:.2f}", rsu, *(getattr(health, field) for field in fields)))


def markdown(verdict: Verdict, about: Mapping[str, object]) -> str:
    """The report as people read it."""
    begin, end = verdict.window.begin_s, verdict.window.end_s
    lines = [f"# Soak: {'green' if verdict.green else 'RED'}", ""]
    lines += [f"- **{fault}**" for fault in verdict.faults] or ["Nothing grew, nothing failed."]
    lines += ["", f"Judged from {begin:.0f} s to {end:.0f} s; what came before was warm-up.", ""]
    lines += [f"- {name}: {value}" for name, value in about.items()]
    lines += [
        "",
        "## Processes",
        "",
        "| process | RSS start | end | median | max, MB | slope, MB/h (95 %) | descriptors "
        "(max, per h) | threads (max) | CPU, cores | restarts |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for p in verdict.processes:
        m, d, t = p.memory_mb, p.descriptors, p.threads
        lines.append(
            f"| {p.name} | {m.start:.1f} | {m.end:.1f} | {m.median:.1f} | {m.largest:.1f} "
            f"| {_slope(m)} | {d.end:.0f} ({d.largest:.0f}, {d.slope_per_h:+.1f}) "
            f"| {t.end:.0f} ({t.largest:.0f}) | {p.cpu_share:.2f} | {p.restarts} |"
        )
    lines += [
        "",
        "![memory](memory.svg)",
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
        "What counts as growth: lab/slipstream_lab/benchmarks/soak/trend.py.",
    ]
    return "\n".join(lines) + "\n"


def _slope(trend: Trend) -> str:
    return f"{trend.slope_per_h:+.1f} ({trend.low_per_h:+.1f} to {trend.high_per_h:+.1f})"


def _number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def memory_svg(samples: Sequence[Sample], verdict: Verdict) -> str:
    """Resident memory over time, a line a process; the warm-up is shaded."""
    width, height, left, top, right, bottom = 900, 420, 60, 20, 190, 40
    series: dict[str, list[Sample]] = defaultdict(list)
    for sample in samples:
        series[sample.name].append(sample)
    last_s = max((s.at_s for s in samples), default=1.0) or 1.0
    top_mb = 1.05 * max((s.rss_mb for s in samples), default=1.0)

    def x(at_s: float) -> float:
        return left + at_s / last_s * (width - left - right)

    def y(mb: float) -> float:
        return height - bottom - mb / top_mb * (height - top - bottom)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<rect x="{left}" y="{top}" width="{x(verdict.window.begin_s) - left:.1f}" '
        f'height="{height - top - bottom}" fill="#f0f0f0"/>',
        f'<text x="{left + 4}" y="{top + 14}" fill="#777">warm-up</text>',
    ]
    for step in range(6):
        mb, at_s = top_mb * step / 5, last_s * step / 5
        parts.append(
            f'<line x1="{left}" x2="{width - right}" y1="{y(mb):.1f}" y2="{y(mb):.1f}" '
            'stroke="#ddd"/>'
            f'<text x="{left - 6}" y="{y(mb) + 4:.1f}" text-anchor="end">{mb:.0f}</text>'
            f'<text x="{x(at_s):.1f}" y="{height - 20}" text-anchor="middle">{at_s:.0f}</text>'
        )
    parts.append(f'<text x="{left}" y="12">resident memory, MB, over time, s</text>')
    label_y = top + 10.0
    for number, (name, run) in enumerate(sorted(series.items(), key=lambda i: -i[1][-1].rss_mb)):
        colour = _COLOURS[number % len(_COLOURS)]
        every = max(1, len(run) // 800)
        points = " ".join(f"{x(s.at_s):.1f},{y(s.rss_mb):.1f}" for s in run[::every])
        label_y = max(label_y + 14, y(run[-1].rss_mb) + 4)
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>'
            f'<text x="{width - right + 8}" y="{label_y:.1f}" fill="{colour}">'
            f"{escape(name)} {run[-1].rss_mb:.0f}</text>"
        )
    return "\n".join([*parts, "</svg>"]) + "\n"
