"""Everything that the tables, figures and the report of an evaluation are made from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.measures.compare import (
    Compared,
    SeedSpread,
    compare,
    sound,
)
from slipstream_lab.simulation.evaluation.measures.figures import Measures, measure
from slipstream_lab.simulation.evaluation.runs import ArmStore, Provenance, StoredArm
from slipstream_lab.simulation.fleet.safety import OthersSafety


@dataclass(frozen=True)
class Headline:
    """What an arm saves for each order, at equal travel time, on the same orders. `saving`: share
    of what the baseline needs; None: nothing may be quoted.
    """

    saving: SeedSpread | None
    orders: int
    seeds: tuple[int, ...]
    missing: Mapping[int, str]


@dataclass(frozen=True)
class Evaluation:
    """The arms that are there, in the order of the tables."""

    provenance: Provenance
    seeds: tuple[int, ...]
    arms: Mapping[str, Mapping[int, StoredArm]]
    runs: Mapping[str, Mapping[int, Measures]]
    compared: Mapping[str, Mapping[int, Compared]]
    apart: Mapping[str, Mapping[int, str]]

    def __contains__(self, name: object) -> bool:
        """Whether there is a sound arm of that name."""
        return any(not found.faults for found in self.runs.get(str(name), {}).values())

    def results(self, name: str) -> dict[int, ArmResult]:
        """The sound arms of a name, by seed."""
        stored = self.arms.get(name, {})
        return {seed: stored[seed].result for seed in sound(self.runs).get(name, {})}

    def figure(self, name: str, of: Callable[[Measures], float | None]) -> SeedSpread | None:
        """A figure of an arm over the seeds in which it is sound."""
        return _spread(of(found) for found in sound(self.runs).get(name, {}).values())

    def against(self, name: str, of: Callable[[Compared], float | None]) -> SeedSpread | None:
        """A figure of an arm against the baseline over the seeds in which both are sound."""
        return _spread(of(found) for found in self.compared.get(name, {}).values())

    def headline(self, name: str) -> Headline:
        """The saving of an arm that may be quoted, or why there is none."""
        compared = self.compared.get(name, {})
        equal = {s: c.at_equal_time for s, c in compared.items() if c.at_equal_time is not None}
        missing = dict(self.apart.get(name, {}))
        missing |= {seed: c.unequal for seed, c in compared.items() if seed not in equal}
        orders = sum(self.runs[name][seed].served for seed in equal)
        return Headline(_spread(equal.values()), orders, tuple(equal), missing)

    @property
    def codes(self) -> list[str]:
        """What simulated them; more than one where the code changed in between."""
        return sorted({arm.code for of_seed in self.arms.values() for arm in of_seed.values()})

    @property
    def refused(self) -> tuple[tuple[str, int, tuple[str, ...]], ...]:
        """Arms whose figures do not count: name, seed and why."""
        return tuple(
            (name, seed, found.faults)
            for name, of_seed in self.runs.items()
            for seed, found in of_seed.items()
            if found.faults
        )

    @property
    def doubtful(self) -> tuple[tuple[str, int, OthersSafety], ...]:
        """Arms in which too many of the others were teleported: name, seed and what happened."""
        return tuple(
            (name, seed, found.others_safety)
            for name, of_seed in self.runs.items()
            for seed, found in of_seed.items()
            if found.others_safety.is_doubtful
        )


def collect(store: ArmStore, provenance: Provenance, seeds: Iterable[int]) -> Evaluation:
    """Everything in the store of these seeds, whether it was asked for this time or earlier.
    Raises InputError: a file is damaged, or of another evaluation.
    """
    ordered = tuple(sorted(seeds))
    arms = {
        name: {seed: arm for seed in ordered if (arm := store.get(policy, seed)) is not None}
        for name, policy in POLICIES.items()
    }
    arms = {name: of_seed for name, of_seed in arms.items() if of_seed}
    law = provenance.vehicle_type.drafting
    runs = {
        name: {seed: measure(arm.result, law) for seed, arm in of_seed.items()}
        for name, of_seed in arms.items()
    }
    found = compare(runs)
    return Evaluation(provenance, ordered, arms, runs, found.compared, found.apart)


def _spread(values: Iterable[float | None]) -> SeedSpread | None:
    return SeedSpread.over([value for value in values if value is not None])
