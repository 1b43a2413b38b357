"""Vehicles that sense ten times a second, four in a row on roads of their own, two pairs close."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from slipstream.messages import (
    DrivingAdvice,
    Estimate,
    KinematicFeatures,
    MovementEvent,
    MovementState,
    PhaseState,
    PlannedCrossing,
    PlannedSegment,
    PlannedStop,
    SegmentState,
    SensedVehicle,
    SignalPhaseAndTiming,
    VehiclePlan,
    VehicleSensing,
)

GROUP = 4
SPEED_MPS = 13.0
_FIRST_M = 2000.0
_SECOND_M = 1500.0
_SPACING_M = (0.0, 7.6, 80.0, 87.6)
"""Between the first front and each front of a group: 3 m between the vehicles of a pair."""
_LENGTH_M = 4.6
_CALM = KinematicFeatures(
    mean_speed_mps=Estimate(value=13.0, standard_error=0.1),
    mean_acceleration_mps2=Estimate(value=0.0, standard_error=0.01),
    density_veh_per_m=Estimate(value=0.02, standard_error=0.001),
    speed_std_mps=Estimate(value=0.4, standard_error=0.1),
    acceleration_variance_m2ps4=Estimate(value=0.05, standard_error=0.01),
    mean_gap_m=Estimate(value=22.0, standard_error=2.0),
)


@dataclass(frozen=True)
class BenchVan:
    """One vehicle."""

    number: int
    began_ns: int

    @property
    def name(self) -> str:
        """Its id."""
        return f"van-{self.number}"

    @property
    def _group(self) -> int:
        return self.number // GROUP

    def plan(self) -> VehiclePlan:
        """Two long segments with a signal between them."""
        ns = self.began_ns
        crossing = PlannedCrossing(
            length_m=20.0,
            speed_mps=13.9,
            yields=False,
            intersection=f"signal-{self._group}",
            signal_groups=((0, 0),),
        )

        def segment(name: str, length_m: float, onward: PlannedCrossing | None) -> PlannedSegment:
            return PlannedSegment(
                segment=f"{name}-{self._group}",
                entry_ns=ns,
                exit_ns=ns + 10**12,
                speed_mps=13.9,
                platoon=None,
                place=None,
                gap_m=None,
                leg=0,
                length_m=length_m,
                speed_limit_mps=13.9,
                lanes=1,
                crossing=onward,
            )

        def stop(name: str) -> PlannedStop:
            return PlannedStop(stop=name, node=name, arrival_ns=ns, departure_ns=ns)

        return VehiclePlan(
            vehicle=self.name,
            cycle=1,
            issued_ns=ns,
            valid_until_ns=ns + 10**13,
            depart_ns=ns,
            stops=(stop("depot"), stop("customer")),
            segments=(segment("a", _FIRST_M, crossing), segment("b", _SECOND_M, None)),
            distance_m=_FIRST_M + _SECOND_M,
            energy_kwh=0.5,
            advice=DrivingAdvice(eco_approach=True, coasting_budget=0.06, signal_priority=True),
        )

    def sensing(self, now_ns: int) -> VehicleSensing:
        """What it senses now; it drives to the signal, and from the beginning again."""
        place = self.number % GROUP
        driven_m = SPEED_MPS * (now_ns - self.began_ns) / 1e9
        front_m = (driven_m % (_FIRST_M - 600.0)) + 400.0 - _SPACING_M[place]
        ahead = None
        if place % 2:
            gap_m = _SPACING_M[place] - _SPACING_M[place - 1] - _LENGTH_M
            front = f"van-{self.number - 1}"
            ahead = SensedVehicle(track=front, vehicle=front, gap_m=gap_m, speed_mps=SPEED_MPS)
        return VehicleSensing(
            vehicle=self.name,
            time_ns=now_ns,
            on_road=True,
            segment=f"a-{self._group}",
            crossing=False,
            lane=0,
            front_m=front_m,
            speed_mps=SPEED_MPS,
            acceleration_mps2=0.0,
            driven_m=driven_m,
            ahead=ahead,
            behind=None,
        )


def roadside(vans: int, sequence: int) -> Iterator[SegmentState | SignalPhaseAndTiming]:
    """What RSUs and signals tell of all groups' roads once a second."""
    now_ns = time.time_ns()
    for group in range(-(-vans // GROUP)):
        for name in ("a", "b"):
            yield SegmentState(
                rsu=f"rsu-{group}",
                segment=f"{name}-{group}",
                sequence=sequence,
                time_ns=now_ns,
                window_s=10.0,
                features=_CALM,
                y_e=1,
                reason=None,
                vehicles=8,
                frames=300,
                coverage=1.0,
            )
        begin_ns = now_ns // (60 * 10**9) * (60 * 10**9)
        shown: tuple[tuple[PhaseState, float, float], ...] = (
            ("stop-And-Remain", 0.0, 30.0),
            ("protected-Movement-Allowed", 30.0, 57.0),
            ("protected-clearance", 57.0, 60.0),
        )
        events = tuple(
            MovementEvent(
                state=state,
                start_ns=begin_ns + round((60 * cycle + start_s) * 1e9),
                min_end_ns=begin_ns + round((60 * cycle + end_s) * 1e9),
                max_end_ns=begin_ns + round((60 * cycle + end_s) * 1e9),
            )
            for cycle in range(2)
            for state, start_s, end_s in shown
        )
        yield SignalPhaseAndTiming(
            intersection=f"signal-{group}",
            revision=0,
            time_ns=now_ns,
            movements=(MovementState(signal_group=0, events=events),),
        )
