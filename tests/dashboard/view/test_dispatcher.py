"""The quantum device in words, and on the page."""

from __future__ import annotations

import pytest

from dashboard.live import Snapshot
from dashboard.panels import PANELS
from dashboard.view import DashboardView, build_view
from dashboard.view.dispatcher import execution_summary, hardware_status
from slipstream.messages import HardwareHealth, SolverReport

S = 1_000_000_000
WELL = HardwareHealth(
    backend="ibm:boston", pending=1, used_s=12.5, budget_s=60.0, breaker="closed", line=None
)
EVIL = "<script>alert(1)</script>"


def _html(name: str, view: DashboardView) -> str:
    """The HTML of one panel."""
    return next(panel.html(view) for panel in PANELS if panel.name == name)


@pytest.mark.parametrize(
    ("changes", "line", "level"),
    [
        (
            {},
            "Quantum device ibm:boston: 1 job pending · 12.5 of 60 s used in the last day",
            "ok",
        ),
        (
            {"breaker": "open", "line": "breaker open until 10:00:00 UTC: 401", "pending": 0},
            "Quantum device ibm:boston: 0 jobs pending · 12.5 of 60 s used in the last day · "
            "breaker open · no new jobs: breaker open until 10:00:00 UTC: 401",
            "warn",
        ),
        (
            {"backend": "fake:FakeBoston"},
            "Noise model of FakeBoston, no device: 1 job pending · "
            "12.5 of 60 s used in the last day",
            "ok",
        ),
    ],
)
def test_jobs_budget_and_breaker(changes: dict[str, object], line: str, level: str) -> None:
    """One line has the pending jobs, the used time, and why nothing is submitted."""
    assert hardware_status(WELL.model_copy(update=changes)) == (line, level)


def a_run(**changes: object) -> SolverReport:
    """A solver's report, with changes."""
    run = SolverReport(
        solver="lc-qaoa", status="feasible", objective_kwh=1.0, repaired=False, wall_s=0.1
    )
    return run.model_copy(update=changes)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, ""),
        (
            {"backend": "ibm_boston", "backend_kind": "hardware", "two_qubit_depth": 8},
            "on ibm_boston, hardware · two-qubit depth 8",
        ),
        (
            {"backend": "FakeBoston", "backend_kind": "noise-model"},
            "on FakeBoston, simulated with a device's noise",
        ),
        (
            {"backend": "aer", "backend_kind": "simulated", "fallback": "401: refused"},
            "on aer, simulated · instead of the device: 401: refused",
        ),
    ],
)
def test_where_a_circuit_ran(changes: dict[str, object], line: str) -> None:
    """Simulator, noise model and hardware have their own names; a fallback has its reason."""
    assert execution_summary(a_run(**changes)) == line


def test_the_page_shows_both(world, now_ns) -> None:
    """The line is in the summary, the reason under the solver; neither without a device."""
    health = world.dispatcher().model_copy(update={"hardware": WELL})
    snapshot = Snapshot(dispatcher=health, cycles=(world.cycle(3),))
    view = build_view(snapshot, now_ns, stale_after_s=5.0, silent_after_s=30.0)
    assert "Quantum device ibm:boston: 1 job pending" in _html("summary", view)
    page = _html("cycle", view)
    assert "on aer, simulated · two-qubit depth 8" in page
    assert "instead of the device: job c1 still queued after 8.0 s" in page
    without = Snapshot(dispatcher=world.dispatcher(), cycles=(world.cycle(3),))
    plain = build_view(without, now_ns, stale_after_s=5.0, silent_after_s=30.0)
    assert "Quantum device" not in _html("summary", plain)
    later = build_view(snapshot, now_ns + 60 * S, stale_after_s=5.0, silent_after_s=30.0)
    assert later.device is None


def test_foreign_words_are_escaped(world, now_ns) -> None:
    """A service's words cannot become part of the page."""
    evil = WELL.model_copy(update={"backend": EVIL, "line": EVIL})
    report = world.cycle(1)
    runs = tuple(
        run.model_copy(update={"fallback": EVIL, "backend": EVIL}) for run in report.solvers
    )
    snapshot = Snapshot(
        dispatcher=world.dispatcher().model_copy(update={"hardware": evil}),
        cycles=(report.model_copy(update={"solvers": runs}),),
    )
    view = build_view(snapshot, now_ns, stale_after_s=5.0, silent_after_s=30.0)
    assert "<script>" not in _html("summary", view) + _html("cycle", view)
    assert "&lt;script&gt;" in _html("summary", view)
    assert "&lt;script&gt;" in _html("cycle", view)
