"""What a message costs the dispatcher and the router: slopes between two rates."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

from slipstream.messages import ALL_POSITIONS, ALL_STATES
from slipstream_lab.benchmarks.service.loaded import Cost, Loaded, run_load
from slipstream_lab.benchmarks.service.telemetry import FLEET, watched_grid

_RATES: Final = (1000, 4000)
"""Messages a second; below what one core takes, so that nothing waits."""
_RSUS: Final = 100
_QUIET: Final = {"interval_s": 3600.0}
"""No cycle falls into the time that is measured."""


def message_costs(seconds: float, folder: Path, say: Callable[[str], None]) -> tuple[Cost, Cost]:
    """Costs of a segment state and of a vehicle's position. Raises RuntimeError: a process ended,
    or the dispatcher did not start.
    """
    return _states(seconds, folder, say), _positions(seconds, folder, say)


def _states(seconds: float, folder: Path, say: Callable[[str], None]) -> Cost:
    watched, settings = watched_grid(folder, _RSUS, _RATES[-1] // _RSUS)
    settings_all = {**settings, **_QUIET, "rsus": watched}
    found = []
    for rate in _RATES:
        say(f"{rate} states a second, {seconds:.0f} s")
        sending = {rsu: names[: rate // _RSUS] for rsu, names in watched.items()}
        told = {"watched": sending, "seconds": seconds}
        found.append(run_load(folder, settings_all, told, ALL_STATES))
    return _slope("segment state", found, ALL_STATES)


def _positions(seconds: float, folder: Path, say: Callable[[str], None]) -> Cost:
    _, settings = watched_grid(folder, 1, 24)
    vehicles = [f"van-{number}" for number in range(_RATES[-1])]
    depot = FLEET["depots"][0]["id"]
    fleet = {**FLEET, "vehicles": [{"id": name, "depot": depot} for name in vehicles]}
    Path(settings["fleet"]).write_text(json.dumps(fleet))
    found = []
    for rate in _RATES:
        say(f"{rate} positions a second, {seconds:.0f} s")
        told = {"vehicles": vehicles[:rate], "segment": "0.0-1.0", "seconds": seconds}
        found.append(run_load(folder, {**settings, **_QUIET}, told, ALL_POSITIONS))
    return _slope("vehicle position", found, ALL_POSITIONS)


def _slope(what: str, found: list[Loaded], subscription: str) -> Cost:
    low, high = found
    rates = [one.sent / one.seconds for one in found]
    between = rates[1] - rates[0]
    taken = [sum(one.after.outcomes(subscription).values()) for one in found]
    return Cost(
        what,
        high.message_bytes,
        (high.dispatcher_share - low.dispatcher_share) / between,
        (high.router_share - low.router_share) / between,
        sum(one.sent for one in found) - sum(taken),
    )
