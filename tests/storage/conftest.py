"""Cycles to store: every field of every message filled in, by cycle number."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

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

Cycle = tuple[CycleReport, list[VehiclePlan], list[SegmentState]]
START_NS = 1_790_000_000_000_000_000
PERIOD_NS = 30_000_000_000


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


class PostgresServer:
    """A PostgreSQL server of its own on a free port of the loopback interface."""

    def __init__(self, pg_ctl: str) -> None:
        self._pg_ctl = pg_ctl
        # It refuses to run as root, and its socket needs a short path.
        self._user = "postgres" if os.geteuid() == 0 else None
        self._folder = Path(tempfile.mkdtemp(prefix="slipstream-pg-"))
        if self._user is not None:
            shutil.chown(self._folder, self._user)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self._made = 0
        self._control("-o", "-A trust -U postgres --no-sync", "initdb")
        self.start()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = f"-p {self._port} -k {self._folder} -c listen_addresses=127.0.0.1 -c fsync=off"
        self._control("-o", options, "-l", str(self._folder / "log"), "-w", "start")

    def stop(self) -> None:
        """Stop it at once, as a crash does."""
        self._control("-m", "immediate", "-w", "stop")

    def remove(self) -> None:
        """Delete its files."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def new_database(self) -> str:
        """URL of an empty database."""
        self._made += 1
        name = f"test_{self._made}"
        self.execute(f"CREATE DATABASE {name}")
        return self._url(name)

    def execute(self, statement: str) -> None:
        """Execute a statement as the server's administrator."""
        engine = create_engine(self._url("postgres"), isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            connection.execute(text(statement))
        engine.dispose()

    def cut_sessions(self, url: str) -> None:
        """End all connections to a database."""
        name = url.rpartition("/")[2]
        self.execute(
            f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{name}'"
        )

    def _url(self, database: str) -> str:
        return f"postgresql://postgres@127.0.0.1:{self._port}/{database}"

    def _control(self, *arguments: str) -> None:
        command = [self._pg_ctl, "-D", str(self._folder / "data"), *arguments]
        subprocess.run(
            command, user=self._user, check=True, stdout=subprocess.DEVNULL, cwd=self._folder
        )


@pytest.fixture(scope="session")
def postgres(tool: Callable[[str], str]) -> Iterator[PostgresServer]:
    """A server for all tests of a session."""
    pg_ctl = tool("postgresql")
    pytest.importorskip("psycopg")
    server = PostgresServer(pg_ctl)
    try:
        yield server
        server.stop()
    finally:
        server.remove()


@pytest.fixture
def postgres_url(postgres: PostgresServer) -> str:
    """An empty database of the server."""
    return postgres.new_database()


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.process)])
def any_url(request: pytest.FixtureRequest) -> str:
    """A database of each kind: what holds for one holds for the other."""
    name = "url" if request.param == "sqlite" else "postgres_url"
    found: str = request.getfixturevalue(name)
    return found
