"""What is known of a recorded day, minute by minute: gates as RSUs report them, and the truth."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import replace
from itertools import groupby
from types import MappingProxyType

import numpy as np

from dispatcher_daemon.traffic import MIN_SPEED_MPS, TrafficSnapshot, take_snapshot
from slipstream.messages import SegmentState
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.closed_loop.dispatching import with_gates
from slipstream_lab.simulation.closed_loop.gates import is_turbulent, open_gates
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.exogenous.recorded import WINDOW_S, RecordedTraffic
from slipstream_lab.simulation.ground_truth import TrueWindow
from slipstream_lab.simulation.scenarios.demand import Array
from slipstream_lab.simulation.scenarios.perception import Reporter, measured_errors
from slipstream_lab.simulation.scenarios.record import Traffic


class RecordedRoadside:
    """Reports a recorded day's windows as time goes by, and remembers what they were."""

    def __init__(
        self,
        recorded: RecordedTraffic,
        network: RoadNetwork,
        policy: Policy,
        seed: int,
        keep_s: Mapping[str, float] | None = None,
    ) -> None:
        self._recorded = recorded
        self._network = network
        self._policy = policy
        self._seed = seed
        self._reporter = Reporter(
            measured_errors(), seed, keep_s=keep_s, noise=policy.noise, window_s=WINDOW_S
        )
        self._windows = groupby(recorded.observations, key=lambda seen: seen.time_s)
        self._next = next(self._windows, None)
        self._speeds = _planning_speeds(recorded.traffic, network)
        self._column = {name: i for i, name in enumerate(recorded.traffic.segments)}
        self._states: tuple[SegmentState, ...] = ()
        self._times: list[float] = []
        self._open: list[frozenset[str]] = []
        self._truths: list[dict[str, TrueWindow]] = []
        self.watched = frozenset(seen.segment for seen in recorded.observations)
        self.opened: set[str] = set()

    def until(self, now_s: float) -> None:
        """Take in all windows that end by a time, which no later call may go back behind."""
        while self._next is not None and self._next[0] <= now_s:
            time_s, windows = self._next[0], tuple(self._next[1])
            self._states = tuple(self._reporter.report(window) for window in windows)
            self._times.append(time_s)
            self._open.append(self._gates(time_s))
            self.opened |= self._open[-1]
            self._truths.append({w.segment: w.truth for w in windows if w.truth is not None})
            self._next = next(self._windows, None)

    def snapshot(self, now_s: float) -> TrafficSnapshot:
        """What the dispatcher plans with: gates, and everywhere the speeds of the last interval."""
        self.until(now_s)
        base = with_gates(self._judged(now_s), self._open[-1] if self._open else frozenset())
        traffic = {
            name: replace(seen, speed_mps=self.speed_mps(name, now_s - 1.0))
            for name, seen in base.segments.items()
        }
        return replace(base, segments=MappingProxyType(traffic))

    def speed_mps(self, segment: str, time_s: float) -> float:
        """Mean speed of the background on a segment in the interval of a time, standing included;
        the limit where no vehicle was.
        """
        traffic = self._recorded.traffic
        row = int((time_s - traffic.begin_s) // traffic.interval_s)
        row = min(max(row, 0), len(self._speeds) - 1)
        return float(self._speeds[row, self._column[segment]])

    def is_open(self, segment: str, time_s: float) -> bool:
        """Whether the latest report before a time lets platoons drive on a segment."""
        row = bisect_right(self._times, time_s) - 1
        return row >= 0 and segment in self._open[row]

    def truth(self, segment: str, time_s: float) -> TrueWindow | None:
        """The window of a segment whose middle is nearest to a time; None: no vehicle was in it."""
        if not self._times:
            return None
        first, every_s = self._times[0] - WINDOW_S / 2, self._recorded.every_s
        row = min(max(round((time_s - first) / every_s), 0), len(self._times) - 1)
        return self._truths[row].get(segment)

    def counts(self) -> tuple[int, int, int, int]:
        """Segments of the last report: watched, judged, judged and open, open but turbulent in
        truth.
        """
        known = {state.segment for state in self._states if state.y_e is not None}
        opened = self._open[-1] if self._open else frozenset()
        truths = self._truths[-1] if self._truths else {}
        wrong = sum(is_turbulent(truths.get(name)) for name in opened)
        return len(self.watched), len(known), len(opened & known), wrong

    def _judged(self, now_s: float) -> TrafficSnapshot:
        now_ns = round(now_s * 1e9)
        stale_s = self._recorded.every_s
        return take_snapshot(self._network, self._states, now_ns, stale_after_s=stale_s)

    def _gates(self, time_s: float) -> frozenset[str]:
        policy = self._policy
        if "platoons" not in policy.levers:
            return frozenset()
        reported = {name for name, t in self._judged(time_s).segments.items() if t.open}
        return open_gates(policy.gating, self.watched, reported, self._seed)


def _planning_speeds(traffic: Traffic, network: RoadNetwork) -> Array:
    limits = np.array([network.segments[name].speed_limit_mps for name in traffic.segments])
    seen = traffic.speed_mps()
    return np.where(np.isnan(seen), limits, np.clip(seen, MIN_SPEED_MPS, limits))
