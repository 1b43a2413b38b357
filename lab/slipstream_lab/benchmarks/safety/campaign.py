"""Many stops over the declared envelope, and a search for the worst one."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Final

from slipstream.braking import BRAKING, HARDEST_MPS2, BrakingClass, Road
from slipstream.spacing import ADVISED_GAP_M, longest_string
from slipstream_lab.benchmarks.safety.stop import BRAKES_S, Case, Fault, FaultKind, Outcome, drive

_CLASSES: Final[tuple[tuple[BrakingClass, ...], ...]] = (
    ("car",),
    ("van",),
    ("truck",),
    ("brake_by_wire",),
    ("car", "van"),
)
"""Of which platoons are drawn; trucks drive among themselves."""

_CHUNK: Final = 20


def drawn(number: int, kind: str) -> Case:
    """A case of the envelope: docs/safety.md.

    Args:
        number: seed.
        kind: "none", or what fails: "agent", "router", "sensor"; "calm": nobody brakes, one sample
            of the sensing in twenty is lost, and one message in twenty.
    """
    rng = random.Random(f"{kind}/{number}")
    group = rng.choice(_CLASSES)
    road: Road = rng.choice(("dry", "dry", "wet"))
    longest = min(longest_string(ADVISED_GAP_M, BRAKING[name].on(road)) for name in group)
    count = rng.randint(2, longest)
    hardest = HARDEST_MPS2[road]
    fault = None
    calm = kind == "calm"
    if kind not in ("none", "calm"):
        of_kind: FaultKind = kind  # type: ignore[assignment]
        fault = Fault(of_kind, BRAKES_S + rng.uniform(-1.5, 2.0), rng.randrange(count))
    speed_mps = 22.2 if group == ("truck",) else rng.choice((13.9, 20.0, 22.2, 25.0, 30.0))
    to_mps = 0.0 if rng.random() < 0.8 else rng.uniform(0.0, 10.0)
    return Case(
        speed_mps=speed_mps,
        classes=tuple(rng.choice(group) for _ in range(count)),
        road=road,
        seed=number,
        traffic_mps2=rng.uniform(2.0, hardest) if rng.random() < 0.5 else hardest,
        to_mps=speed_mps if calm else to_mps,
        loss=0.05 if calm else rng.choice((0.0, 0.05, 0.05)),
        latency_s=rng.uniform(0.005, 0.06),
        unsensed=0.05 if calm else rng.choice((0.0, 0.0, 0.05)),
        fault=fault,
    )


@dataclass
class Tally:
    """Of the cases of one kind.

    Attributes:
        collisions: cases in which members touched, with the impact in m/s, the hardest first.
        traffic: cases in which the leader touched the traffic.
        least_m: smallest gap of a follower that was in a close gap.
        worst: case of it.
        hardest_mps2: lowest acceleration of a member.
        broken: cases without a fault in which the leader braked harder than it had promised.
    """

    stops: int = 0
    followers: int = 0
    members: int = 0
    collisions: list[tuple[float, Case]] = field(default_factory=list)
    traffic: list[Case] = field(default_factory=list)
    least_m: float = float("inf")
    worst: Case | None = None
    gap_sum_m: float = 0.0
    hardest_mps2: float = 0.0
    broken: int = 0

    def add(self, case: Case, outcome: Outcome) -> None:
        """Count one."""
        self.stops += 1
        self.followers += outcome.followers
        self.members += len(case.classes) - 1
        self.gap_sum_m += sum(outcome.gaps_m)
        if min(outcome.least_m) < self.least_m:
            self.least_m, self.worst = min(outcome.least_m), case
        self.hardest_mps2 = min(self.hardest_mps2, *outcome.hardest_mps2)
        if outcome.impact_mps > 0:
            self.collisions = sorted([*self.collisions, (outcome.impact_mps, case)], key=_impact)
        if outcome.traffic_m <= 0:
            self.traffic.append(case)
        promised = outcome.promised_mps2
        self.broken += promised is not None and -outcome.hardest_mps2[0] > promised * 1.001


def _impact(found: tuple[float, Case]) -> float:
    return -found[0]


def _drive_all(cases: Sequence[Case]) -> list[Outcome]:
    return [drive(case) for case in cases]


def _chunks(cases: Iterable[Case]) -> Iterator[list[Case]]:
    every = iter(cases)
    while chunk := list(islice(every, _CHUNK)):
        yield chunk


def run(kind: str, stops: int, executor: Executor, progress: Callable[[int], None]) -> Tally:
    """Drive drawn cases of a kind."""
    tally = Tally()
    chunks = list(_chunks(drawn(number, kind) for number in range(stops)))
    for chunk, outcomes in zip(chunks, executor.map(_drive_all, chunks), strict=True):
        for case, outcome in zip(chunk, outcomes, strict=True):
            tally.add(case, outcome)
        progress(len(chunk))
    return tally


def worst_of(
    case: Case | None, generations: int, offspring: int, executor: Executor
) -> tuple[float, Case]:
    """The smallest gap that an evolutionary search finds from a case, the worst of those drawn: of
    each generation's mutants the worst one is the next parent (a (1 + λ) strategy).
    """
    assert case is not None
    rng = random.Random(case.seed)
    parent, least_m = case, min(drive(case).least_m)
    for _ in range(generations):
        mutants = [_mutant(parent, rng) for _ in range(offspring)]
        chunks = [[mutant] for mutant in mutants]
        for mutant, (outcome,) in zip(mutants, executor.map(_drive_all, chunks), strict=True):
            gap_m = min(outcome.least_m)
            if gap_m < least_m:
                parent, least_m = mutant, gap_m
    return least_m, parent


def _mutant(case: Case, rng: random.Random) -> Case:
    hardest = HARDEST_MPS2[case.road]
    fault = case.fault
    if fault is not None:
        fault = replace(
            fault,
            at_s=fault.at_s + rng.gauss(0, 0.2),
            vehicle=rng.randrange(len(case.classes)) if rng.random() < 0.2 else fault.vehicle,
        )
    return replace(
        case,
        speed_mps=min(30.0, max(10.0, case.speed_mps + rng.gauss(0, 2.0))),
        seed=rng.randrange(2**31) if rng.random() < 0.5 else case.seed,
        traffic_mps2=min(hardest, max(1.0, case.traffic_mps2 + rng.gauss(0, 1.0))),
        latency_s=min(0.06, max(0.005, case.latency_s + rng.gauss(0, 0.01))),
        corner=min(1.0, max(0.0, case.corner + rng.gauss(0, 0.3))),
        fault=fault,
    )
