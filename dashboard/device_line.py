"""A quantum device in words: where circuits ran, and the state of the dispatcher's device."""

from __future__ import annotations

from typing import Final

from dashboard import words
from dashboard.words import Level
from slipstream.messages import HardwareHealth, SolverReport

KINDS: Final[dict[str, str]] = {
    "simulated": "simulated",
    "noise-model": "simulated with a device's noise",
    "hardware": "hardware",
}


def device_line(health: HardwareHealth) -> tuple[str, Level]:
    """Jobs, budget and breaker in a line, and its level; a noise model is called one.

    A breaker is told only where it is not closed.
    """
    service, _, model = health.backend.partition(":")
    device = f"Quantum device {health.backend}"
    if service == "fake" and model:
        device = f"Noise model of {model}, no device"
    parts = [
        f"{device}: {words.plural(health.pending, 'job')} pending",
        f"{health.used_s:.1f} of {health.budget_s:g} s used in the last day",
    ]
    if health.breaker != "closed":
        parts.append(f"breaker {health.breaker}")
    if health.line is not None:
        parts.append(f"no new jobs: {health.line}")
    return " · ".join(parts), "ok" if health.line is None else "warn"


def where_it_ran(run: SolverReport) -> str:
    """Where a solver's circuit ran, and why not on the device; empty for a solver without one."""
    parts = []
    if run.backend is not None:
        kind = KINDS.get(run.backend_kind or "", "")
        parts.append(f"on {run.backend}" + (f", {kind}" if kind else ""))
        if run.two_qubit_depth is not None:
            parts.append(f"two-qubit depth {run.two_qubit_depth}")
    if run.fallback is not None:
        parts.append(f"instead of the device: {run.fallback}")
    return " · ".join(parts)
