"""Figures and refused platoons in words."""

from __future__ import annotations

from collections.abc import Sequence

from slipstream.explain.facts import RefusedPlatoon


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
