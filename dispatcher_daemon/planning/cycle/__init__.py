"""A cycle: the situation in, the plans of a whole fleet out."""

from __future__ import annotations

from dispatcher_daemon.planning.cycle.cycle import CycleResult, cycle_seed, form_of, run_cycle

__all__ = ["CycleResult", "cycle_seed", "form_of", "run_cycle"]
