"""Simulated time against the wall clock: due times of steps, and late steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

SLIP_S: Final = 0.5
"""A world further behind than this no longer catches up: its clock is set to what it has reached,
as a burst of steps would show vehicles racing."""


@dataclass
class WorldPace:
    """Steps of a simulation that runs in real time. `clock`: monotonic, s."""

    step_s: float
    clock: Callable[[], float]
    steps: int = 0
    late: int = 0
    slipped_s: float = 0.0
    _began_s: float = field(init=False)

    def __post_init__(self) -> None:
        if not self.step_s > 0:
            raise ValueError("step_s must be > 0")
        self._began_s = self.clock()

    @property
    def due_s(self) -> float:
        """When the last step was due, by the clock: what it shows is of that moment."""
        return self._began_s + self.steps * self.step_s

    def wait_s(self) -> float:
        """How long the next step is not yet due, 0 if it is; call it once before each step."""
        behind_s = self.clock() - self.due_s - self.step_s
        if behind_s > SLIP_S:
            self.slipped_s += behind_s
            self._began_s += behind_s
        self.late += behind_s > self.step_s
        return max(0.0, -behind_s)

    def stepped(self) -> None:
        """One step has been done."""
        self.steps += 1
