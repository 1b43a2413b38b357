"""The soak: its criterion on series whose truth is known, and its eyes on real processes."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slipstream.bus import Bus
from slipstream.messages import (
    DISPATCHER_HEALTH_KEY,
    DispatcherHealth,
    RsuHealth,
    SegmentState,
    rsu_health_key,
    state_key,
)
from slipstream_lab.benchmarks.observer import BusObserver, StateArrival
from slipstream_lab.benchmarks.soak import report
from slipstream_lab.benchmarks.soak.__main__ import main
from slipstream_lab.benchmarks.soak.processes import ProcessSample, ProcessTree
from slipstream_lab.benchmarks.soak.soak import SoakSettings, run_soak
from slipstream_lab.benchmarks.soak.trend import count_trend, memory_trend
from slipstream_lab.benchmarks.soak.verdict import SoakVerdict, SoakWindow, judge
from slipstream_lab.commands.live.demo import make_clips

# What a soak of an hour judges, a sample a second, and one of five minutes.
HOUR = np.arange(1200.0, 3600.0)
SHORT = np.arange(100.0, 300.0)
SEEDS = range(20)


def noise(seed: int, times: np.ndarray, size_mb: float = 0.1, memory: float = 0.95) -> np.ndarray:
    """Noise as memory has it: each second is much like the one before (AR(1))."""
    rng = np.random.default_rng(seed)
    shocks = rng.normal(0.0, size_mb * np.sqrt(1 - memory**2), len(times))
    values = np.empty(len(times))
    level = rng.normal(0.0, size_mb)
    for i, shock in enumerate(shocks):
        level = memory * level + shock
        values[i] = level
    return values


def words(times: np.ndarray, mb_per_h: float, size_mb: float = 0.1) -> list[str]:
    """What is said of noisy series that leak so much."""
    leak = mb_per_h / 3600 * (times - times[0])
    return [memory_trend(times, 120.0 + noise(s, times, size_mb) + leak).word for s in SEEDS]


def test_a_flat_series_is_steady() -> None:
    """Exactly constant memory has slope 0 and an interval of no width."""
    trend = memory_trend(SHORT, np.full(len(SHORT), 120.0))
    assert trend.slope is not None
    assert (trend.slope.low_per_h, trend.slope.high_per_h) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert trend.word == "steady"


def test_an_hour_finds_five_megabytes_an_hour_and_tells_what_is_steady() -> None:
    """Each time, amid the noise of a daemon; noise alone is steady each time."""
    assert words(HOUR, 5.0) == ["grows"] * len(SEEDS)
    assert words(HOUR, 0.0) == ["steady"] * len(SEEDS)


def test_minutes_cannot_tell_a_small_leak_and_do_not_call_it_steady() -> None:
    """Five minutes find a large leak, and leave a small one open."""
    assert words(SHORT, 60.0) == ["grows"] * len(SEEDS)
    assert words(SHORT, 5.0).count("steady") <= 1
    told = words(SHORT, 0.0, 0.5)
    assert told.count("cannot tell") >= 17
    assert told.count("grows") <= 1
    assert memory_trend(SHORT[:19], np.full(19, 120.0)).word == "cannot tell"


@pytest.mark.parametrize("shape", ["teeth", "peaks", "a step"])
def test_what_only_moves_does_not_grow(shape: str) -> None:
    """Teeth of the cycle, rare high peaks, and 20 MB once, wherever, never count as growth."""
    for seed in SEEDS:
        mb = 250.0 + noise(seed, HOUR)
        chance = np.random.default_rng(seed)
        if shape == "teeth":
            mb += 4.0 * (HOUR % 30) / 30
        elif shape == "peaks":
            mb[chance.integers(0, len(mb), 10)] += 60.0
        else:
            mb += 20.0 * (np.quantile(HOUR, chance.uniform(0.05, 0.95)) <= HOUR)
        assert memory_trend(HOUR, mb).word != "grows", (shape, seed)


@pytest.mark.parametrize("kind", ["toothed", "by the cycle"])
def test_a_leak_under_teeth_or_by_gulps_is_found(kind: str) -> None:
    """5 MB an hour under the teeth of cycles, or a gulp with each of them."""
    rate = 5.0 / 3600
    for seed in SEEDS:
        leak = rate * (HOUR - HOUR[0])
        if kind == "by the cycle":
            leak = rate * 30 * np.floor((HOUR - HOUR[0]) / 30)
        mb = 120.0 + noise(seed, HOUR) + leak + (2.0 * (HOUR % 30) / 30 if kind == "toothed" else 0)
        trend = memory_trend(HOUR, mb)
        assert trend.word == "grows", (kind, seed)
        assert trend.slope is not None
        assert trend.slope.per_h == pytest.approx(5.0, rel=0.35)


def test_descriptors_are_judged_by_their_floor() -> None:
    """Peaks and one step are green, a floor that rises from third to third is red."""
    rng = np.random.default_rng(1)
    peaks = 30 + 20 * (rng.random(len(SHORT)) < 0.3)
    assert count_trend(peaks).word == "steady"
    assert count_trend(30 + 8 * (SHORT > 210)).word == "steady"
    assert count_trend(peaks + np.floor((SHORT - 100) / 30)).word == "grows"
    assert count_trend([30]).word == "steady"


def test_the_warm_up_is_a_third_or_a_minute_and_never_more_than_half() -> None:
    """For an hour, for two minutes, and for half a minute."""
    assert SoakWindow.of(3600.0).begin_s == 1200.0
    assert SoakWindow.of(150.0).begin_s == 60.0
    assert SoakWindow.of(30.0).begin_s == 15.0
    assert SoakWindow.of(300.0, warm_up_s=10.0).begin_s == 10.0


def rsu_health(frames: int, skipped: int) -> RsuHealth:
    """A health message."""
    return RsuHealth(
        rsu="r",
        time_ns=1,
        started_ns=1,
        source="clip",
        segments=("a",),
        status="ok",
        frames=frames,
        frames_skipped=skipped,
        decode_errors=0,
        reconnects=0,
        states=1,
        fps=30.0,
        latency_ms_p50=10.0,
        latency_ms_p95=20.0,
        vehicles_in_view=0,
        rss_mb=100.0,
    )


def dispatcher_health(bad: int = 0, failed: int = 0) -> DispatcherHealth:
    """A health message."""
    return DispatcherHealth(
        time_ns=1,
        started_ns=1,
        cycles=4,
        cycles_failed=failed,
        states_received=10,
        bad_messages=bad,
        next_cycle_ns=None,
        rss_mb=100.0,
    )


class Soak:
    """A soak without a fault, to be spoilt."""

    def __init__(self) -> None:
        self.samples = [
            ProcessSample(t, name, pid, 150.0, 100.0, 20, 9, 0.1)
            for t in np.arange(0.0, 120.0)
            for pid, name in ((1, "supervisor"), (2, "r"), (3, "dispatcher"))
        ]
        self.observer = BusObserver(clock=lambda: 0.0)
        self.observer.states["r/a"] = [StateArrival(t, 0.1) for t in np.arange(0.5, 120.0)]
        self.observer.rsus["r"] = [
            (t, rsu_health(int(20 * t), int(t))) for t in np.arange(0.0, 120.0)
        ]
        self.observer.dispatcher = [(60.0, dispatcher_health())]
        self.restarted = 0

    def faults(self) -> tuple[str, ...]:
        """What is found."""
        return self.verdict().faults

    def verdict(self) -> SoakVerdict:
        """All that is told."""
        expected = ("supervisor", "r", "dispatcher")
        window = SoakWindow.of(119.0)
        return judge(self.samples, self.observer, expected, ["r"], window, self.restarted)


def test_a_sound_soak_is_green_and_its_figures_are_right() -> None:
    """No fault; frames, drops and ages are those of the window."""
    soak = Soak()
    assert soak.faults() == ()
    assert soak.verdict().colour == "green"
    verdict = judge(soak.samples, soak.observer, (), ["r"], SoakWindow(60.0, 119.0), 0)
    (rsu,) = verdict.rsus
    assert (rsu.frames, rsu.frames_skipped) == (20 * 59, 59)
    assert rsu.skipped_share == pytest.approx(1 / 21)
    assert rsu.fps == pytest.approx(20.0)
    assert (rsu.latency_ms_p50, rsu.latency_ms_p95) == (10.0, 20.0)
    (segment,) = verdict.segments
    assert segment.longest_silence_s == pytest.approx(1.0)
    assert segment.age_s_p95 == pytest.approx(0.1)
    assert {p.name: p.cpu_share for p in verdict.processes} == pytest.approx(
        {"supervisor": 0.1, "r": 0.1, "dispatcher": 0.1}
    )


def test_each_fault_is_named() -> None:
    """Growth, restarts, absence, silence, skipped frames, bad messages, failed cycles, an end."""
    soak = Soak()
    soak.samples = [
        replace(s, memory_mb=s.memory_mb + 0.1 * s.at_s) if s.name == "r" else s
        for s in soak.samples
    ]
    assert soak.faults() == ("r: memory grows by 360.0 MB an hour (360.0 to 360.0)",)

    soak = Soak()
    soak.samples = [replace(s, threads=9 + int(s.at_s / 10)) for s in soak.samples]
    assert len(soak.faults()) == 3
    assert all("threads grow" in fault for fault in soak.faults())

    soak = Soak()
    soak.samples = [
        replace(s, pid=99) if s.name == "dispatcher" and s.at_s > 90 else s for s in soak.samples
    ]
    assert soak.faults() == ("dispatcher: restarted 1 times",)

    soak = Soak()
    soak.samples = [s for s in soak.samples if s.name != "r" or not 70 <= s.at_s < 73]
    assert soak.faults() == ("r: missing in 3 of 60 samples",)

    soak = Soak()
    soak.samples = [s for s in soak.samples if s.at_s < 80]
    assert soak.faults() == ("the run ended after 79 s",)

    soak = Soak()
    soak.observer.states["r/a"] = [s for s in soak.observer.states["r/a"] if s.at_s < 112]
    assert soak.faults() == ("r/a: no state for 7.5 s",)
    soak.observer.states = {}
    assert soak.faults() == ("r: no segment state was heard",)

    soak = Soak()
    soak.observer.rsus["r"] = [(t, rsu_health(47 * t, 53 * t)) for t in range(120)]
    assert soak.faults() == ("r: 53% of its frames were skipped",)

    soak = Soak()
    soak.observer.dispatcher = [(60.0, dispatcher_health(bad=2, failed=1))]
    assert soak.faults() == (
        "dispatcher: 1 cycles failed",
        "2 messages were not what their key promises",
    )

    soak = Soak()
    soak.restarted = 1
    assert soak.faults() == ("the supervisor restarted 1 processes",)


def test_what_cannot_be_told_is_not_green() -> None:
    """A process whose memory moves too much for the time is named as a doubt."""
    soak = Soak()
    moves = np.random.default_rng(1).normal(0.0, 5.0, len(soak.samples))
    soak.samples = [
        replace(s, memory_mb=s.memory_mb + move) if s.name == "r" else s
        for s, move in zip(soak.samples, moves, strict=True)
    ]
    verdict = soak.verdict()
    assert (verdict.faults, verdict.colour) == ((), "cannot tell")
    (doubt,) = verdict.doubts
    assert doubt.startswith("r: memory changes by -")


def test_the_report_tells_all(tmp_path: Path) -> None:
    """Markdown, JSON and CSV name each process; a fault makes it red."""
    soak = Soak()
    verdict = judge(soak.samples, soak.observer, ("gone",), ["r"], SoakWindow(60.0, 119.0), 0)
    report.write(tmp_path, verdict, soak.samples, {"machine": "two cores"})
    text = (tmp_path / "report.md").read_text()
    assert text.startswith("# Soak: RED\n\n- **gone: missing in 60 of 60 samples**")
    assert "| dispatcher | 100.0 | 100.0 |" in text
    content = json.loads((tmp_path / "report.json").read_text())
    assert content["colour"] == "RED"
    assert content["about"] == {"machine": "two cores"}
    assert {p["name"] for p in content["processes"]} == {"supervisor", "r", "dispatcher"}
    assert len((tmp_path / "processes.csv").read_text().splitlines()) == 1 + 3 * 120


@pytest.mark.slow
def test_the_observer_hears_the_daemons(bus: Bus) -> None:
    """States with their age, health of both kinds, and a count of what is neither."""
    observer = BusObserver(clock=lambda: 7.0)
    observer.listen(bus)
    state = SegmentState(
        rsu="r",
        segment="a",
        sequence=1,
        time_ns=time.time_ns() - 2 * 10**9,
        window_s=10.0,
        features=None,
        y_e=None,
        reason="no_frames",
        vehicles=0,
        frames=0,
        coverage=0.0,
    )
    publishers = []
    for key, message in (
        (state_key("r", "a"), state),
        (rsu_health_key("r"), rsu_health(1, 0)),
        (DISPATCHER_HEALTH_KEY, dispatcher_health()),
        (state_key("r", "b"), b"nonsense"),
    ):
        publisher = bus.publisher(key)
        publishers.append(publisher)
        publisher.put(message)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (
        observer.states and observer.rsus and observer.dispatcher and observer.bad_messages
    ):
        time.sleep(0.02)
    assert observer.bad_messages == 1
    assert observer.dispatcher[0][0] == 7.0
    assert list(observer.rsus) == ["r"]
    ((name, (arrival,)),) = observer.states.items()
    assert name == "r/a"
    assert 2.0 <= arrival.age_s < 12.0


_LEAKING = """
import os, time
kept, opened = [], []
print("up", flush=True)
while True:
    kept.append(b"x" * 1_000_000)
    opened.append(open(os.devnull))
    time.sleep(0.02)
