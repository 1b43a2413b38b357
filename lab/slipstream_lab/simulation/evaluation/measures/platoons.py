"""Why an arm that may platoon drove in no platoon: the first thing that its run lacked for one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from typing import Final

from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.measures.evaluation import Evaluation
from slipstream_lab.simulation.fleet.drafting import CAUSES
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg

_NONE_M: Final = 50.0
"""Below it a report has 0.0 km."""


def no_platoons(evaluation: Evaluation) -> dict[str, dict[int, str]]:
    """Reasons by arm and seed, of the arms with the lever that drove in no platoon in any seed."""
    found = {}
    for name, of_seed in evaluation.runs.items():
        results = evaluation.results(name)
        driven_m = sum(1000 * of_seed[seed].platooned_km for seed in results)
        if results and "platoons" in POLICIES[name].levers and driven_m < _NONE_M:
            found[name] = {seed: why_no_platoon(result) for seed, result in results.items()}
    return found


def why_no_platoon(arm: ArmResult) -> str:
    """The first condition of a platoon that an arm's run did not meet, in words."""
    vehicles, watched = {leg.vehicle for leg in arm.legs}, set(arm.watched)
    if len(vehicles) < 2:
        return f"fewer than two vehicles drove ({len(vehicles)})"
    if not watched:
        return "no segment is watched by an RSU"
    users: dict[str, list[DrivenLeg]] = defaultdict(list)
    for leg in arm.legs:
        for segment in watched.intersection(leg.path):
            users[segment].append(leg)
    if not users:
        return f"no route has one of the {len(watched)} watched segments"
    shared = {name for name, legs in users.items() if len({leg.vehicle for leg in legs}) > 1}
    if not shared:
        return (
            f"no two vehicles' routes share a watched segment ({len(users)} of {len(watched)} are "
            "on a route)"
        )
    opened = shared.intersection(arm.opened)
    if not opened:
        return f"the gates of the {len(shared)} watched segments that vehicles share never open"
    apart_s = min(_apart_s(users[segment]) for segment in opened)
    if apart_s > 0:
        return (
            f"those who share one of the {len(opened)} segments with a gate that opens are never "
            f"on the road together ({apart_s / 60:.1f} min apart at best)"
        )
    if not any(cycle.planned_platooned_m > 0 for cycle in arm.cycles):
        return (
            f"no plan has two vehicles together on one of the {len(opened)} segments that they "
            "share and whose gate opens"
        )
    return f"platoons were planned and did not form: {_missed(arm.legs)}"


def _apart_s(legs: Sequence[DrivenLeg]) -> float:
    """Least time between legs of two vehicles; 0 where they are on the road at once."""
    return min(
        max(0.0, a.departed_s - b.arrived_s, b.departed_s - a.arrived_s)
        for a, b in combinations(legs, 2)
        if a.vehicle != b.vehicle
    )


def _missed(legs: Sequence[DrivenLeg]) -> str:
    """Planned distance that was driven outside a platoon, by cause, the most first."""
    by_cause = {cause: sum(leg.missed_m.get(cause, 0.0) for leg in legs) for cause in CAUSES}
    ordered = sorted(by_cause.items(), key=lambda item: -item[1])
    said = ", ".join(f"{cause} {m / 1000:.1f} km" for cause, m in ordered if m > 0)
    return said or "their plans were replaced before"
