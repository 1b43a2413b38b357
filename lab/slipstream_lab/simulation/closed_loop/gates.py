"""RSU reports in a running simulation, and the platooning gates that follow."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from edge_daemon.settings import StabilitySettings
from slipstream.messages import SegmentState
from slipstream_lab.simulation.closed_loop.policy import Gating
from slipstream_lab.simulation.ground_truth import TrueWindow
from slipstream_lab.simulation.rsus import Rsu
from slipstream_lab.simulation.scenarios.perception import (
    Observation,
    Observer,
    Reporter,
    measured_errors,
)

WINDOW_S: Final = 60.0
"""Longer than the paper's 10 s, in which fewer than three vehicles pass during most of the day."""

_SAMPLE_EVERY_S: Final = 1.0
_STREAM: Final = 3000
_MIN_VEHICLES: Final = StabilitySettings().min_vehicles


class SimulatedRoadside:
    """RSUs of a running simulation: windows, reports with errors, gates. `noise`: the paper's, on
    the features.
    """

    def __init__(self, rsus: Sequence[Rsu], seed: int, noise: float, gating: Gating) -> None:
        rule = StabilitySettings().bare()
        self._observer = Observer(rsus, _SAMPLE_EVERY_S, rule, WINDOW_S)
        keep_s = {rsu.id: rsu.keep_s for rsu in rsus}
        self._reporter = Reporter(
            measured_errors(), seed, keep_s=keep_s, noise=noise, window_s=WINDOW_S
        )
        self._seed, self._gating = seed, gating
        self._looked = 0
        self.watched = tuple(sorted({s.segment for rsu in rsus for s in rsu.watch}))
        self.states: tuple[SegmentState, ...] = ()
        self.opened: set[str] = set()
        self._open: frozenset[str] = frozenset()
        self._turbulent: frozenset[str] = frozenset()

    def is_open(self, segment: str) -> bool:
        """Whether close gaps are allowed there, as of the last window."""
        return segment in self._open

    def is_turbulent(self, segment: str) -> bool:
        """Whether the true traffic on it was turbulent in the last window."""
        return segment in self._turbulent

    @property
    def open(self) -> frozenset[str]:
        """Watched segments whose gate is open."""
        return self._open

    @property
    def told(self) -> tuple[SegmentState, ...]:
        """The reports as vehicles get them: a gate that is not the RSUs' own is made to look so."""
        if self._gating == "rsu":
            return self.states
        return tuple(_gated(state, state.segment in self._open) for state in self.states)

    @property
    def judged(self) -> frozenset[str]:
        """Watched segments whose y_e is known."""
        return frozenset(state.segment for state in self.states if state.y_e is not None)

    def sample(self, now_s: float) -> None:
        """Sample the traffic after each step; a window ends at each full minute."""
        if now_s % _SAMPLE_EVERY_S:
            return
        self._observer.sample()
        self._looked += 1
        if now_s % WINDOW_S == 0 and self._looked >= WINDOW_S / _SAMPLE_EVERY_S:
            self._report(self._observer.observe(now_s))

    def _report(self, observations: Sequence[Observation]) -> None:
        self.states = tuple(self._reporter.report(observation) for observation in observations)
        closed = {s.segment for s in self.states if s.y_e == 0}
        reported = {s.segment for s in self.states if s.y_e == 1} - closed
        self._open = open_gates(self._gating, self.watched, reported, self._seed)
        self.opened |= self._open
        self._turbulent = frozenset(o.segment for o in observations if is_turbulent(o.truth))


def _gated(state: SegmentState, open_: bool) -> SegmentState:
    """A state whose flag opens its gate, or does not."""
    if open_:
        return replace(state, y_e=1, reason=None)
    if state.y_e == 1:
        return replace(state, y_e=None, reason="uncertain")
    return state


def open_gates(
    gating: Gating, watched: Collection[str], reported: Collection[str], seed: int
) -> frozenset[str]:
    """The segments whose gates are open. `gating`: `random` permutes the reported gates over the
    segments once a day, so that as many are open for as long.
    """
    if gating == "open":
        return frozenset(watched)
    if gating == "rsu":
        return frozenset(reported)
    names = sorted(watched)
    others = np.random.default_rng([seed, _STREAM]).permutation(len(names))
    return frozenset(
        name for name, other in zip(names, others, strict=True) if names[other] in reported
    )


def is_turbulent(truth: TrueWindow | None) -> bool:
    """Whether the true traffic was turbulent; fewer vehicles than the rule needs do not count."""
    return truth is not None and truth.y_e == 0 and truth.vehicles >= _MIN_VEHICLES
