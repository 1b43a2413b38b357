"""Figures and faults from samples and messages; no I/O."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np

from slipstream_lab.benchmarks.observer import BusObserver, StateArrival
from slipstream_lab.benchmarks.perception.slope import MIN_VALUES
from slipstream_lab.benchmarks.soak.processes import ProcessSample
from slipstream_lab.benchmarks.soak.trend import (
    CANNOT_TELL,
    GROWS,
    Trend,
    count_trend,
    memory_trend,
)

MAX_SILENCE_S: Final = 5.0
MAX_SKIPPED_SHARE: Final = 0.1
"""Two cores skip no frame of two cameras (docs/results.md): above it the daemons were short of
processor time, and their figures are those of an overloaded machine. It allows stalls of 20 s in
the 200 s that five minutes judge."""


@dataclass(frozen=True)
class SoakWindow:
    """The evaluated period: from the end of the warm-up to just before the stop, s."""

    begin_s: float
    end_s: float

    @classmethod
    def of(cls, duration_s: float, warm_up_s: float | None = None) -> SoakWindow:
        """The first third is warm-up, at least a minute, but never more than half."""
        warm_up_s = max(60.0, duration_s / 3) if warm_up_s is None else warm_up_s
        return cls(min(warm_up_s, duration_s / 2), duration_s)

    def holds(self, at_s: float) -> bool:
        """True for moments inside."""
        return self.begin_s <= at_s <= self.end_s


@dataclass(frozen=True)
class ProcessFigures:
    """One process in the window; its restarts are counted from the start. `rss_mb`: largest."""

    name: str
    memory_mb: Trend
    rss_mb: float
    descriptors: Trend
    threads: Trend
    cpu_share: float
    restarts: int


@dataclass(frozen=True)
class RsuFigures:
    """One edge daemon in the window; latencies are those of its health messages, in ms."""

    rsu: str
    frames: int
    frames_skipped: int
    skipped_share: float
    fps: float
    decode_errors: int
    reconnects: int
    latency_ms_p50: float | None
    latency_ms_p95: float | None
    latency_ms_p95_worst: float | None


@dataclass(frozen=True)
class SegmentFigures:
    """One segment's states in the window; age is from the last frame to their arrival here."""

    segment: str
    states: int
    longest_silence_s: float
    age_s_p50: float | None
    age_s_p95: float | None
    age_s_worst: float | None


@dataclass(frozen=True)
class SoakVerdict:
    """Result of a soak. `doubts`: what can be told neither way."""

    window: SoakWindow
    processes: tuple[ProcessFigures, ...]
    rsus: tuple[RsuFigures, ...]
    segments: tuple[SegmentFigures, ...]
    cycles: int
    cycles_failed: int
    bad_messages: int
    faults: tuple[str, ...] = field(default=())
    doubts: tuple[str, ...] = field(default=())

    @property
    def colour(self) -> str:
        """RED with a fault, "cannot tell" with a doubt, else green."""
        return "RED" if self.faults else "cannot tell" if self.doubts else "green"


def judge(
    samples: Sequence[ProcessSample],
    observer: BusObserver,
    expected: Iterable[str],
    rsus: Iterable[str],
    window: SoakWindow,
    restarted: int,
) -> SoakVerdict:
    """Judge a soak."""
    faults: list[str] = []
    doubts: list[str] = []
    inside = [sample for sample in samples if window.holds(sample.at_s)]
    processes = _processes(samples, inside, faults, doubts)
    _missing(inside, {*expected, *(p.name for p in processes)}, window, faults)
    segments = tuple(
        _segment(name, arrivals, window) for name, arrivals in sorted(observer.states.items())
    )
    figures = tuple(_rsu(rsu, observer, window) for rsu in sorted(set(rsus)))
    faults += [
        f"{rsu.rsu}: no segment state was heard"
        for rsu in figures
        if not any(s.segment.startswith(f"{rsu.rsu}/") for s in segments)
    ]
    faults += [
        f"{s.segment}: no state for {s.longest_silence_s:.1f} s"
        for s in segments
        if s.longest_silence_s > MAX_SILENCE_S
    ]
    faults += [
        f"{rsu.rsu}: {rsu.skipped_share:.0%} of its frames were skipped"
        for rsu in figures
        if rsu.skipped_share > MAX_SKIPPED_SHARE
    ]
    health = observer.dispatcher[-1][1] if observer.dispatcher else None
    bad = observer.bad_messages + (health.bad_messages if health else 0)
    if health is None:
        faults.append("dispatcher: no health message was heard")
    elif health.cycles_failed:
        faults.append(f"dispatcher: {health.cycles_failed} cycles failed")
    if bad:
        faults.append(f"{bad} messages were not what their key promises")
    seen = sum(process.restarts for process in processes if "/" not in process.name)
    if restarted > seen:
        faults.append(f"the supervisor restarted {restarted} processes")
    return SoakVerdict(
        window=window,
        processes=processes,
        rsus=figures,
        segments=segments,
        cycles=health.cycles if health else 0,
        cycles_failed=health.cycles_failed if health else 0,
        bad_messages=bad,
        faults=tuple(faults),
        doubts=tuple(doubts),
    )


