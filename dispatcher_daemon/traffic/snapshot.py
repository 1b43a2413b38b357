"""Traffic by segment: freshness, gates.

A gate is open only with a fresh SegmentState of y_e = 1 and no fresh one of y_e = 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from types import MappingProxyType
from typing import Literal

from dispatcher_daemon.settings import DispatcherSettings
from slipstream import freshness
from slipstream.messages import Gate, SegmentState
from slipstream.roads import RoadNetwork, Segment

MIN_SPEED_MPS = 1.0
"""Lower bound of the planning speed, so that travel times in a queue are finite."""
_TO_MM = 3
"""Digits of ages and speeds: ms and mm/s."""
_DIGITS = 4
"""Digits of accelerations and their variances. What is measured is less certain by far, and a
cycle's traffic is stored with it in a fifth of the room that all digits take.
"""
PERSISTENCE_S = 60.0
"""After this time what a flag says beyond the usual share of its hour has fallen to 1/e."""


@dataclass(frozen=True)
class GateForecast:
    """Whether a gate is open now, and what is expected of it later.

    Attributes:
        usual_share: share of the RSUs' states at this hour of the day that opened it; None: not
            known, or nobody watches now: it is expected to stay as it is.
    """

    open: bool
    usual_share: float | None = None

    @property
    def may_be_open(self) -> bool:
        """Whether there is a chance that it is open at some time."""
        return self.open or bool(self.usual_share)

    def chance(self, after_s: float) -> float:
        """Chance that it will be open: as it is now at first, as it usually is later on.

        Args:
            after_s: the moment, s after that of the snapshot.
        """
        now = 1.0 if self.open else 0.0
        if self.usual_share is None:
            return now
        kept = math.exp(-max(0.0, after_s) / PERSISTENCE_S)
        return self.usual_share + (now - self.usual_share) * kept


@dataclass(frozen=True)
class SegmentTraffic:
    """What one cycle assumes about one segment.

    Attributes:
        speed_mps: planning speed: measured mean where fresh, free flow otherwise, within
            [`MIN_SPEED_MPS`, speed limit].
        y_e: the flag that the gate was judged by; None: unknown, or no state counts.
        open: True if close gaps are allowed.
        reason: code of why the gate is closed: the state's own where its flag is unknown, else
            "turbulent", "stale", "future" or "unwatched"; None if it is open.
        age_s: age of the state it was judged by; None if there is none.
        measured_speed_mps: mean speed in that state, m/s.
        mean_acceleration_mps2: ā of the traffic there, 0 where not measured.
        acceleration_variance_m2ps4: σ²_a of the traffic there, 0 where not measured.
        stops: expected number of full stops on the segment, ≥ 0; 0 where nothing is known.
        usual_share: see `GateForecast`; None: not known.
    """

    segment: str
    speed_mps: float
    y_e: Literal[0, 1] | None = None
    open: bool = False
    reason: str | None = "unwatched"
    age_s: float | None = None
    measured_speed_mps: float | None = None
    mean_acceleration_mps2: float = 0.0
    acceleration_variance_m2ps4: float = 0.0
    stops: float = 0.0
    usual_share: float | None = None

    @property
    def watched(self) -> bool:
        """Whether a state of it is fresh, whatever it says."""
        return self.age_s is not None and self.reason not in ("stale", "future")

    def as_message(self) -> Gate:
        """Its gate as reports tell it; its parts were checked with the state that they are from."""
        return Gate.model_construct(
            segment=self.segment,
            y_e=self.y_e,
            reason=self.reason,
            age_s=self.age_s,
            speed_mps=self.measured_speed_mps,
            open=self.open,
        )

    @property
    def gate(self) -> GateForecast:
        """What is expected of its gate."""
        return GateForecast(self.open, self.usual_share if self.watched else None)


Movement = tuple[str, str]
"""A segment and the next segment."""


@dataclass(frozen=True)
class Expectations:
    """Observed costs of movements, from entering a segment to entering the next one.

    Attributes:
        loss_kwh: dissipated energy by movement, > 0: rolling resistance, drag and braking, but not
            the change of kinetic energy. So braking for a turn counts at the turn. A path from rest
            to rest needs the sum of its movements' losses and of those of its last segment, the
            last braking included.
        seconds: time by movement, s, > 0; the time to regain speed counts where it was lost.
        stops: number of full stops by movement, ≥ 0.
    """

    loss_kwh: Mapping[Movement, float]
    seconds: Mapping[Movement, float]
    stops: Mapping[Movement, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TrafficSnapshot:
    """The traffic on every segment of the network at one moment.

    Attributes:
        segments: traffic of each segment of the network, by id.
        states: the SegmentStates that it is based on, in (segment, rsu) order.
        expected: expected costs of movements at this hour; None: not known.
    """

    now_ns: int
    segments: Mapping[str, SegmentTraffic]
    states: tuple[SegmentState, ...]
    expected: Expectations | None = None

    def chance_of_stop(self, segment: str, onto: str) -> float:
        """Chance of a stand before the next segment: its expected stops there, 1 at most."""
        stops = self.segments[segment].stops
        if self.expected is not None:
            stops = self.expected.stops.get((segment, onto), stops)
        return min(1.0, stops)

    def at_usual_speeds(self, usual_mps: Mapping[str, float]) -> TrafficSnapshot:
        """The same with these planning speeds of segments where none is measured."""
        slowed = {
            name: replace(traffic, speed_mps=usual_mps[name])
            for name, traffic in self.segments.items()
            if name in usual_mps and traffic.measured_speed_mps is None
        }
        return replace(self, segments=MappingProxyType({**self.segments, **slowed}))

    def with_usual_gates(self, shares: Mapping[str, float]) -> TrafficSnapshot:
        """The same with these usual shares of the states that open a gate, by segment."""
        known = {
            name: replace(traffic, usual_share=shares[name])
            for name, traffic in self.segments.items()
            if name in shares
        }
        return replace(self, segments=MappingProxyType({**self.segments, **known}))

    def gates(self) -> tuple[Gate, ...]:
        """Gates of all segments that an RSU has ever reported on, by id."""
        watched = sorted({state.segment for state in self.states})
        return tuple(self.segments[name].as_message() for name in watched)


def take_snapshot(
    network: RoadNetwork,
    states: Iterable[SegmentState],
    now_ns: int,
    *,
    stale_after_s: float,
    stops_at_signals: float = 0.0,
) -> TrafficSnapshot:
    """Judge the latest states at one moment; same input, same snapshot.

    Where several RSUs watch a segment, `slipstream.freshness.decisive` says which one counts.
    States of segments outside the network are left out.

    Args:
        states: at most the latest state of each (segment, rsu).
        stops_at_signals: expected full stops of a passage of a segment that ends at traffic lights.
    """
    known = sorted(
        (s for s in states if s.segment in network.segments), key=attrgetter("segment", "rsu")
    )
    by_segment: dict[str, list[SegmentState]] = {}
    for state in known:
        by_segment.setdefault(state.segment, []).append(state)
    traffic = {}
    for name, segment in network.segments.items():
        seen = by_segment.get(name, [])
        judged = judge(segment, seen, now_ns, stale_after_s)
        at_signals = segment.end in network.signals and stops_at_signals > 0
        traffic[name] = replace(judged, stops=stops_at_signals) if at_signals else judged
    return TrafficSnapshot(now_ns, MappingProxyType(traffic), tuple(known))


def traffic_by(
    settings: DispatcherSettings, network: RoadNetwork, states: Iterable[SegmentState], now_ns: int
) -> TrafficSnapshot:
    """The traffic at one moment as a dispatcher's settings judge it."""
    return take_snapshot(
        network,
        states,
        now_ns,
        stale_after_s=settings.stale_after_s,
        stops_at_signals=settings.stops_at_signals,
    )


