"""Cycles to store: every field of every message filled in, by cycle number."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from slipstream.messages import (
    CarrierSummary,
    CycleReport,
    EnergySummary,
    Estimate,
    Gate,
    KinematicFeatures,
    PlannedSegment,
    PlannedStop,
    SegmentState,
    SolverReport,
    Unserved,
    VehiclePlan,
)
from storage import Event

Cycle = tuple[CycleReport, list[VehiclePlan], list[SegmentState]]
START_NS = 1_790_000_000_000_000_000
PERIOD_NS = 30_000_000_000
RAISED = Event(
    time_ns=START_NS,
    kind="rsu_silent",
    severity="warning",
    subject="rsu/a/b",
    text="nothing heard",
    mend="look at its box",
    alarm="0a",
)
PAUSED = Event(
    time_ns=START_NS + 5,
    kind="pause",
    severity="info",
    subject="dispatcher",
    text="paused",
    actor="operator",
)


def _plan(cycle: int, vehicle: str, place: int) -> VehiclePlan:
    issued_ns = START_NS + cycle * PERIOD_NS
    return VehiclePlan(
        vehicle=vehicle,
        cycle=cycle,
        issued_ns=issued_ns,
        valid_until_ns=issued_ns + 2 * PERIOD_NS,
        depart_ns=issued_ns + 60_000_000_001,
        stops=(PlannedStop(stop="c1", node="c1", arrival_ns=issued_ns + 5, departure_ns=2**62),),
        segments=(
            PlannedSegment(
                segment="avenue_east",
                entry_ns=issued_ns,
                exit_ns=issued_ns + 7,
                speed_mps=16.67,
                platoon="p1",
                place=place,
                gap_m=8.5 if place else None,
                leg=0,
            ),
        ),
        distance_m=6100.25,
        energy_kwh=0.1 + 0.2,
    )


def _state(cycle: int, segment: str, known: bool) -> SegmentState:
    features = KinematicFeatures(
        mean_speed_mps=Estimate(value=15.2, standard_error=0.1),
        mean_acceleration_mps2=Estimate(value=-0.01, standard_error=None),
        density_veh_per_m=Estimate(value=0.02),
        speed_std_mps=Estimate(value=0.7),
        acceleration_variance_m2ps4=Estimate(value=0.09, standard_error=0.03),
        mean_gap_m=None,
    )
    return SegmentState(
        rsu=f"rsu/{segment}",
        segment=segment,
        sequence=cycle * 30,
        time_ns=START_NS + cycle * PERIOD_NS,
        window_s=10.0,
        features=features if known else None,
        y_e=1 if known else None,
        reason=None if known else "too_few_vehicles",
        vehicles=9,
        frames=300,
        coverage=1.0,
    )


def _cycle(number: int) -> Cycle:
    solvers = (
        SolverReport(
            solver="exact", status="optimal", objective_kwh=1.25, repaired=False, wall_s=0.2
        ),
        SolverReport(
            solver="lc-qaoa",
            status="feasible",
            objective_kwh=1.3,
            repaired=True,
            p_feasible_raw=0.0001,
            p_optimal_raw=0.0,
            p_feasible_repaired=1.0,
            qubits=25,
            shots=4096,
            wall_s=0.9,
            reason="raw samples infeasible",
            backend="aer",
            backend_kind="simulated",
            fallback="budget of 60 s a day used up",
            two_qubit_depth=8,
        ),
    )
    report = CycleReport(
        cycle=number,
        started_ns=START_NS + number * PERIOD_NS,
        wall_s=1.5,
        status="ok",
        reason=None,
        solver="exact",
        objective_kwh=1.25,
        variables=25,
        solvers=solvers,
        gates=(
            Gate(segment="avenue_west", y_e=0, reason=None, age_s=0.7, speed_mps=9.0, open=False),
            Gate(
                segment="avenue_east",
                y_e=None,
                reason="stale",
                age_s=None,
                speed_mps=None,
                open=False,
            ),
        ),
        energy=EnergySummary(
            baseline="independent vehicles",
            baseline_kwh=2.0,
            cooperative_kwh=1.8,
            saved_distance_kwh=0.0,
            saved_drag_kwh=0.15,
            saved_acceleration_kwh=0.05,
            platooned_distance_m=4000.0,
            baseline_driving_s=600.0,
            cooperative_driving_s=620.0,
            price_of_time_kw=2.0,
        ),
        plans=2,
        unserved=(
            Unserved(stop="c9", reason="no vehicle has room and time for it"),
            Unserved(stop="Käse_7 'north'", reason="cannot be reached; it is loaded on 'van-a'"),
        ),
        carriers=(
            CarrierSummary(
                carrier="Käse & Co", baseline_kwh=1.2, cooperative_kwh=1.0, saved_cost_kwh=0.1
            ),
            CarrierSummary(carrier=None, baseline_kwh=0.8, cooperative_kwh=0.8, saved_cost_kwh=0.0),
        ),
    )
    plans = [_plan(number, "van-a", 0), _plan(number, "van-b", 1)]
    states = [_state(number, "avenue_east", True), _state(number, "avenue_west", False)]
    return report, plans, states


@pytest.fixture
def make_cycle() -> Callable[[int], Cycle]:
    """A full cycle for a number, as `Database.record_cycle` takes it."""
    return _cycle


@pytest.fixture
def url(tmp_path: Path) -> str:
    """Where a database may be made; its folder does not exist yet."""
    return f"sqlite:///{tmp_path}/state/slipstream.db"


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.process)])
def any_url(request: pytest.FixtureRequest) -> str:
    """A database of each kind: what holds for one holds for the other."""
    name = "url" if request.param == "sqlite" else "postgres_url"
    found: str = request.getfixturevalue(name)
    return found
