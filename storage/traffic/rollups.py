"""Roll-ups of segment states: counts, shares of flags, mean and extremes of each feature. Pure."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from slipstream.messages import SegmentState
from storage.traffic.models import FEATURES

MINUTE_S: Final = 60
HOUR_S: Final = 3600
LATE_S: Final = 10.0
"""A minute is stored this long after its end, s; states that come later are merged into it."""
MAX_MINUTES: Final = 60
"""Minutes kept in memory while the database cannot be written; older ones are dropped."""


class Spread(NamedTuple):
    """Mean and extremes of a quantity."""

    mean: float
    min: float
    max: float


@dataclass(frozen=True)
class RollUp:
    """What all RSUs reported of a segment in one minute or hour.

    Attributes:
        segment: its id.
        period_s: 60 or 3600.
        began_ns: UTC of its begin, a multiple of the period.
        count: number of states whose windows ended in it.
        stable: those with y_e = 1.
        turbulent: those with y_e = 0; the other ones are unknown.
        measured: those with features.
        gaps: those with a mean gap.
        vehicles_mean: mean number of vehicles with a usable track.
        vehicles_max: largest one.
        features: by name as in KinematicFeatures; one that was never measured is missing.
    """

    segment: str
    period_s: int
    began_ns: int
    count: int
    stable: int
    turbulent: int
    measured: int
    gaps: int
    vehicles_mean: float
    vehicles_max: int
    features: Mapping[str, Spread]

    @property
    def stable_share(self) -> float:
        """Share of the states with y_e = 1."""
        return self.stable / self.count

    @property
    def turbulent_share(self) -> float:
        """Share of the states with y_e = 0."""
        return self.turbulent / self.count

    def samples(self, feature: str) -> int:
        """Number of states that a feature's mean is of."""
        return self.gaps if feature == "mean_gap_m" else self.measured


def begin(time_ns: int, period_s: int) -> int:
    """Begin of the period that a moment lies in, UTC ns."""
    period_ns = period_s * 1_000_000_000
    return time_ns // period_ns * period_ns


def merge(parts: Sequence[RollUp]) -> RollUp:
    """The roll-up of all states of several ones of the same segment and period; at least one."""
    first = parts[0]
    if len(parts) == 1:
        return first
    count = sum(part.count for part in parts)
    features = {}
    for name in FEATURES:
        seen = [
            (part.samples(name), part.features[name]) for part in parts if name in part.features
        ]
        if seen:
            samples = sum(number for number, _ in seen)
            features[name] = Spread(
                sum(number * spread.mean for number, spread in seen) / samples,
                min(spread.min for _, spread in seen),
                max(spread.max for _, spread in seen),
            )
    return RollUp(
        segment=first.segment,
        period_s=first.period_s,
        began_ns=first.began_ns,
        count=count,
        stable=sum(part.stable for part in parts),
        turbulent=sum(part.turbulent for part in parts),
        measured=sum(part.measured for part in parts),
        gaps=sum(part.gaps for part in parts),
        vehicles_mean=sum(part.count * part.vehicles_mean for part in parts) / count,
        vehicles_max=max(part.vehicles_max for part in parts),
        features=features,
    )


def merged(rollups: Iterable[RollUp]) -> list[RollUp]:
    """Roll-ups with those of the same segment and period merged, in the order of their keys."""
    groups: dict[tuple[int, int, str], list[RollUp]] = {}
    for part in rollups:
        groups.setdefault((part.period_s, part.began_ns, part.segment), []).append(part)
    return [merge(groups[key]) for key in sorted(groups)]


class RollUpBuffer:
    """Minutes that are not stored yet: states come in on one thread, minutes go out on another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._minutes: dict[int, dict[str, list[float]]] = {}
        self._returned: list[RollUp] = []

    def add(self, state: SegmentState) -> None:
        """Count one state in. Of more than `MAX_MINUTES` minutes the oldest is dropped."""
        features = state.features
        values = [] if features is None else [getattr(features, name) for name in FEATURES]
        began_ns = begin(state.time_ns, MINUTE_S)
        with self._lock:
            if began_ns not in self._minutes and len(self._minutes) >= MAX_MINUTES:
                oldest_ns = min(self._minutes)
                if began_ns < oldest_ns:
                    return
                del self._minutes[oldest_ns]
            minute = self._minutes.setdefault(began_ns, {})
            sums = minute.get(state.segment)
            if sums is None:
                sums = minute[state.segment] = [0.0] * 7 + [0.0, _INF, -_INF] * len(FEATURES)
            sums[0] += 1
            sums[1] += state.y_e == 1
            sums[2] += state.y_e == 0
            sums[5] += state.vehicles
            if state.vehicles > sums[6]:
                sums[6] = state.vehicles
            if not values:
                return
            sums[3] += 1
            sums[4] += values[_GAP] is not None
            place = 7
            for estimate in values:
                if estimate is not None:
                    value = estimate.value
                    sums[place] += value
                    if value < sums[place + 1]:
                        sums[place + 1] = value
                    if value > sums[place + 2]:
                        sums[place + 2] = value
                place += 3

    def take(self, now_ns: int | None = None) -> list[RollUp]:
        """Take out the minutes that ended `LATE_S` before ``now_ns``, UTC; None: all minutes."""
        with self._lock:
            returned, self._returned = self._returned, []
            ended = [
                began_ns
                for began_ns in self._minutes
                if now_ns is None or began_ns + (MINUTE_S + LATE_S) * 1e9 <= now_ns
            ]
            taken = [(began_ns, self._minutes.pop(began_ns)) for began_ns in sorted(ended)]
        return returned + [
            _rollup(segment, began_ns, sums)
            for began_ns, minute in taken
            for segment, sums in minute.items()
        ]

    def give_back(self, rollups: Sequence[RollUp]) -> int:
        """Keep what could not be stored for the next `take`; returns how many are too many.

        The latest `MAX_MINUTES` minutes are kept.
        """
        if not rollups:
            return 0
        oldest_ns = max(part.began_ns for part in rollups) - MAX_MINUTES * MINUTE_S * 1_000_000_000
        kept = [part for part in rollups if part.began_ns > oldest_ns]
        with self._lock:
            self._returned = kept + self._returned
        return len(rollups) - len(kept)


_INF: Final = float("inf")
_GAP: Final = FEATURES.index("mean_gap_m")


def _rollup(segment: str, began_ns: int, sums: list[float]) -> RollUp:
    """The roll-up of sums: count, stable, turbulent, measured, gaps, sum and largest of vehicles,
    then sum, least and largest of each feature.
    """
    count, stable, turbulent, measured, gaps = (int(number) for number in sums[:5])
    features = {}
    for place, name in enumerate(FEATURES):
        total, least, largest = sums[7 + 3 * place : 10 + 3 * place]
        samples = gaps if place == _GAP else measured
        if samples:
            features[name] = Spread(total / samples, least, largest)
    return RollUp(
        segment=segment,
        period_s=MINUTE_S,
        began_ns=began_ns,
        count=count,
        stable=stable,
        turbulent=turbulent,
        measured=measured,
        gaps=gaps,
        vehicles_mean=sums[5] / count,
        vehicles_max=int(sums[6]),
        features=features,
    )
