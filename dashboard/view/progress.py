"""What one vehicle does now, by what it reports or else by its plan; pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

from slipstream.freshness import age_s
from slipstream.messages import PlannedStop, SilentVehicle, VehiclePlan, VehiclePosition

VehicleState = Literal[
    "driving", "stopped", "waiting", "depot", "idle", "expired", "planned", "silent"
]
Source = Literal["reported", "last", "planned"]

STOPPED_BELOW_MPS: Final = 0.5
"""A vehicle on its road that is slower has stopped, m/s."""
DELAY_STEP_S: Final = 10.0
"""Delays are told in steps of so much, s: what is shown changes no more often."""


@dataclass(frozen=True)
class Progress:
    """What a vehicle does now.

    Attributes:
        state: in one word; `planned` of one that nobody has heard: its plan is all that is known;
            `silent` of one that was heard, and is not now.
        text: in some more; without times, which run.
        source: of its place: it reports it, it reported it last, or its plan puts it there.
        part: number of the plan's segment that it is on; None: on none, or not known.
        position: (segment, share of it driven); None: not known.
        stop: number of the stop that it drives to next; None: there is none.
        delay_s: behind its plan, below 0 ahead, in steps of `DELAY_STEP_S`; None: not known.
        at: number of the stop that it reports to stand at; None: at none, or not known.
        on_road: whether it reports to be on its way, or is so by the plan that alone is known.
    """

    state: VehicleState
    text: str
    source: Source
    part: int | None = None
    position: tuple[str, float] | None = None
    stop: int | None = None
    delay_s: float | None = None
    at: int | None = None
    on_road: bool = False

    @property
    def reported(self) -> bool:
        """Whether the vehicle itself tells it now."""
        return self.source == "reported"

    def eta_ns(self, plan: VehiclePlan) -> int | None:
        """UTC of its arrival at the next stop; None where there is none."""
        if self.stop is None:
            return None
        late_s = max(0.0, self.delay_s or 0.0)
        return plan.stops[self.stop].arrival_ns + round(late_s * 1e9)


def idle(text: str = "has no plan", position: VehiclePosition | None = None) -> Progress:
    """Of a vehicle without a plan to follow."""
    place = None if position is None else (position.segment, position.share)
    return Progress("idle", text, "planned" if position is None else "reported", position=place)


def planned(plan: VehiclePlan, now_ns: int) -> Progress:
    """Of a vehicle of which its plan alone is known: where that puts it."""
    part, position = planned_part(plan, now_ns)
    following = _stop_after(plan, now_ns)
    if now_ns > plan.valid_until_ns:
        return Progress("expired", "its plan has run out", "planned", part, position)
    text, on_road = _driving(plan, following), True
    if now_ns < plan.depart_ns:
        text, on_road = "waits to leave", False
    elif not plan.segments or now_ns >= plan.segments[-1].exit_ns:
        text, on_road, part = "is back", False, None
    for stop in plan.stops:
        if max(stop.arrival_ns, plan.depart_ns) <= now_ns < stop.departure_ns:
            text, on_road = _standing(stop, now_ns), False
    text = f"by plan: {text}"
    return Progress("planned", text, "planned", part, position, following, on_road=on_road)


def not_taken(plan: VehiclePlan, position: VehiclePosition, now_ns: int) -> Progress:
    """Of a vehicle that is heard, and says that it follows no plan, though it has one."""
    late_s = _in_steps(max(0.0, age_s(plan.depart_ns, now_ns)))
    state: VehicleState = "depot"
    if position.on_road:
        state = "driving" if position.speed_mps >= STOPPED_BELOW_MPS else "stopped"
    text = f"has not taken its plan of cycle #{plan.cycle}"
    place = position.segment, position.share
    following = 1 if len(plan.stops) > 1 else None
    return Progress(state, text, "reported", None, place, following, late_s)


def silent(plan: VehiclePlan, position: VehiclePosition) -> Progress:
    """Of a vehicle that is not heard any more: what it told last."""
    if position.cycle is None:
        text = "has not taken its plan" if plan.stops or plan.segments else "had no plan"
        place = position.segment, position.share
        following = 1 if len(plan.stops) > 1 else None
        return Progress("silent", f"last: {text}", "last", None, place, following)
    last = reported(plan, position, position.time_ns)
    text = f"last: {last.text}" if plan.stops else "last: it followed a plan"
    return replace(last, state="silent", text=text, source="last", delay_s=None, on_road=False)


def reported(plan: VehiclePlan, position: VehiclePosition, now_ns: int) -> Progress:
    """Of a vehicle that reports its position on a plan."""
    leg = position.leg or 0
    place = position.segment, position.share
    part = _reported_part(plan, position)
    following = leg + 1 if leg + 1 < len(plan.stops) else None
    if position.on_road:
        moves = position.speed_mps >= STOPPED_BELOW_MPS
        text = _driving(plan, following)
        delay_s = None if part is None else _delay_on_road_s(plan, part, position)
        state: VehicleState = "driving" if moves else "stopped"
        return Progress(
            state,
            text if moves else f"stands, {text}",
            "reported",
            part,
            place,
            following,
            delay_s,
            on_road=True,
        )
    if 0 < leg < len(plan.stops):
        stop = plan.stops[leg]
        late_s = _in_steps(max(0.0, age_s(stop.departure_ns, now_ns)))
        text = _standing(stop, now_ns)
        return Progress("waiting", text, "reported", part, place, following, late_s, at=leg)
    late_s = _in_steps(max(0.0, age_s(plan.depart_ns, now_ns)))
    text = "waits to leave" if now_ns < plan.depart_ns else "leaves now"
    return Progress("depot", text, "reported", part, place, following, late_s)


def missed(plan: VehiclePlan, told: SilentVehicle) -> Progress:
    """Of a vehicle that only the dispatcher has heard, before it fell silent."""
    place = None
    if told.segment is not None and told.share is not None:
        place = told.segment, told.share
    following = 1 if len(plan.stops) > 1 else None
    return Progress("silent", "last: as the dispatcher heard it", "last", None, place, following)


def planned_part(plan: VehiclePlan, now_ns: int) -> tuple[int | None, tuple[str, float] | None]:
    """Number of the segment that it is planned to be on, and (segment, share driven)."""
    last: tuple[int | None, tuple[str, float] | None] = None, None
    for number, part in enumerate(plan.segments):
        if now_ns < part.entry_ns:
            return last if number else (0, (part.segment, 0.0))
        if now_ns < part.exit_ns:
            share = (now_ns - part.entry_ns) / (part.exit_ns - part.entry_ns)
            return number, (part.segment, share)
        last = number, (part.segment, 1.0)
    return last


def _reported_part(plan: VehiclePlan, position: VehiclePosition) -> int | None:
    found = None
    for number, part in enumerate(plan.segments):
        if part.segment == position.segment:
            if part.leg == position.leg:
                return number
            found = number
    return found


def _delay_on_road_s(plan: VehiclePlan, part: int, position: VehiclePosition) -> float:
    planned_part = plan.segments[part]
    driven_ns = position.share * (planned_part.exit_ns - planned_part.entry_ns)
    return _in_steps(age_s(planned_part.entry_ns + round(driven_ns), position.time_ns))


def _in_steps(seconds: float) -> float:
    return DELAY_STEP_S * round(seconds / DELAY_STEP_S)


def _stop_after(plan: VehiclePlan, now_ns: int) -> int | None:
    """Number of the first stop that is reached later; the first of all is where it begins."""
    for number, stop in enumerate(plan.stops):
        if stop.arrival_ns > max(now_ns, plan.depart_ns):
            return number
    return None


def _driving(plan: VehiclePlan, following: int | None) -> str:
    if following is None or following == len(plan.stops) - 1 > 0:
        return "drives back"
    return f"drives to {plan.stops[following].stop}"


def _standing(stop: PlannedStop, now_ns: int) -> str:
    if stop.charged_kwh > 0:
        return f"charges at {stop.stop}"
    waits = stop.departure_ns - round(stop.wait_s * 1e9) <= now_ns < stop.departure_ns
    return f"waits at {stop.stop}" if waits else f"at {stop.stop}"
