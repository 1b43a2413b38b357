"""An evaluation as plain data: CSV of every figure, of the day's course, and a summary."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from statistics import fmean
from typing import Any, Final

from slipstream_lab.simulation.evaluation.arms import BASELINE
from slipstream_lab.simulation.evaluation.measures import (
    Compared,
    Course,
    Evaluation,
    Measures,
    SeedSpread,
    day_course,
    no_platoons,
)
from slipstream_lab.simulation.evaluation.report.cells import mean_s
from slipstream_lab.simulation.fleet.drafting import CAUSES, Cause
from slipstream_lab.simulation.scenarios.acceptance import clock


def _missed_by(cause: Cause) -> Callable[[Measures], float]:
    return lambda m: m.missed_km[cause]


FIGURES: Final[Mapping[str, Callable[[Measures], float | None]]] = {
    "energy_kwh": lambda m: m.energy_kwh,
    "rolling_kwh": lambda m: m.driven.rolling_kwh,
    "drag_kwh": lambda m: m.driven.drag_kwh,
    "acceleration_kwh": lambda m: m.driven.acceleration_kwh,
    "alone_kwh": lambda m: m.alone.total_kwh,
    "lost_braking_to_deliver_kwh": lambda m: m.losses.arrival_kwh,
    "lost_braking_to_a_stand_kwh": lambda m: m.losses.stands_kwh,
    "lost_braking_else_kwh": lambda m: m.losses.slowing_kwh,
    "distance_km": lambda m: m.distance_km,
    "travel_h": lambda m: m.travel_h,
    "driving_h": lambda m: m.driving_h,
    "mean_wait_s": lambda m: mean_s(m.waits_s),
    "mean_wait_at_depot_s": lambda m: mean_s(m.depot_waits_s),
    "mean_wait_at_stops_s": lambda m: mean_s(m.stop_waits_s),
    "longest_wait_s": lambda m: max(m.waits_s, default=None),
    "led_km": lambda m: m.led_km,
    "followed_km": lambda m: m.followed_km,
    "platooned_share": lambda m: m.platooned_share,
    "planned_platooned_km": lambda m: m.planned_platooned_km,
    "planned_drafting_kwh": lambda m: m.planned_drafting_kwh,
    "drafted_kwh": lambda m: m.drafted_kwh,
    "drafting_ceiling_kwh": lambda m: m.ceiling_kwh,
    **{f"missed_by_{cause.replace(' ', '_')}_km": _missed_by(cause) for cause in CAUSES},
    "legs": lambda m: m.legs,
    "stops": lambda m: m.stops,
    "waited_h": lambda m: m.waited_h,
    "orders": lambda m: m.orders,
    "served": lambda m: m.served,
    "late": lambda m: m.late,
    "unfinished": lambda m: m.unfinished,
    "cycles": lambda m: m.cycles,
    "planned_kwh": lambda m: m.planned_kwh,
    "watched": lambda m: m.watched,
    "judged": lambda m: m.judged,
    "open": lambda m: m.open,
    "open_turbulent": lambda m: m.open_turbulent,
    "disengagements": lambda m: m.disengagements,
    "turbulent_s": lambda m: m.turbulent_s,
    "teleports": lambda m: m.teleports,
    "collisions": lambda m: m.collisions,
    "emergency_stops": lambda m: m.emergency_stops,
    "fleet_teleports": lambda m: m.safety.teleports,
    "fleet_collisions": lambda m: m.safety.collisions,
    "fleet_emergency_stops": lambda m: m.safety.emergency_stops,
    "promises_broken": lambda m: m.safety.promises_broken,
    "most_over_promise_mps2": lambda m: m.safety.most_over_mps2,
    "held_back": lambda m: m.safety.held_back,
    "least_gap_m": lambda m: m.safety.least_gap_m,
    "others_trips": lambda m: m.others.trips,
    "others_arrived": lambda m: m.others.arrived,
    "others_duration_s": lambda m: m.others.duration_s,
    "others_time_loss_s": lambda m: m.others.time_loss_s,
    "others_stops": lambda m: m.others.stops,
}
"""Of an arm of a seed."""

AGAINST: Final[Mapping[str, Callable[[Compared], float | None]]] = {
    "saving_at_own_time": lambda c: c.saving,
    "saving_at_equal_time": lambda c: c.at_equal_time,
    "saved_distance_kwh": lambda c: c.parts.distance_kwh,
    "saved_drag_kwh": lambda c: c.parts.drag_kwh,
    "saved_acceleration_kwh": lambda c: c.parts.acceleration_kwh,
    "longer_travel": lambda c: c.travel,
    "others_longer_s": lambda c: c.others_s,
}
"""Of an arm of a seed against the baseline; shares as shares."""


def arms_csv(evaluation: Evaluation) -> str:
    """Every figure of every arm and seed, refused ones included, with its file."""
    rows = []
    for name, of_seed in evaluation.runs.items():
        for seed, found in of_seed.items():
            stored = evaluation.arms[name][seed]
            against = evaluation.compared.get(name, {}).get(seed)
            rows.append(
                {
                    "arm": name,
                    "seed": seed,
                    **{key: of(found) for key, of in FIGURES.items()},
                    **{
                        key: None if against is None else of(against) for key, of in AGAINST.items()
                    },
                    "no_saving": _why_none(evaluation, name).get(seed, ""),
                    "refused": "; ".join(found.faults),
                    "file": stored.file,
                    "sha256": stored.digest,
                    "code": stored.code,
                }
            )
    return _csv(rows)


def course_csv(evaluation: Evaluation, names: Iterable[str], bin_s: float) -> str:
    """Energy and platooned distance in each bin of the day, means over the seeds and the least and
    the most of them."""
    rows = []
    for name in names:
        courses = courses_of(evaluation, name, bin_s)
        done_kwh = done_km = 0.0
        for i, ends_s in enumerate(courses[0].ends_s if courses else ()):
            kwh = [float(c.energy_kwh[i]) for c in courses]
            km = [float(c.platooned_km[i]) for c in courses]
            done_kwh, done_km = done_kwh + fmean(kwh), done_km + fmean(km)
            rows.append(
                {
                    "arm": name,
                    "seeds": len(courses),
                    "until_s": float(ends_s),
                    "until": clock(float(ends_s)),
                    "energy_kwh": fmean(kwh),
                    "energy_least_kwh": min(kwh),
                    "energy_most_kwh": max(kwh),
                    "energy_so_far_kwh": done_kwh,
                    "platooned_km": fmean(km),
                    "platooned_so_far_km": done_km,
                }
            )
    return _csv(rows)


def courses_of(evaluation: Evaluation, name: str, bin_s: float) -> list[Course]:
    """The day's course of an arm, one a sound seed."""
    return [day_course(arm, bin_s) for arm in evaluation.results(name).values()]


