"""Counts messages on the bus, for the figures of `slipstream run --json`."""

from __future__ import annotations

import logging
import threading
from collections import Counter
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
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

_FLAG = {1: "stable", 0: "turbulent", None: "unknown"}


@dataclass
class BusCounts:
    """Counts of messages since `listen`, in constant memory."""

    frames: int = 0
    health: dict[str, RsuHealth] = field(default_factory=dict)
    flags: dict[str, Counter[str]] = field(default_factory=dict)
    cycle_count: int = 0
    last_cycle: CycleReport | None = None
    plan_count: int = 0
    _last_plan: dict[str, int] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _limiter: LogLimiter = field(default_factory=LogLimiter)

    def listen(self, bus: Bus) -> None:
        """Count from now on."""
        for key in (ALL_STATES, ALL_RSU_HEALTH, CYCLE_KEY, ALL_PLANS):
            bus.subscribe(key, self.take, every=True)

    def take(self, key: str, payload: bytes) -> None:
        """Count one message."""
        with self._lock:
            try:
                self._count(key, payload)
            except InputError as error:
                if self._limiter.allow("bad"):
                    log.warning("%s", error)

    def _count(self, key: str, payload: bytes) -> None:
        if key.endswith("/state"):
            state = decode(SegmentState, payload, key)
            self.flags.setdefault(state.segment, Counter())[_FLAG[state.y_e]] += 1
        elif key.endswith("/plan"):
            plan = decode(VehiclePlan, payload, key)
            self.plan_count += plan.cycle > self._last_plan.get(plan.vehicle, -1)
            self._last_plan[plan.vehicle] = plan.cycle
        elif key == CYCLE_KEY:
            report = decode(CycleReport, payload, key)
            newer = self.last_cycle is None or report.cycle > self.last_cycle.cycle
            if report.energy is not None and newer:
                self.cycle_count += 1
                self.last_cycle = report
        else:
            health = decode(RsuHealth, payload, key)
            before = self.health.get(health.rsu)
            if before is not None and before.started_ns != health.started_ns:
                self.frames += before.frames
            self.health[health.rsu] = health

    def summary(self) -> dict[str, object]:
        """The figures, ready for JSON."""
        with self._lock:
            energy = self.last_cycle.energy if self.last_cycle else None
            return {
                "frames": self.frames + sum(h.frames for h in self.health.values()),
                "segment_states": sum(flags.total() for flags in self.flags.values()),
                "cycles": self.cycle_count,
                "plans": self.plan_count,
                "y_e": {segment: dict(flags) for segment, flags in self.flags.items()},
                "energy_kwh": {
                    "baseline": energy.baseline_kwh if energy else None,
                    "cooperative": energy.cooperative_kwh if energy else None,
                },
            }
