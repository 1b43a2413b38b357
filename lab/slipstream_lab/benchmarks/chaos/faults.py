"""Kinds of faults, and a seeded order of many; no I/O."""

from __future__ import annotations

import itertools
import random
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from slipstream_lab.benchmarks.chaos.camera import NOTICED_S

T = TypeVar("T")

ROUTER, DISPATCHER, DASHBOARD, AGENTS = "router", "dispatcher", "dashboard", "agents"
RSUS: Final = ("rsu-east", "rsu-west")
DAEMONS: Final = (ROUTER, *RSUS, DISPATCHER, AGENTS, DASHBOARD)
CLIENTS: Final = DAEMONS[1:]
ON_CABLES: Final = ("rsu-east", AGENTS, DASHBOARD)
"""Where there are network namespaces; the others are on proxies."""
ON_PROXIES: Final = ("rsu-west", DISPATCHER)
WITH_FAKED_CLOCKS: Final = ("rsu-west",)
"""Where a machine is busy, libfaketime ends Python's `time.sleep` with EINVAL. The thread that has
the dispatcher's workers would die of it, and the one that receives the agents' messages."""
RECOVERY_S: Final = 5.0
PARTITION_RECOVERY_S: Final = 15.0


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        targets: daemons, in the order that they are hit.
        hold_s: from its begin to its end.
        value: what else it takes: s of delay, share of loss, s that a clock is set by, the way in
            which a camera fails.
    """

    kind: str
    targets: tuple[str, ...]
    hold_s: float = 0.0
    value: float | str | None = None

    @property
    def recovery_s(self) -> float:
        """Within how long after its end all has to be well."""
        return PARTITION_RECOVERY_S if self.kind == "partition" else RECOVERY_S

    def __str__(self) -> str:
        more = "" if self.value is None else f" {self.value}"
        held = f", {self.hold_s:.1f} s" if self.hold_s else ""
        return f"{self.kind}{more} of {', '.join(self.targets)}{held}"


SHARES: Final = {
    "kill": 48,
    "stop": 24,
    "partition": 30,
    "delay": 14,
    "loss": 14,
    "full disk": 8,
    "read-only disk": 8,
    "clock": 18,
    "camera": 24,
    "restart": 12,
}
"""Of 200."""
_CLOCK_STEPS_S: Final = (-3600.0, -60.0, -2.0, 2.0, 60.0, 3600.0)
_RESTARTED: Final = (ROUTER, DISPATCHER, "rsu-east")


def deck(number: int, seed: int, without: Collection[str] = ()) -> list[Fault]:
    """A number of faults in a seeded order; where there are enough, some of each kind.

    Args:
        without: kinds that this machine cannot have.
    """
    chance = random.Random(seed)
    shares = {kind: share for kind, share in SHARES.items() if kind not in without}
    counts = _apportioned(number, shares)
    faults = [_fault(kind, turn, chance) for kind, count in counts.items() for turn in range(count)]
    chance.shuffle(faults)
    return faults


def _apportioned(number: int, shares: dict[str, int]) -> dict[str, int]:
    """Numbers by kind that add up; one each first."""
    counts = dict.fromkeys(shares, 0)
    for _ in range(number):
        # The kind that is furthest behind its share; of all equal the first.
        counts[max(shares, key=lambda kind: shares[kind] / (counts[kind] + 0.5))] += 1
    behind = [kind for kind, count in counts.items() if count == 0]
    for kind in behind[: max(0, number - len(shares) + len(behind))]:
        counts[max(counts, key=counts.__getitem__)] -= 1
        counts[kind] = 1
    return counts


def _fault(kind: str, turn: int, chance: random.Random) -> Fault:
    """The turn-th of a kind: targets in turn, lengths by chance."""
    if kind == "kill":
        return Fault(kind, (_turn(DAEMONS, turn),))
    if kind == "stop":
        return Fault(kind, (_turn(DAEMONS, turn),), chance.uniform(2.0, 6.0))
    if kind == "partition":
        return Fault(kind, (_turn(CLIENTS, turn),), chance.choice((3.0, 6.0, 12.0)))
    if kind == "delay":
        late_s = round(chance.uniform(0.2, 1.0), 1)
        return Fault(kind, (_turn(ON_PROXIES, turn),), chance.uniform(3.0, 6.0), late_s)
    if kind == "loss":
        share = round(chance.uniform(0.1, 0.4), 2)
        return Fault(kind, (_turn(ON_PROXIES, turn),), chance.uniform(3.0, 6.0), share)
    if kind == "clock":
        by_s = _turn(_CLOCK_STEPS_S, turn // len(WITH_FAKED_CLOCKS))
        return Fault(kind, (_turn(WITH_FAKED_CLOCKS, turn),), chance.uniform(3.0, 5.0), by_s)
    if kind == "camera":
        way = _turn(tuple(NOTICED_S), turn // len(RSUS))
        # Some seconds in which it would be noticed that a stable flag stays.
        return Fault(kind, (_turn(RSUS, turn),), NOTICED_S[way] + chance.uniform(4.0, 6.0), way)
    if kind == "restart":
        return Fault(kind, _turn(tuple(itertools.permutations(_RESTARTED)), turn))
    return Fault(kind, (DISPATCHER,), chance.uniform(3.0, 6.0))


def _turn(choices: Sequence[T], turn: int) -> T:
    return choices[turn % len(choices)]