def judge(
    segment: Segment, states: Sequence[SegmentState], now_ns: int, stale_after_s: float
) -> SegmentTraffic:
    """One segment's traffic by its latest states, in the digits that are stored with a cycle."""
    decisive = freshness.decisive(states, now_ns, stale_after_s=stale_after_s)
    if decisive is None:
        return SegmentTraffic(segment.id, segment.speed_limit_mps)
    age_s = round(max(0.0, decisive.age_s), _TO_MM)
    if decisive.fault is not None:
        return SegmentTraffic(
            segment.id, segment.speed_limit_mps, reason=decisive.fault, age_s=age_s
        )
    state = decisive.state
    reason = state.reason if state.y_e is None else "turbulent"
    is_open = state.y_e == 1
    features = state.features
    measured, acceleration, variance = None, 0.0, 0.0
    if features is not None:
        measured = round(max(0.0, features.mean_speed_mps.value), _TO_MM)
        acceleration = round(features.mean_acceleration_mps2.value, _DIGITS)
        variance = round(max(0.0, features.acceleration_variance_m2ps4.value), _DIGITS)
    return SegmentTraffic(
        segment=segment.id,
        speed_mps=planning_speed_mps(segment, measured),
        y_e=state.y_e,
        open=is_open,
        reason=None if is_open else reason,
        age_s=age_s,
        measured_speed_mps=measured,
        mean_acceleration_mps2=acceleration,
        acceleration_variance_m2ps4=variance,
    )


def planning_speed_mps(segment: Segment, measured_mps: float | None) -> float:
    """The speed that a segment is planned with by what was measured there, and nothing else."""
    limit = segment.speed_limit_mps
    return limit if measured_mps is None else min(limit, max(MIN_SPEED_MPS, measured_mps))
