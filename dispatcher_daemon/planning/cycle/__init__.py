"""A cycle: the situation in, the plans of a whole fleet out."""

from __future__ import annotations

from dispatcher_daemon.planning.cycle.cycle import (
    CycleResult,
    cycle_of,
    form_of,
    run_cycle,
)
from dispatcher_daemon.planning.cycle.solving import Solving

__all__ = ["CycleResult", "Solving", "cycle_of", "form_of", "run_cycle"]
