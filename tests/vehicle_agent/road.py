"""Roads and signal timings for tests of the agent."""

from __future__ import annotations

from slipstream.messages import (
    MovementEvent,
    MovementState,
    PhaseState,
    PlannedCrossing,
    PlannedSegment,
    SegmentState,
    SignalPhaseAndTiming,
)
from vehicle_agent.leg import Leg
from vehicle_agent.signals import SignalTimings

Told = tuple[PhaseState, float, float, float | None]
"""A phase: what shows, begin, earliest end, latest end (None: open), s."""


def crossing(
    *,
    length_m: float = 20.0,
    speed_mps: float = 13.4,
    yields: bool = False,
    groups: tuple[tuple[int, int], ...] = (),
    intersection: str = "signal",
) -> PlannedCrossing:
    """The way through a junction; a signal's where it has groups."""
    return PlannedCrossing(
        length_m=length_m,
        speed_mps=speed_mps,
        yields=yields,
        intersection=intersection if groups else None,
        signal_groups=groups,
    )


def segment(
    name: str, length_m: float, limit_mps: float = 13.4, onward: PlannedCrossing | None = None
) -> PlannedSegment:
    """A planned segment, driven alone."""
    return PlannedSegment(
        segment=name,
        entry_ns=0,
        exit_ns=0,
        speed_mps=limit_mps,
        platoon=None,
        place=None,
        gap_m=None,
        leg=0,
        length_m=length_m,
        speed_limit_mps=limit_mps,
        lanes=1,
        crossing=onward,
    )


def leg(*segments: PlannedSegment) -> Leg:
    """A leg over segments."""
    return Leg(1, 0, segments)


def with_signal(before_m: float = 400.0) -> Leg:
    """A signal's group 3 between two segments: a stop line at 400 m, the end at 1,020 m."""
    return leg(segment("a", before_m, onward=crossing(groups=((0, 3),))), segment("b", 600.0))


def ns(seconds: float) -> int:
    """Seconds as on the wire."""
    return round(seconds * 1e9)


def spat(
    time_s: float, *events: Told, group: int = 3, intersection: str = "signal"
) -> SignalPhaseAndTiming:
    """What an intersection tells of one movement."""
    told = [
        MovementEvent(
            state=state,
            start_ns=ns(begin_s),
            min_end_ns=ns(end_s),
            max_end_ns=None if latest_s is None else ns(latest_s),
        )
        for state, begin_s, end_s, latest_s in events
    ]
    return SignalPhaseAndTiming(
        intersection=intersection,
        revision=0,
        time_ns=ns(time_s),
        movements=(MovementState(signal_group=group, events=tuple(told)),) if told else (),
    )


def course(*greens: tuple[float, float]) -> list[Told]:
    """Fixed greens with three seconds of yellow and red between them."""
    events: list[Told] = []
    red_s = 0.0
    for begin_s, end_s in greens:
        if begin_s > red_s:
            events.append(("stop-And-Remain", red_s, begin_s, begin_s))
        events.append(("protected-Movement-Allowed", begin_s, end_s, end_s))
        events.append(("protected-clearance", end_s, end_s + 3, end_s + 3))
        red_s = end_s + 3
    events.append(("stop-And-Remain", red_s, red_s + 1000, red_s + 1000))
    return events


def timings(*messages: SignalPhaseAndTiming) -> SignalTimings:
    """What was heard."""
    found = SignalTimings()
    for message in messages:
        found.receive(message)
    return found


def state(segment_id: str, time_s: float, y_e: int | None = 1) -> SegmentState:
    """What an RSU says of a segment without vehicles."""
    return SegmentState(
        rsu="r",
        segment=segment_id,
        sequence=0,
        time_ns=ns(time_s),
        window_s=10.0,
        features=None,
        y_e=y_e,
        reason=None if y_e is not None else "no_frames",
        vehicles=0,
        frames=1,
        coverage=1.0,
    )
