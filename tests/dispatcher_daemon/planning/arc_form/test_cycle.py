from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
SETTINGS = DispatcherSettings(form="arc", solvers=("exact",))


def cycle(town: Town, **first: float) -> CycleResult:
    """Two vans with a parcel each for one corner, the second ready 40 s after the first. By the
    paper's objective, in which only departures from depots move.
    """
    vans = [{"first_stop": "s0", **first}, {"first_stop": "s1", "ready_s": 40.0}]
    problem, snapshot = town(["33", "33"], vans)
    problem = replace(problem, objective="paper")
    solve = solve_in_process([ExactSolver()])
    return run_cycle(Cycle(problem, snapshot, SETTINGS, 1, snapshot.now_ns, 1), solve)


def test_departures_move_within_their_windows_so_that_platoons_meet(town: Town) -> None:
    """Given a minute to wait, the first van leaves with the second and they draft all the way:
    the same routes, a better objective, and the saving is drag alone.
    """
    rigid, patient = cycle(town), cycle(town, depart_by_s=60.0)
    leaves = [
        [(p.depart_ns - p.issued_ns) * 1e-9 - SETTINGS.deadline_s for p in result.plans]
        for result in (rigid, patient)
    ]
    assert leaves[0] == pytest.approx([0.0, 40.0])
    assert leaves[1] == pytest.approx([40.0, 40.0])
    assert rigid.report.objective_kwh is not None
    assert patient.report.objective_kwh is not None
    assert patient.report.objective_kwh < rigid.report.objective_kwh - 1e-3
    assert all(s.platoon is None for p in rigid.plans for s in p.segments)
    assert all(s.platoon is not None for p in patient.plans for s in p.segments)
    energy = patient.report.energy
    assert energy is not None
    assert energy.saved_drag_kwh > 0
    assert energy.saved_distance_kwh == pytest.approx(0.0, abs=1e-12)


def test_a_window_that_closes_too_early_moves_nobody(town: Town) -> None:
    """30 s of patience are not enough for 40: everybody leaves when ready."""
    result = cycle(town, depart_by_s=30.0)
    leaves = [(p.depart_ns - p.issued_ns) * 1e-9 - SETTINGS.deadline_s for p in result.plans]
    assert leaves == pytest.approx([0.0, 40.0])
    assert all(s.platoon is None for p in result.plans for s in p.segments)


def test_stops_at_one_junction_are_served_in_one_visit(town: Town) -> None:
    """Two pooled stops at the corner that a van drives to anyway cost no way between them, and a
    stop at the depot's junction is served too.
    """
    vans = [{"first_stop": "s0"}, {"first_stop": "s1", "ready_s": 40.0}]
    problem, snapshot = town(["33", "00", "33", "33"], vans)
    solve = solve_in_process([ExactSolver()])
    result = run_cycle(Cycle(problem, snapshot, SETTINGS, 1, snapshot.now_ns, 1), solve)
    assert result.report.status == "ok"
    stops = {p.vehicle: [s.stop for s in p.stops[1:-1]] for p in result.plans}
    first, second = (stops[v.id] for v in problem.fleet.vehicles)
    assert first[0] == "s0"
    assert sorted(first[1:]) == ["s2", "s3"]
    assert second == ["s1"]
