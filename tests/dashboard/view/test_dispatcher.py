"""The quantum device in words, and on the page."""

from __future__ import annotations

import re

import pytest

from dashboard.live import Snapshot
from dashboard.panels.environment import render
from dashboard.view.build import DashboardView, build_view
from dashboard.view.dispatcher import hardware_status
from slipstream.messages import HardwareHealth

S = 1_000_000_000
WELL = HardwareHealth(
    backend="ibm:boston", pending=1, used_s=12.5, budget_s=60.0, breaker="closed", line=None
)
EVIL = "<script>alert(1)</script>"


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


def _summary(view: DashboardView) -> str:
    return render("summary.html.j2", view=view)


def test_the_3d_view_shows_it(world, now_ns) -> None:
    """Under the headline; not without a device, and not once the dispatcher is silent."""
    health = world.dispatcher().model_copy(update={"hardware": WELL})
    view = build_view(Snapshot(dispatcher=health), now_ns, 5.0)
    assert "Quantum device ibm:boston: 1 job pending" in _summary(view)
    plain = build_view(Snapshot(dispatcher=world.dispatcher()), now_ns, 5.0)
    assert "Quantum device" not in _summary(plain)
    assert build_view(Snapshot(dispatcher=health), now_ns + 60 * S, 5.0).device is None


def test_foreign_words_are_escaped(world, now_ns) -> None:
    """A service's words cannot become part of the page."""
    evil = WELL.model_copy(update={"backend": EVIL, "line": EVIL})
    health = world.dispatcher().model_copy(update={"hardware": evil})
    summary = _summary(build_view(Snapshot(dispatcher=health), now_ns, 5.0))
    assert "<script>" not in summary
    assert "&lt;script&gt;" in summary


def test_the_last_energy_is_shown_with_its_age(world, now_ns) -> None:
    """Also once the dispatcher is silent; a cycle without one does not hide it."""
    saving = world.cycle(7, now_ns - 12 * S)
    idle = saving.model_copy(update={"cycle": 8, "energy": None})
    energy = saving.energy
    dearer = saving.model_copy(
        update={"energy": energy.model_copy(update={"cooperative_kwh": energy.baseline_kwh + 0.1})}
    )
    view = build_view(Snapshot(cycles=(saving, idle)), now_ns, 5.0)
    assert re.search(r"Cycle 7, 12 s ago: .* kWh saves 0.07 kWh \(4\.\d%\)", _summary(view))
    assert "costs 0.10 kWh" in _summary(build_view(Snapshot(cycles=(dearer,)), now_ns, 5.0))
    assert build_view(Snapshot(), now_ns, 5.0).energy is None
