"""Rewards that an answer counts for platoons that do not form on the road.

The arc form predicts that a vehicle leaves a stop as early as any way there allows, and asks only
who enters a segment when; on the road a platoon must also leave it together, in its order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dispatcher_daemon.planning.roads import Route, RoutedArc
    from slipstream_lab.research.instances.forms import Attempt, Form


@dataclass(frozen=True)
class Missed:
    """Rewards of an answer without a platoon on the road."""

    kwh: float
    segments: tuple[tuple[str, str], ...]

    def line(self) -> str:
        """For people."""
        where = "; ".join(f"{segment}: {reason}" for segment, reason in self.segments)
        return f"rewards of {self.kwh:.5f} kWh are counted, no platoon comes about: {where}"


def missed_rewards(form: Form, tried: Attempt, window_s: float) -> Missed | None:
    """The rewards of a valid arc-form answer whose timetable makes no platoon at all."""
    selected, plan = tried.outcome.selected, tried.candidate
    if form.name != "arc" or plan is None or selected is None or plan.platooned_m > 0:
        return None
    counted = [
        pair
        for pair in form.judged
        if pair.saving_kwh > 0 and pair.first in selected and pair.second in selected
    ]
    if not counted:
        return None
    reasons = []
    for pair in counted:
        first, second = (
            _passage(plan.routes, form.arcs[index], pair.segment)
            for index in (pair.first, pair.second)
        )
        reasons.append((pair.segment, _reason(first, second, window_s)))
    return Missed(sum(pair.saving_kwh for pair in counted), tuple(dict.fromkeys(reasons)))


def _reason(first: tuple[float, float], second: tuple[float, float], window_s: float) -> str:
    """Why two passages (entry, exit), s, are no platoon; see `form_platoons`."""
    from dispatcher_daemon.planning.platooning import apart_at_the_end

    entries, leavings = first[0] - second[0], first[1] - second[1]
    if abs(entries) > window_s:
        return f"by the timetable entries are {abs(entries):.1f} s apart, more than {window_s:g} s"
    return apart_at_the_end(entries, leavings, window_s) or "they form none"


def _passage(routes: tuple[Route, ...], arc: RoutedArc, segment: str) -> tuple[float, float]:
    """Entry and exit of an arc's segment by the timetable, s."""
    (route,) = [route for route in routes if route.vehicle == arc.vehicle]
    ends = [(leg.start, leg.end) for leg in route.legs]
    number = ends.index((arc.leg.start, arc.leg.end))
    return next(
        (entry, leaving)
        for leg, _, name, entry, leaving in route.entries_s()
        if leg == number and name == segment
    )
