"""What is wrong with the dispatcher and with what it needs, by plain facts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from dispatcher_daemon.service.alarms import (
    CHECKS,
    KINDS,
    Condition,
    ServiceFacts,
    service_conditions,
    unmet,
)
from dispatcher_daemon.service.alarms.service import DISK_EMPTY_BYTES, UNANSWERED
from dispatcher_daemon.service.dispatcher.reports import failed_report
from slipstream.messages import CycleReport, HardwareHealth, SolverReport
from storage import Room

GOOD = failed_report(7, 10**18, 1.0, "").model_copy(update={"status": "ok", "reason": None})
WELL = ServiceFacts(
    interval_s=30.0,
    cycle=GOOD,
    running_s=3.0,
    room=Room(10**6, 10**12),
    device=HardwareHealth(
        backend="ibm:a", pending=0, used_s=0.0, budget_s=60.0, breaker="half-open", line="trial"
    ),
    cluster_slots=2,
)


def run(status: Any) -> SolverReport:
    """A solver's."""
    return SolverReport(
        solver="tabu", status=status, objective_kwh=None, repaired=False, wall_s=1.0, reason="boom"
    )


def cycle(**changes: Any) -> CycleReport:
    """A good one but for something."""
    return GOOD.model_copy(update=changes)


def test_where_all_is_well_there_is_no_alarm() -> None:
    """Nor before the first cycle; one that found nothing better than the baseline is well, too."""
    assert list(service_conditions(WELL)) == []
    assert list(service_conditions(ServiceFacts(interval_s=30.0))) == []
    fine = cycle(status="baseline", reason="none is better", solvers=(run("feasible"),))
    assert list(service_conditions(replace(WELL, cycle=fine))) == []


@pytest.mark.parametrize(
    ("changes", "kind", "text"),
    [
        ({"paused": ("ada", 10**18)}, "paused", "paused by ada"),
        ({"bus_fault": "no router answers"}, "bus_lost", "no router"),
        ({"cycle": failed_report(8, 5, 1.0, "no fleet")}, "cycle_failed", "8 failed: no fleet"),
        ({"cycle": cycle(wall_s=31.0)}, "cycle_overran", "cycle 7 took 31 s"),
        ({"running_s": 31.0}, "cycle_overran", "longer than 30 s"),
        (
            {"cycle": cycle(status="baseline", reason="no answer", solvers=(run("timeout"),))},
            "baseline_only",
            "no answer",
        ),
        ({"storage_fault": "disk full"}, "database_fault", "disk full"),
        ({"set_aside": "x.db-corrupt-1"}, "database_set_aside", "x.db-corrupt-1"),
        ({"clock_fault": "the clock is 400 days ahead"}, "clock_untrusted", "400 days ahead"),
        ({"room": Room(9_100_000_000, 10**12)}, "database_nearly_full", "10000 MB"),
        ({"room": Room(10**6, 999_000_000)}, "disk_nearly_full", "999 MB"),
        ({"cycle": cycle(solvers=(run("failed"), run("optimal")))}, "solver_broken", "tabu: boom"),
        (
            {"device": WELL.device.model_copy(update={"breaker": "open"})},  # type: ignore[union-attr]
            "solver_broken",
            "ibm:a",
        ),
        ({"cluster_slots": 0}, "cluster_lost", "alone"),
    ],
)
def test_each_fault_is_its_alarm(changes: dict[str, Any], kind: str, text: str) -> None:
    """One, and it says what is the matter."""
    (found,) = service_conditions(replace(WELL, **changes))
    assert found.kind == kind
    assert text in found.text
    assert found.kind in KINDS


def test_no_solver_at_all_is_critical() -> None:
    """One alarm, though each solver's run says that it failed too."""
    fault = "no solver works (tabu: BrokenProcessPool)"
    facts = replace(WELL, cycle=cycle(solvers=(run("failed"),)), solver_fault=fault)
    (found,) = service_conditions(facts)
    assert (found.kind, found.severity, found.text) == ("solver_broken", "critical", fault)


def test_a_full_disk_is_critical() -> None:
    """One that is nearly full is not yet."""
    (low,) = service_conditions(replace(WELL, room=Room(1, 900_000_000)))
    (empty,) = service_conditions(replace(WELL, room=Room(1, 100_000_000)))
    assert (low.severity, empty.severity) == (None, "critical")


def test_a_cycle_that_could_not_be_stored_is_one_alarm() -> None:
    """The database's."""
    facts = replace(WELL, cycle=failed_report(8, 5, 1.0, "not stored"), storage_fault="not stored")
    assert [found.kind for found in service_conditions(facts)] == ["database_fault"]


def test_what_is_critical_is_what_the_dispatcher_is_not_ready_for() -> None:
    """Each kind that may be critical has a check; lesser ones and what is only awaited do not
    count.
    """
    assert all(kind.check for kind in KINDS.values() if kind.severity == "critical")
    assert set(CHECKS) == {"rsus", "vehicles", "cycle", "bus", "database", "solvers"}
    full = Room(10**6, int(DISK_EMPTY_BYTES) - 1)
    facts = replace(WELL, solver_fault="no solver works", room=full, storage_fault="disk is full")
    found = unmet(service_conditions(facts))
    assert found == {
        "solvers": "no solver works",
        "database": "disk is full; 200 MB are left on the disk of the database",
    }
    assert unmet(service_conditions(replace(WELL, room=Room(10**6, 999_000_000)))) == {}
    assert unmet([Condition("fleet_lost", "dispatcher", "none yet", awaited=True)]) == {}


@pytest.mark.parametrize(("cycles", "severity"), [(UNANSWERED - 1, None), (UNANSWERED, "critical")])
def test_solvers_that_never_answer(cycles: int, severity: str | None) -> None:
    """One cycle may be too short; several in a row are no working solver."""
    late = cycle(status="baseline", reason="no answer", solvers=(run("timeout"), run("failed")))
    found = service_conditions(replace(WELL, cycle=late, unanswered=cycles))
    assert [c.severity for c in found if c.kind == "baseline_only"] == [severity]
