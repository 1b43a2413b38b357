"""Counts what goes over the bus: the figures that `slipstream run --json` prints."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.messages import (
    ALL_PLANS,
    ALL_RSU_HEALTH,
    ALL_STATES,
    CYCLE_KEY,
    CycleReport,
    RsuHealth,
    SegmentState,
    VehiclePlan,
    decode,
)


@dataclass
class Tally:
    """What was seen on the bus since `listen`.

    Attributes:
        health: last health of each run of each RSU, by (RSU, start time).
        states: last state of each segment.
        state_count: states seen.
        cycles: last report of each cycle, by number.
        plans: (vehicle, cycle) of each plan seen.
        bad: messages that were not what their key promises.
    """

    health: dict[tuple[str, int], RsuHealth] = field(default_factory=dict)
    states: dict[str, SegmentState] = field(default_factory=dict)
    state_count: int = 0
    cycles: dict[int, CycleReport] = field(default_factory=dict)
    plans: set[tuple[str, int]] = field(default_factory=set)
    bad: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def listen(self, bus: Bus) -> None:
        """Count from now on."""
        for key in (ALL_STATES, ALL_RSU_HEALTH, CYCLE_KEY, ALL_PLANS):
            bus.subscribe(key, self._take)

    def _take(self, key: str, payload: bytes) -> None:
        with self._lock:
            try:
                self._count(key, payload)
            except InputError:
                self.bad += 1

    def _count(self, key: str, payload: bytes) -> None:
        if key.endswith("/state"):
            state = decode(SegmentState, payload, key)
            self.state_count += 1
            self.states[state.segment] = state
        elif key.endswith("/plan"):
            plan = decode(VehiclePlan, payload, key)
            self.plans.add((plan.vehicle, plan.cycle))
        elif key == CYCLE_KEY:
            report = decode(CycleReport, payload, key)
            self.cycles[report.cycle] = report
        else:
            health = decode(RsuHealth, payload, key)
            self.health[health.rsu, health.started_ns] = health

    def summary(self) -> dict[str, object]:
        """The figures, ready for JSON."""
        with self._lock:
            finished = [c for c in self.cycles.values() if c.energy is not None]
            energy = max(finished, key=lambda c: c.cycle).energy if finished else None
            return {
                "frames": sum(h.frames for h in self.health.values()),
                "segment_states": self.state_count,
                "cycles": len(finished),
                "plans": len(self.plans),
                "y_e": {s.segment: s.y_e for s in self.states.values()},
                "energy_kwh": {
                    "baseline": energy.baseline_kwh if energy else None,
                    "cooperative": energy.cooperative_kwh if energy else None,
                },
            }
