"""Arms against the baseline of the same seed, and what comes of it over the seeds.

Arms compare where they did the same work to its end: they served the same orders, and everybody is
at home. A saving that may be quoted is also at equal travel time, by interpolation between paces of
the baseline that did the same work. Where that is not so, there is a reason instead of a figure.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean, stdev
from typing import Final

from slipstream.energy.consumption import Saving, split_saving
from slipstream_lab.simulation.evaluation.arms import BASELINE, PACES, paced
from slipstream_lab.simulation.evaluation.measures.equal_time import TimeCurve
from slipstream_lab.simulation.evaluation.measures.figures import Measures

Runs = Mapping[str, Mapping[int, Measures]]
"""Measures by arm and seed."""

MIN_ORDERS: Final = 20
"""Served in all compared seeds of an arm together: chance decides on what fewer orders cost."""


@dataclass(frozen=True)
class Compared:
    """One arm of one seed against the baseline of that seed, on the same orders.

    Attributes:
        unequal: why there is no `at_equal_time`; "" where there is.
        parts: the saving by its causes, kWh.
    """

    saving: float
    at_equal_time: float | None
    unequal: str
    parts: Saving
    shares: Saving
    travel: float
    others_s: float


@dataclass(frozen=True)
class ArmComparison:
    """All arms against the baseline."""

    compared: Mapping[str, Mapping[int, Compared]]
    apart: Mapping[str, Mapping[int, str]]


@dataclass(frozen=True)
class SeedSpread:
    """Of one figure over the seeds. `deviation`: the sample's standard deviation; None of a single
    seed.
    """

    mean: float
    deviation: float | None
    count: int

    @classmethod
    def over(cls, values: Sequence[float]) -> SeedSpread | None:
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


def compare(runs: Runs) -> ArmComparison:
    """Every sound arm against the baseline of its seed."""
    fit = sound(runs)
    bases = fit.get(BASELINE, {})
    compared: dict[str, dict[int, Compared]] = {name: {} for name in fit}
    apart: dict[str, dict[int, str]] = {name: {} for name in fit}
    for name, of_seed in fit.items():
        for seed, arm in of_seed.items():
            base = bases.get(seed)
            reason = (
                f"there is no sound {BASELINE}" if base is None else _why_apart(name, base, arm)
            )
            if base is None or reason:
                apart[name][seed] = reason
            else:
                compared[name][seed] = _against(base, arm, fit, seed)
        if few := _too_few(of_seed, compared[name]):
            apart[name] |= dict.fromkeys(compared[name], few)
            compared[name] = {}
        equal = [s for s, found in compared[name].items() if found.at_equal_time is not None]
        if few := _too_few(of_seed, equal):
            for seed in equal:
                found = compared[name][seed]
                compared[name][seed] = replace(found, at_equal_time=None, unequal=few)
    return ArmComparison(compared, apart)


def _too_few(arms: Mapping[int, Measures], seeds: Collection[int]) -> str:
    """Why these seeds of an arm have too few orders together; "" where they have enough."""
    orders = sum(arms[seed].served for seed in seeds)
    if not seeds or orders >= MIN_ORDERS:
        return ""
    return f"too little to compare: {_count(orders, 'order')}, at least {MIN_ORDERS} count"


def _why_apart(name: str, base: Measures, arm: Measures) -> str:
    """Why an arm and the baseline did not do the same work to its end; "" where they did."""
    for who, one in ((BASELINE, base), (name, arm)):
        if one.unfinished:
            return f"{who} ended with {_count(one.unfinished, 'tour')} under way"
    if base.served_orders != arm.served_orders:
        both = len(base.served_orders & arm.served_orders)
        return (
            f"not the same orders: {BASELINE} served {base.served}, {name} {arm.served}, "
            f"{both} of them the same"
        )
    return ""


def time_curve(fit: Runs, seed: int) -> TimeCurve | str:
    """Energy over travel time of one seed's baselines that did the same work, both per order; or
    why there is none.
    """
    base = fit[BASELINE][seed]
    others = [of_seed[seed] for pace in PACES if seed in (of_seed := fit.get(paced(pace), {}))]
    if not others:
        return f"no pace of {BASELINE} was simulated beside it (--arms main has them)"
    found = [base, *(arm for arm in others if not _why_apart("", base, arm))]
    times = [arm.per_order_s for arm in found]
    if len(set(times)) < 2:
        return f"no other pace of {BASELINE} served the same orders"
    return TimeCurve(times, [arm.per_order_kwh for arm in found])


def _against(base: Measures, arm: Measures, fit: Runs, seed: int) -> Compared:
    curve = time_curve(fit, seed)
    equal: float | None = None
    unequal = ""
    if isinstance(curve, str):
        unequal = curve
    else:
        needed_kwh = curve.at(arm.per_order_s)
        if needed_kwh is None:
            unequal = (
                f"{arm.per_order_s:.0f} s of travel an order, and {BASELINE} was simulated from "
                f"{curve.fastest:.0f} to {curve.slowest:.0f} s"
            )
        else:
            equal = 1 - arm.per_order_kwh / needed_kwh
    parts = split_saving(base.alone, arm.alone, arm.driven)
    return Compared(
        saving=1 - arm.energy_kwh / base.energy_kwh,
        at_equal_time=equal,
        unequal=unequal,
        parts=parts,
        shares=Saving(*(part / base.energy_kwh for part in parts)),
        travel=arm.travel_h / base.travel_h - 1,
        others_s=arm.others.duration_s - base.others.duration_s,
    )


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
