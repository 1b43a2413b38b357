"""Arms against the baseline of the same seed, and what comes of it over the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from simulation.evaluation.arms import BASELINE, PACES, paced
from simulation.evaluation.measures.equal_time import EqualTime, TimeCurve
from simulation.evaluation.measures.figures import Measures
from slipstream.energy import Saving, split_saving

Runs = Mapping[str, Mapping[int, Measures]]
"""Measures by arm and seed."""


@dataclass(frozen=True)
class Compared:
    """One arm of one seed against the baseline of that seed.

    Attributes:
        saving: share of the baseline's energy.
        per_order: the same of energies per served order.
        at_equal_time: share of what the baseline would have needed per served order in the same
            travel time; None without a paced baseline.
        extrapolated: beyond which end of the baseline's paces its travel time lies, or "".
        parts: the saving by its causes, kWh.
        shares: the same as shares of the baseline's energy.
        travel: longer travel time than the baseline, share.
        others_s: longer trips of the background, s each.
        same_orders: whether both served as many orders.
    """

    saving: float
    per_order: float
    at_equal_time: float | None
    extrapolated: str
    parts: Saving
    shares: Saving
    travel: float
    others_s: float
    same_orders: bool


@dataclass(frozen=True)
class Spread:
    """Of one figure over the seeds.

    Attributes:
        mean: of all.
        deviation: the sample's standard deviation; None of a single seed.
        count: seeds.
    """

    mean: float
    deviation: float | None
    count: int

    @classmethod
    def over(cls, values: Sequence[float]) -> Spread | None:
        """Of these values; None of nothing."""
        if not values:
            return None
        return cls(fmean(values), stdev(values) if len(values) > 1 else None, len(values))


def sound(runs: Runs) -> dict[str, dict[int, Measures]]:
    """Without the arms that are refused."""
    return {
        name: {seed: found for seed, found in of_seed.items() if not found.faults}
        for name, of_seed in runs.items()
    }


def compare(runs: Runs) -> dict[str, dict[int, Compared]]:
    """Every sound arm against the sound baseline of its seed; seeds without one are left out."""
    fit = sound(runs)
    compared: dict[str, dict[int, Compared]] = {name: {} for name in fit}
    for seed, base in fit.get(BASELINE, {}).items():
        curve = time_curve(fit, seed)
        for name, of_seed in fit.items():
            if seed in of_seed:
                compared[name][seed] = _against(base, of_seed[seed], curve)
    return compared


def time_curve(fit: Runs, seed: int) -> TimeCurve | None:
    """Energy over travel time of one seed's baselines, both per served order; None of one."""
    found = [
        of_seed[seed]
        for name in (BASELINE, *map(paced, PACES))
        if seed in (of_seed := fit.get(name, {}))
    ]
    times = [arm.travel_h / arm.served for arm in found]
    if len(set(times)) < 2:
        return None
    return TimeCurve(times, [arm.energy_kwh / arm.served for arm in found])


def _against(base: Measures, arm: Measures, curve: TimeCurve | None) -> Compared:
    equal: EqualTime | None = None
    if curve is not None:
        equal = curve.at(arm.travel_h / arm.served)
    parts = split_saving(base.alone, arm.alone, arm.driven)
    return Compared(
        saving=1 - arm.energy_kwh / base.energy_kwh,
        per_order=1 - _per_order(arm) / _per_order(base),
        at_equal_time=None if equal is None else 1 - _per_order(arm) / equal.energy,
        extrapolated="" if equal is None else equal.extrapolated,
        parts=parts,
        shares=Saving(*(part / base.energy_kwh for part in parts)),
        travel=arm.travel_h / base.travel_h - 1,
        others_s=arm.others.duration_s - base.others.duration_s,
        same_orders=arm.served == base.served,
    )


def _per_order(arm: Measures) -> float:
    """kWh for each served order; a sound arm served some."""
    return arm.energy_kwh / arm.served
