"""`python -m slipstream_lab.benchmarks.capacity`: the tables of docs/capacity.md, from measured
unit costs.

Every coefficient names the command that measures it; nothing else is assumed but what
`PlannedLoad` says.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final


@dataclass(frozen=True)
class Coefficient:
    """What one unit of load takes."""

    what: str
    value: float
    unit: str
    command: str


FRAME: Final = Coefficient(
    "a picture of 1280×720 at the edge, all of its way", 0.01646, "core s", "make bench-perception"
)
EDGE_MB: Final = Coefficient("an edge daemon, resident", 385, "MB", "make bench-perception")
ADVICE: Final = Coefficient("an advice, bus included", 0.74e-3, "core s", "make bench-agents")
STATE_DISPATCHER: Final = Coefficient(
    "a segment state in the dispatcher", 44e-6, "core s", "make bench-service"
)
STATE_ROUTER: Final = Coefficient(
    "a segment state in one router", 14e-6, "core s", "make bench-service"
)
STATE_BYTES: Final = Coefficient("a segment state on the wire", 623, "bytes", "make bench-service")
POSITION_DISPATCHER: Final = Coefficient(
    "a vehicle's position in the dispatcher", 17e-6, "core s", "make bench-service"
)
POSITION_ROUTER: Final = Coefficient(
    "a vehicle's position in one router", 14e-6, "core s", "make bench-service"
)
POSITION_BYTES: Final = Coefficient(
    "a vehicle's position on the wire", 166, "bytes", "make bench-service"
)
CYCLE: Final = Coefficient(
    "a cycle, for each vehicle with five stops", 0.51, "core s", "make bench-routing"
)
STORE: Final = Coefficient(
    "storing a cycle and its minutes, for each 1,000 segments (PostgreSQL)",
    0.304,
    "s",
    "make bench-storage",
)
DISK: Final = Coefficient(
    "30 days kept, for each 1,000 segments (SQLite)", 1.46, "GB", "make bench-storage"
)

COEFFICIENTS: Final = (
    *(FRAME, EDGE_MB, ADVICE, STATE_DISPATCHER, STATE_ROUTER, STATE_BYTES),
    *(POSITION_DISPATCHER, POSITION_ROUTER, POSITION_BYTES, CYCLE, STORE, DISK),
)

MESSAGE_SHARE: Final = 0.5
"""Of one core for messages in one dispatcher: what they wait for is one interpreter lock, which its
cycles hold too."""
VEHICLES_A_DISPATCHER: Final = 2000
"""The largest fleet of which a cycle was measured."""
SEGMENTS_A_DISPATCHER: Final = 10_000
"""The most that were measured at a state a second each."""
ADVICE_HZ: Final = 10


@dataclass(frozen=True)
class PlannedLoad:
    """What is to be carried.

    Attributes:
        rsus: cameras, of 30 pictures a second and a state a second for each segment.
        vehicles: of the fleet; each reports once a second.
    """

    name: str
    rsus: int
    segments: int
    vehicles: int
    on_road: float = 0.5
    interval_s: float = 300.0
    hops: int = 2


LOADS: Final = (
    PlannedLoad("one machine", 2, 4, 50, hops=1),
    PlannedLoad("two sites", 60, 4, 500),
    PlannedLoad("10,000 RSUs", 10_000, 4, 100_000),
)


def needs(load: PlannedLoad) -> dict[str, str]:
    """What a load takes, by its line in the table."""
    states = load.rsus * load.segments
    positions = load.vehicles
    router = load.hops * (states * STATE_ROUTER.value + positions * POSITION_ROUTER.value)
    messages = states * STATE_DISPATCHER.value + positions * POSITION_DISPATCHER.value
    cycles = load.vehicles * CYCLE.value / load.interval_s
    dispatchers = max(
        1,
        ceil(messages / MESSAGE_SHARE),
        ceil(states / SEGMENTS_A_DISPATCHER),
        ceil(load.vehicles / VEHICLES_A_DISPATCHER),
    )
    wire = states * STATE_BYTES.value + positions * POSITION_BYTES.value
    edge = load.rsus * 30 * FRAME.value
    agents = load.vehicles * load.on_road * ADVICE_HZ * ADVICE.value
    busy = STORE.value * states / 1000 / load.interval_s
    return {
        "segment states a second": f"{states:,}",
        "positions a second": f"{positions:,}",
        "cores at the cameras": _cores(edge),
        "cores for the vehicles' agents": _cores(agents),
        "into the dispatchers, Mbit/s": f"{8e-6 * wire:,.1f}",
        "cores of routers": _cores(router),
        "dispatchers": f"{dispatchers:,}",
        "cores of dispatchers, messages": _cores(messages),
        "cores of dispatchers and workers, cycles": _cores(cycles),
        "database busy, of one writer": f"{100 * busy:.1f} %",
        "database, 30 days, GB": f"{DISK.value * states / 1000:,.1f}",
    }


def tables() -> str:
    """Both tables as Markdown."""
    lines = ["| unit | takes | measured by |", "|---|--:|---|"]
    lines += [f"| {c.what} | {_value(c)} | `{c.command}` |" for c in COEFFICIENTS]
    columns = [needs(load) for load in LOADS]
    lines += ["", f"| | {' | '.join(load.name for load in LOADS)} |", "|---|--:|--:|--:|"]
    lines += [f"| RSUs | {' | '.join(f'{load.rsus:,}' for load in LOADS)} |"]
    lines += [f"| vehicles | {' | '.join(f'{load.vehicles:,}' for load in LOADS)} |"]
    lines += [f"| {line} | {' | '.join(c[line] for c in columns)} |" for line in columns[0]]
    return "\n".join(lines) + "\n"


def _value(coefficient: Coefficient) -> str:
    value, unit = coefficient.value, coefficient.unit
    if unit == "core s" and value < 0.1:
        return f"{1e6 * value:,.0f} core µs" if value < 1e-3 else f"{1e3 * value:.1f} core ms"
    return f"{value:,g} {unit}"


def _cores(value: float) -> str:
    return f"{value:,.2f}" if value < 10 else f"{value:,.0f}"


if __name__ == "__main__":
    print(tables(), end="")