def summary(evaluation: Evaluation) -> dict[str, Any]:
    """Means and spreads of all arms, for JSON."""
    return {
        "ground": asdict(evaluation.provenance),
        "seeds": list(evaluation.seeds),
        "code": evaluation.codes,
        "refused": [
            {"arm": name, "seed": seed, "faults": list(faults)}
            for name, seed, faults in evaluation.refused
        ],
        "doubtful": [
            {"arm": name, "seed": seed, **asdict(others)}
            for name, seed, others in evaluation.doubtful
        ],
        "no_platoons": {
            name: {str(seed): why for seed, why in of_seed.items()}
            for name, of_seed in no_platoons(evaluation).items()
        },
        "arms": {
            name: {
                "seeds": [seed for seed, found in of_seed.items() if not found.faults],
                "files": [arm.file for arm in evaluation.arms[name].values()],
                "figures": _spreads({k: evaluation.figure(name, of) for k, of in FIGURES.items()}),
                "against_baseline": _spreads(
                    {k: evaluation.against(name, of) for k, of in AGAINST.items()}
                ),
                "no_saving": {str(s): why for s, why in _why_none(evaluation, name).items()},
            }
            for name, of_seed in evaluation.runs.items()
        },
    }


def _why_none(evaluation: Evaluation, name: str) -> Mapping[int, str]:
    """Why an arm has no saving at equal travel time, by seed; the baseline is not asked."""
    return {} if name == BASELINE else evaluation.headline(name).missing


def _spreads(found: Mapping[str, SeedSpread | None]) -> dict[str, Any]:
    return {
        key: None if of is None else {"mean": of.mean, "deviation": of.deviation}
        for key, of in found.items()
    }


def _csv(rows: Sequence[Mapping[str, object]]) -> str:
    """Floats in full, so that equal bytes are equal figures."""
    if not rows:
        return ""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
