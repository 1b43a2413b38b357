"""What the RSUs report in a running simulation, and where platoons may form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from edge_daemon.stability import StabilitySettings
from simulation.closed_loop.policy import Gating
from simulation.scenarios.observer import Observation, Observer
from simulation.scenarios.perception import Reporter, measured_errors
from simulation.scenarios.rsus import Rsu
from slipstream.messages import SegmentState

WINDOW_S: Final = 60.0
"""Longer than the paper's 10 s, in which less than three vehicles come by most of the day."""

_LOOK_EVERY_S: Final = 1.0
_STREAM: Final = 3000


class Roadside:
    """RSUs of a running simulation: windows, reports with errors, gates.

    Args:
        rsus: whose views they are.
        seed: of errors, and of random gates.
        noise: the paper's, on the features.
        gating: what opens a gate.
    """

    def __init__(self, rsus: Sequence[Rsu], seed: int, noise: float, gating: Gating) -> None:
        rule = StabilitySettings().bare()
        self._observer = Observer(rsus, _LOOK_EVERY_S, rule, WINDOW_S)
        self._reporter = Reporter(measured_errors(), seed, noise=noise, window_s=WINDOW_S)
        self._seed, self._gating = seed, gating
        self._looked = 0
        self.watched = tuple(sorted({s.segment for rsu in rsus for s in rsu.watch}))
        self.states: tuple[SegmentState, ...] = ()
        self._open: frozenset[str] = frozenset()
        self._turbulent: frozenset[str] = frozenset()

    def is_open(self, segment: str) -> bool:
        """Whether close gaps are allowed there, as of the last window."""
        return segment in self._open

    def is_turbulent(self, segment: str) -> bool:
        """Whether the traffic there was turbulent in the last window in truth."""
        return segment in self._turbulent

    @property
    def open(self) -> frozenset[str]:
        """Watched segments whose gate is open."""
        return self._open

    @property
    def judged(self) -> int:
        """Watched segments whose y_e is known."""
        return len({state.segment for state in self.states if state.y_e is not None})

    def look(self, now_s: float) -> None:
        """After each step; a window ends at each full minute."""
        if now_s % _LOOK_EVERY_S:
            return
        self._observer.look()
        self._looked += 1
        if now_s % WINDOW_S == 0 and self._looked >= WINDOW_S / _LOOK_EVERY_S:
            self._report(self._observer.observe(now_s), now_s)

    def _report(self, observations: Sequence[Observation], now_s: float) -> None:
        states = [self._reporter.report(observation) for observation in observations]
        self.states = tuple(self._gated(states, now_s))
        closed = {s.segment for s in self.states if s.y_e == 0}
        self._open = frozenset(s.segment for s in self.states if s.y_e == 1) - closed
        self._turbulent = frozenset(
            o.segment for o in observations if o.truth is not None and o.truth.y_e == 0
        )

    def _gated(self, states: list[SegmentState], now_s: float) -> list[SegmentState]:
        if self._gating == "rsu":
            return states
        if self._gating == "open":
            return [_flagged(state, 1) for state in states]
        # As many gates as are reported stable, on any of the watched segments.
        rng = np.random.default_rng([self._seed, _STREAM, round(now_s)])
        flags = rng.permutation([state.y_e == 1 for state in states])
        return [_flagged(s, 1 if flag else 0) for s, flag in zip(states, flags, strict=True)]


def _flagged(state: SegmentState, y_e: int) -> SegmentState:
    """A state with a flag that no traffic stands behind."""
    return state.model_copy(update={"y_e": y_e, "reason": None})
