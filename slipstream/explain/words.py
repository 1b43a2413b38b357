"""Figures and refused platoons in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from slipstream.explain.facts import InsertedStop, RefusedPlatoon, TourObstacle

_OBSTACLES: Final[Mapping[TourObstacle, str]] = {
    "carrier": "of another carrier",
    "pinned": "not the vehicle that it is kept for",
    "skill": "without a skill that it needs",
    "capacity": "no room",
    "far": "not tried, as other tours are nearer",
    "late": "late as it is, so that it keeps its plan",
    "loaded": "its first stop is not planned",
    "no_way": "no way there and back",
    "charge": "its battery does not last",
    "window": "too late",
    "shift": "back too late",
    "break": "too late for a break",
}
"""What is said of a tour that has no detail."""


def refusal_line(one: RefusedPlatoon) -> str:
    """Why there is no platoon, in words."""
    first, second = one.vehicles
    on = f"{first} and {second} on {way(one.segments)}"
    if one.reason == "turbulent":
        return f"{on}: traffic there was turbulent; {in_kwh(one.saving_kwh)} if it had been stable"
    if one.reason == "unknown":
        why = (one.detail or "no reason given").replace("_", " ")
        return f"{on}: the traffic there was not known ({why}); {in_kwh(one.saving_kwh)} if stable"
    if one.reason == "apart" and one.detail is not None:
        return f"{on}: there together, but {one.detail}; {in_kwh(one.saving_kwh)}"
    if one.reason == "apart":
        return (
            f"{on}: not together in time, {one.apart_s:.1f} s apart, and their windows and plans "
            f"allow neither to wait; {in_kwh(one.saving_kwh)}"
        )
    change = f"to meet would cost {in_kwh(one.cost_kwh or 0.0)} and save {in_kwh(one.saving_kwh)}"
    if one.saving_kwh < 0:
        change += ", as platoons with others would be lost"
    apart = one.detail or f"{one.apart_s:.1f} s apart"
    if one.reason == "not_worth":
        return f"{on}: not worth it, {apart}: {change}"
    return (
        f"{on}: missed, {apart}: {change}, but no solver came to it, or it would leave a carrier "
        "with less than alone"
    )


def insertion_lines(one: InsertedStop) -> Iterator[str]:
    """Where a stop was put, and why not elsewhere. Tours with the same reason are one line."""
    for tour in one.tours:
        if tour.vehicle == one.vehicle:
            where = _where(one.stop, one.stops)
            cost_kwh = in_kwh(tour.cost_kwh or 0.0)
            yield f"goes to {tour.vehicle}, {where}: the cheapest place, {cost_kwh} more"
    others = [tour for tour in one.tours if tour.vehicle != one.vehicle]
    found = [tour for tour in others if tour.cost_kwh is not None]
    for tour in sorted(found, key=lambda tour: (tour.cost_kwh or 0.0, tour.vehicle)):
        where = _where(one.stop, tour.stops)
        yield f"{tour.vehicle}, {where}: {in_kwh(tour.cost_kwh or 0.0)} more"
    why: dict[str, list[str]] = {}
    for tour in others:
        if tour.obstacle is not None:
            why.setdefault(tour.detail or _OBSTACLES[tour.obstacle], []).append(tour.vehicle)
    for reason, vehicles in why.items():
        yield f"{_names(vehicles)}: {reason}"


def _where(stop: str, stops: Sequence[str]) -> str:
    """The place of a stop in a tour."""
    at = stops.index(stop)
    if len(stops) == 1:
        return "its only stop"
    return f"before {stops[1]}" if at == 0 else f"after {stops[at - 1]}"


def _names(vehicles: Sequence[str]) -> str:
    """Names, of many the first."""
    if len(vehicles) <= 8:
        return ", ".join(vehicles)
    return f"{', '.join(vehicles[:6])} and {len(vehicles) - 6} more"


def way(segments: Sequence[str]) -> str:
    """Segments by name, of many the ends."""
    if len(segments) <= 3:
        return ", ".join(segments)
    return f"{segments[0]} … {segments[-1]} ({len(segments)} segments)"


def in_kwh(value: float) -> str:
    """Energy with its unit."""
    return f"{round(value, 4) + 0.0:.4f} kWh"


def more_or_less(change_kwh: float) -> str:
    """A change of energy."""
    if abs(change_kwh) < 5e-5:
        return "no more and no less"
    return f"{in_kwh(abs(change_kwh))} {'more' if change_kwh > 0 else 'less'}"


def duration(seconds: float) -> str:
    """Minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
