"""A made-up city: the reports, plans, states and roll-ups of each of its cycles."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from slipstream.messages import (
    CycleReport,
    Estimate,
    Gate,
    KinematicFeatures,
    PlannedSegment,
    PlannedStop,
    SegmentState,
    SolverReport,
    VehiclePlan,
)
from storage import RollUp, RollUpBuffer

START_NS: Final = 1_790_000_000 // 3600 * 3600 * 10**9
CYCLE_S: Final = 300
MINUTES: Final = CYCLE_S // 60
PLANS: Final = 5
"""Plans sent anew in a cycle: what vehicles on their way know already is left out."""
PLAN_SEGMENTS: Final = 40
CHANGING: Final = 0.1
"""Share of the gates that change in a cycle."""
_STATES_A_MINUTE: Final = 60
_VARIANTS: Final = 6
"""Sets of measured figures that take turns."""


@dataclass(frozen=True)
class CityCycle:
    """What one cycle stores."""

    report: CycleReport
    plans: Sequence[VehiclePlan]
    states: Sequence[SegmentState]
    minutes: Sequence[RollUp]


class StoredCity:
    """So many watched segments, from a seed."""

    def __init__(self, segments: int, seed: int = 1) -> None:
        self._random = random.Random(seed)
        self._names = [f"city_segment_{number:05d}" for number in range(segments)]
        self._open = [self._random.random() < 0.7 for _ in self._names]
        self._states = [
            [self._state(name, START_NS) for name in self._names] for _ in range(_VARIANTS)
        ]
        self._minutes = [self._minute() for _ in range(_VARIANTS)]

    def cycle(self, number: int) -> CityCycle:
        """The cycle of a number, from 1."""
        started_ns = START_NS + number * CYCLE_S * 10**9
        for place in range(len(self._open)):
            if self._random.random() < CHANGING:
                self._open[place] = not self._open[place]
        minutes = [
            replace(part, began_ns=started_ns - (minute + 1) * 60 * 10**9)
            for minute in range(MINUTES)
            for part in self._minutes[(number + minute) % _VARIANTS]
        ]
        states = self._states[number % _VARIANTS]
        return CityCycle(
            self._report(number, started_ns),
            [self._plan(number, vehicle, started_ns) for vehicle in range(PLANS)],
            states,
            minutes,
        )

    def _state(self, name: str, time_ns: int) -> SegmentState:
        drawn = self._random

        def measured(mean: float, spread: float) -> Estimate:
            value = mean + spread * drawn.gauss()
            return Estimate(value=value, standard_error=abs(0.1 * spread * drawn.gauss()))

        return SegmentState(
            rsu=f"rsu_of_{name}",
            segment=name,
            sequence=drawn.randrange(10**6),
            time_ns=time_ns,
            window_s=10.0,
            features=KinematicFeatures(
                mean_speed_mps=measured(14.0, 2.0),
                mean_acceleration_mps2=measured(0.0, 0.1),
                density_veh_per_m=measured(0.03, 0.005),
                speed_std_mps=measured(1.2, 0.3),
                acceleration_variance_m2ps4=measured(0.2, 0.05),
                mean_gap_m=measured(25.0, 5.0),
            ),
            y_e=1 if drawn.random() < 0.7 else 0,
            reason=None,
            vehicles=drawn.randrange(20),
            frames=150,
            coverage=1.0,
        )

    def _minute(self) -> list[RollUp]:
        """A minute of all segments, of a state a second; each is made from six that take turns."""
        buffer = RollUpBuffer()
        for name in self._names:
            drawn = [self._state(name, START_NS) for _ in range(6)]
            for second in range(_STATES_A_MINUTE):
                buffer.add(drawn[second % 6])
        return buffer.take()

    def _report(self, number: int, started_ns: int) -> CycleReport:
        gates = tuple(
            Gate(
                segment=name,
                y_e=1 if is_open else 0,
                reason=None if is_open else "turbulent",
                age_s=self._random.random(),
                speed_mps=14.0 + self._random.gauss(),
                open=is_open,
            )
            for name, is_open in zip(self._names, self._open, strict=True)
        )
        solvers = tuple(
            SolverReport(
                solver=name, status="feasible", objective_kwh=100.5, repaired=False, wall_s=4.2
            )
            for name in ("insertion", "tabu", "lc-qaoa")
        )
        return CycleReport(
            cycle=number,
            started_ns=started_ns,
            wall_s=5.0,
            status="ok",
            reason=None,
            solver="tabu",
            objective_kwh=100.5,
            variables=500,
            solvers=solvers,
            gates=gates,
            energy=None,
            plans=PLANS,
        )

    def _plan(self, cycle: int, vehicle: int, issued_ns: int) -> VehiclePlan:
        begins = [issued_ns + place * 10**10 for place in range(PLAN_SEGMENTS + 1)]
        return VehiclePlan(
            vehicle=f"van-{vehicle}",
            cycle=cycle,
            issued_ns=issued_ns,
            valid_until_ns=issued_ns + 10**12,
            depart_ns=issued_ns + 10**10,
            stops=tuple(
                PlannedStop(
                    stop=f"stop-{cycle}-{place}",
                    node=f"node-{place}",
                    arrival_ns=begins[place],
                    departure_ns=begins[place + 1],
                )
                for place in range(10)
            ),
            segments=tuple(
                PlannedSegment(
                    segment=self._random.choice(self._names),
                    entry_ns=begins[place],
                    exit_ns=begins[place + 1],
                    speed_mps=13.9,
                    platoon=None,
                    place=0,
                    gap_m=None,
                    leg=place // 4,
                )
                for place in range(PLAN_SEGMENTS)
            ),
            distance_m=6100.25,
            energy_kwh=1.5,
        )
