"""How much of all drafting an arm's legs could have at best if only those near each other met.

That every kilometre is drafted takes somebody to follow everywhere. Here the legs stay as they were
driven, and all who come to a segment within some time of each other are one platoon on it: one
leads, the others follow, whatever its gate says and however they would have come together.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Final

from slipstream.energy.drafting import DragLaw, greatest_reduction, reductions_at
from slipstream_lab.simulation.evaluation.arms import COOPERATIVE, EVERY_LEVER, only
from slipstream_lab.simulation.evaluation.measures import Evaluation, SeedSpread
from slipstream_lab.simulation.evaluation.report.cells import MEANS, arm_files
from slipstream_lab.simulation.evaluation.report.formatting import ReportTable, percent
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg

_ARMS: Final = (only("platoons"), COOPERATIVE, EVERY_LEVER)
_WITHIN_MIN: Final = (1, 10, 30)


def proximity_table(evaluation: Evaluation, lengths_m: Mapping[str, float]) -> ReportTable | None:
    """What arms with platoons drafted, beside what those near each other could have; None where
    there is no such arm.
    """
    rows, names, law = [], [], evaluation.provenance.vehicle_type.drafting
    most = greatest_reduction(law)
    for name in _ARMS:
        fit = [arm.legs for arm in evaluation.results(name).values() if arm.legs]
        if not fit:
            continue
        bound = [most * sum(leg.alone.drag_kwh for leg in legs) for legs in fit]
        saved = [sum(leg.alone.total_kwh - leg.driven.total_kwh for leg in legs) for legs in fit]
        near = [
            [proximity_kwh(legs, lengths_m, 60.0 * minutes, law) for legs in fit]
            for minutes in _WITHIN_MIN
        ]
        names.append(name)
        rows.append(
            (
                name,
                *(
                    percent(SeedSpread.over([k / m for k, m in zip(kwh, bound, strict=True)]))
                    for kwh in (saved, *near)
                ),
            )
        )
    if not rows:
        return None
    return ReportTable(
        "Drafting, as a share of every kilometre drafted",
        ("arm", "driven", *(f"all within {minutes} min together" for minutes in _WITHIN_MIN)),
        tuple(rows),
        f"{arm_files(evaluation, names)}, by `simulation.evaluation.report.proximity`",
        (
            f"{MEANS} On each arm's own legs. Together: all who come to a segment within that time "
            "of the first one are a platoon there, gates and the way to each other left out.",
        ),
    )


def proximity_kwh(
    legs: Sequence[DrivenLeg], lengths_m: Mapping[str, float], within_s: float, law: DragLaw
) -> float:
    """Energy that drafting saves if all who are near each other on a segment are one platoon, kWh.

    A leg's drag and time are taken as even along its way.
    """
    passages: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for leg in legs:
        whole_m = sum(lengths_m[segment] for segment in leg.path)
        driven_m = 0.0
        for segment in leg.path:
            at_s = leg.departed_s + (leg.arrived_s - leg.departed_s) * driven_m / whole_m
            drag_kwh = leg.alone.drag_kwh * lengths_m[segment] / whole_m
            passages[segment].append((at_s, drag_kwh))
            driven_m += lengths_m[segment]
    return sum(
        _platoon_kwh(drags, law)
        for on_segment in passages.values()
        for drags in _platoons(sorted(on_segment), within_s)
    )


def _platoons(passages: Sequence[tuple[float, float]], within_s: float) -> list[list[float]]:
    """Drag of those in each platoon; passages in the order of time."""
    found: list[list[float]] = []
    first_s = 0.0
    for at_s, drag_kwh in passages:
        if not found or at_s - first_s > within_s:
            found.append([])
            first_s = at_s
        found[-1].append(drag_kwh)
    return found


def _platoon_kwh(drags_kwh: Sequence[float], law: DragLaw) -> float:
    """The one with the least drag leads; followers of more save together as those of pairs."""
    if len(drags_kwh) < 2:
        return 0.0
    leads, close = min(drags_kwh), reductions_at(law, 0.0)
    return close.leader * leads + close.follower * (sum(drags_kwh) - leads)