def _processes(
    samples: Sequence[ProcessSample],
    inside: Sequence[ProcessSample],
    faults: list[str],
    doubts: list[str],
) -> tuple[ProcessFigures, ...]:
    pids: dict[str, set[int]] = defaultdict(set)
    for sample in samples:
        pids[sample.name].add(sample.pid)
    series: dict[str, list[ProcessSample]] = defaultdict(list)
    for sample in inside:
        series[sample.name].append(sample)
    found = []
    for name, run in series.items():
        restarts = len(pids[name]) - 1
        if restarts:
            faults.append(f"{name}: restarted {restarts} times")
        # Memory starts again after a restart: only the last process is evaluated.
        last_run = [sample for sample in run if sample.pid == run[-1].pid]
        times = [sample.at_s for sample in last_run]
        figures = ProcessFigures(
            name=name,
            memory_mb=memory_trend(times, [s.memory_mb for s in last_run]),
            rss_mb=max(s.rss_mb for s in last_run),
            descriptors=count_trend([s.descriptors for s in last_run]),
            threads=count_trend([s.threads for s in last_run]),
            cpu_share=float(np.mean([s.cpu_share for s in last_run])),
            restarts=restarts,
        )
        found.append(figures)
        if len(last_run) < MIN_VALUES:
            faults.append(f"{name}: only {len(last_run)} samples, too few to judge")
        if (memory := figures.memory_mb.slope) is not None:
            interval = f"{memory.low_per_h:.1f} to {memory.high_per_h:.1f}"
            if figures.memory_mb.word == GROWS:
                faults.append(f"{name}: memory grows by {memory.per_h:.1f} MB an hour ({interval})")
            elif figures.memory_mb.word == CANNOT_TELL:
                doubts.append(f"{name}: memory changes by {interval} MB an hour: soak for longer")
        for what, trend in (("descriptors", figures.descriptors), ("threads", figures.threads)):
            if trend.word == GROWS:
                faults.append(f"{name}: {what} grow from {trend.start:.0f} to {trend.end:.0f}")
    return tuple(found)


def _missing(
    inside: Sequence[ProcessSample], expected: set[str], window: SoakWindow, faults: list[str]
) -> None:
    moments: dict[float, set[str]] = defaultdict(set)
    for sample in inside:
        moments[sample.at_s].add(sample.name)
    last_s = max(moments, default=0.0)
    if last_s < window.end_s - MAX_SILENCE_S:
        faults.append(f"the run ended after {last_s:.0f} s")
    for name in sorted(expected):
        absent = sum(name not in names for names in moments.values())
        if absent:
            faults.append(f"{name}: missing in {absent} of {len(moments)} samples")


def _rsu(rsu: str, observer: BusObserver, window: SoakWindow) -> RsuFigures:
    heard = [(at_s, h) for at_s, h in observer.rsus.get(rsu, []) if window.holds(at_s)]
    if not heard:
        return RsuFigures(rsu, 0, 0, 0.0, 0.0, 0, 0, None, None, None)
    frames = _counted([h.frames for _, h in heard])
    skipped = _counted([h.frames_skipped for _, h in heard])
    span_s = heard[-1][0] - heard[0][0]
    p50 = [h.latency_ms_p50 for _, h in heard if h.latency_ms_p50 is not None]
    p95 = [h.latency_ms_p95 for _, h in heard if h.latency_ms_p95 is not None]
    return RsuFigures(
        rsu=rsu,
        frames=frames,
        frames_skipped=skipped,
        skipped_share=skipped / max(1, frames + skipped),
        fps=frames / span_s if span_s > 0 else 0.0,
        decode_errors=_counted([h.decode_errors for _, h in heard]),
        reconnects=_counted([h.reconnects for _, h in heard]),
        latency_ms_p50=float(np.median(p50)) if p50 else None,
        latency_ms_p95=float(np.median(p95)) if p95 else None,
        latency_ms_p95_worst=float(np.max(p95)) if p95 else None,
    )


def _counted(values: Sequence[int]) -> int:
    """Increase of a counter, which restarts at 0 with its process."""
    return sum(b - a if b >= a else b for a, b in pairwise(values))


def _segment(name: str, arrivals: Sequence[StateArrival], window: SoakWindow) -> SegmentFigures:
    inside = [a for a in arrivals if window.holds(a.at_s)]
    moments = [window.begin_s, *(a.at_s for a in inside), window.end_s]
    ages = [a.age_s for a in inside]
    p50, p95 = np.percentile(ages, (50, 95)) if ages else (None, None)
    return SegmentFigures(
        segment=name,
        states=len(inside),
        longest_silence_s=float(np.diff(moments).max()),
        age_s_p50=None if p50 is None else float(p50),
        age_s_p95=None if p95 is None else float(p95),
        age_s_worst=max(ages) if ages else None,
    )