"""

_PARENT = """
import subprocess, sys, time
options = ["--config", "x.toml", "--rsu", "leaky"]
child = subprocess.Popen([sys.executable, "-c", sys.argv[1], *options])
time.sleep(60)
"""


@pytest.mark.long
@pytest.mark.process
def test_a_real_leak_in_a_real_child_is_seen() -> None:
    """Memory and descriptors of a child process grow, the parent's do not."""
    parent = subprocess.Popen([sys.executable, "-c", _PARENT, _LEAKING], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    try:
        assert parent.stdout.readline() == b"up\n"
        tree, began, samples = ProcessTree(parent.pid), time.monotonic(), []
        while (at_s := time.monotonic() - began) < 4.0:
            samples += tree.sample(at_s)
            time.sleep(0.05)
        for process in tree.sample(at_s):
            if process.name == "leaky":
                subprocess.run(["kill", str(process.pid)], check=True)
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()
    assert {s.name for s in samples} == {"supervisor", "leaky"}
    grown = {}
    for name in ("supervisor", "leaky"):
        run = [s for s in samples if s.name == name and s.at_s > 1.0]
        times = [s.at_s for s in run]
        grown[name] = (
            memory_trend(times, [s.memory_mb for s in run]).word,
            count_trend([s.descriptors for s in run]).word,
        )
    assert grown["leaky"] == ("grows", "grows")
    assert grown["supervisor"][0] != "grows"
    assert grown["supervisor"][1] == "steady"


@pytest.mark.process
def test_workers_of_a_fork_server_have_the_name_of_its_parent() -> None:
    """They have its command line."""
    parent = (
        "import multiprocessing, os, time\n"
        "context = multiprocessing.get_context('forkserver')\n"
        "context.set_forkserver_preload([])\n"
        "for _ in range(2): context.Process(target=time.sleep, args=(60,), daemon=True).start()\n"
        "print('ready', flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == b"ready\n"
            tree, until_s = ProcessTree(process.pid), time.monotonic() + 60
            names: set[str] = set()
            while len(names) < 5 and time.monotonic() < until_s:
                names = {sample.name for sample in tree.sample(0.0)}
                time.sleep(0.05)
        finally:
            process.kill()
    assert names == {
        "supervisor",
        *("supervisor/tracker-1", "supervisor/forkserver-1"),
        *("supervisor/worker-1", "supervisor/worker-2"),
    }


@pytest.mark.process
def test_a_successor_inherits_the_name() -> None:
    """Numbered processes keep their names; one that replaces another takes its place."""
    spawn = "from multiprocessing import spawn_main; import time; time.sleep(60)"
    workers = []
    parent = (
        "import subprocess, sys\n"
        "for line in sys.stdin:\n"
        f"    p = subprocess.Popen([sys.executable, '-c', {spawn!r} + '#' * 0])\n"
        "    print(p.pid, flush=True)\n"
    ).replace("from multiprocessing import spawn_main; ", "spawn_main = 0; ")
    process = subprocess.Popen(
        [sys.executable, "-c", parent], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None

    def another() -> int:
        print("go", file=process.stdin, flush=True)
        workers.append(int(process.stdout.readline()))
        time.sleep(0.2)
        return workers[-1]

    try:
        tree = ProcessTree(process.pid)
        first, second = another(), another()
        names = {s.pid: s.name for s in tree.sample(0.0)}
        assert names[first] == "supervisor/worker-1"
        assert names[second] == "supervisor/worker-2"
        subprocess.run(["kill", "-9", str(first)], check=True)
        time.sleep(0.2)
        tree.sample(1.0)
        third = another()
        names = {s.pid: s.name for s in tree.sample(2.0)}
        assert names[second] == "supervisor/worker-2"
        assert names[third] == "supervisor/worker-1"
    finally:
        for pid in workers:
            subprocess.run(["kill", "-9", str(pid)], check=False, capture_output=True)
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()


def test_too_short_a_soak_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    """One line and status 2."""
    assert main(["--minutes", "0"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.long
@pytest.mark.process
@pytest.mark.timeout(900)
def test_a_leak_that_is_planted_in_a_daemon_is_found_in_a_short_soak(
    tmp_path: Path, made_once: Callable[..., Path]
) -> None:
    """The whole demo for a minute: the page's daemon leaks, and is the one that is named."""
    clips = made_once("demo", lambda folder: make_clips(folder, threading.Event()))
    settings = SoakSettings(seconds=75.0, out=tmp_path, clips=clips, planted_mb_per_h=3600.0)
    verdict = run_soak(settings)
    (dashboard,) = (p for p in verdict.processes if p.name == "dashboard")
    assert dashboard.memory_mb.word == "grows", verdict.faults
    assert any(fault.startswith("dashboard: memory grows") for fault in verdict.faults)
    assert verdict.colour == "RED"
