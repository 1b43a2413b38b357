"""Where a platoon is close on a segment: the share of it on which each of its vehicles saves.

**Closing up.** Vehicles that start together enter the road T apart (`ENTRY_HEADWAY_S`), and behind
a segment with a closed gate they have drivers' gaps. With g* the wanted gap, at a speed v each gap
is too large by

    a = v T − g*         from rest, or from where two ways meet
    b = g_driver − g*    from a closed gate on

The leader waits: it is slower by u = 0.15 v, and changes its speed by c, 0.9 of coasting. Gaps that
are too large by E in all are closed in t = E/u + u/c, or in t = 2 √(E/c) where it does not get to u
(E < u²/c), and on x(E) = v t of the follower's way. With k gaps ahead of the k-th follower, its own
included, and z_a and z_b the open road since they were a and b, it is close from

    max(x(k a) − z_a, x(k b) − z_b, 0)

on. What is not closed at a segment's end is carried over in z. Gaps that had come about before its
own did are not among the k of a: they are closed.

**Signals.** A vehicle stops before a junction with a chance p, its expected stops there. Two that
come over the same segment, T apart, are parted by a signal if its green ends between them, once in
a cycle C: the chance is T/C, but p at most, as the rear one stops then, and follows a red of C/2
later, T + C/2 instead of T behind. With the rest of p both stop and start from rest again. Phases
that two find at signals on different ways are independent: where these ways meet, they are T apart
with the chance that none of both has stopped, Π (1 − p), and else T + C/4, a stop's mean wait.

A platoon saves, at each place, the ideal saving times this share; the leader that of its first
follower.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from slipstream.energy.traction import coasting_mps2
from slipstream.spacing import (
    ENTRY_HEADWAY_S,
    MAX_SLOWDOWN,
    SLOWING_SHARE,
    driver_gap_m,
    planned_gap_m,
)
from slipstream.vehicle_types import RoutingProfile

SIGNAL_CYCLE_S: Final = 90.0
"""C: what netconvert gives signals, within what is usual on roads."""
_RED_S: Final = SIGNAL_CYCLE_S / 2
_MEAN_WAIT_S: Final = _RED_S / 2
_UNLIKELY: Final = 1e-3
"""Chances that are not followed up."""


def closing_way_m(open_m: float, speed_mps: float, coasting: float) -> float:
    """x(E): see the module, m.

    Args:
        open_m: E, by how much the gaps ahead are too large in all, m.
        speed_mps: v > 0.
        coasting: the leader's deceleration without traction and brake, m/s², > 0.
    """
    if open_m <= 0:
        return 0.0
    slower_mps, slowing = MAX_SLOWDOWN * speed_mps, SLOWING_SHARE * coasting
    if open_m >= slower_mps**2 / slowing:
        return speed_mps * (open_m / slower_mps + slower_mps / slowing)
    return speed_mps * 2 * math.sqrt(open_m / slowing)


class Together(NamedTuple):
    """What two vehicles that come to a segment together have behind them, in one possible course.

    Attributes:
        headway_s: by how much they were apart when their gap began to close.
        since_rest_m: z_a, open road since then.
        since_gate_m: z_b, open road since the last closed gate; inf: none.
    """

    chance: float
    headway_s: float
    since_rest_m: float
    since_gate_m: float


Courses = tuple[Together, ...]
"""Possible courses of two vehicles; in the first one nothing has stopped them."""
STARTING: Final[Courses] = (Together(1.0, ENTRY_HEADWAY_S, 0.0, math.inf),)
CLOSE: Final[Courses] = (Together(1.0, ENTRY_HEADWAY_S, math.inf, math.inf),)


def meeting(unstopped: float) -> Courses:
    """Courses of two whose ways meet.

    Args:
        unstopped: chance that no signal has stopped one of both.
    """
    (together,) = STARTING
    late = together._replace(chance=1 - unstopped, headway_s=ENTRY_HEADWAY_S + _MEAN_WAIT_S)
    return together._replace(chance=unstopped), *((late,) if late.chance > _UNLIKELY else ())


def onward(
    courses: Sequence[Together], open_m: float | None, stops: float, *, at_signal: bool
) -> Courses:
    """Courses of two vehicles that have driven over a segment.

    Args:
        open_m: its length; None: its gate is closed.
    """
    if open_m is None:
        after = [c._replace(since_gate_m=0.0) for c in courses]
    else:
        after = [
            c._replace(since_rest_m=c.since_rest_m + open_m, since_gate_m=c.since_gate_m + open_m)
            for c in courses
        ]
    if stops < _UNLIKELY:
        return tuple(after)
    whole = sum(c.chance for c in after)
    parted = min(ENTRY_HEADWAY_S / SIGNAL_CYCLE_S, stops) if at_signal else 0.0
    going = [c._replace(chance=(1 - stops) * c.chance) for c in after]
    (anew,) = STARTING
    stopped = (
        anew._replace(chance=(stops - parted) * whole),
        anew._replace(chance=parted * whole, headway_s=ENTRY_HEADWAY_S + _RED_S),
    )
    return going[0], *(c for c in (*going[1:], *stopped) if c.chance > _UNLIKELY)


class SegmentGaps(NamedTuple):
    """The quantities of one segment that the law needs.

    Attributes:
        length_m: its length.
        speed_mps: v.
        coasting: at v, m/s².
        wanted_m: g*.
    """

    length_m: float
    speed_mps: float
    coasting: float
    wanted_m: float

    @classmethod
    def of(
        cls, length_m: float, speed_mps: float, profile: RoutingProfile, advised_gap_m: float
    ) -> SegmentGaps:
        """Of a segment on which a type of vehicle drives at a speed."""
        wanted_m = planned_gap_m(speed_mps, advised_gap_m, profile.braking)
        return cls(length_m, speed_mps, coasting_mps2(speed_mps, profile.physics), wanted_m)

    def close_share(self, gaps: int, all_gaps: int, behind: Together) -> float:
        """Share of the segment on which a follower is close in one course.

        Args:
            gaps: k, those ahead that came about with its own, or later.
            all_gaps: its place, the gaps ahead that a closed gate opened.
        """

        def too_large_m(gap_m: float) -> float:
            return max(0.0, gap_m - self.wanted_m)

        v, entry_m = self.speed_mps, too_large_m(ENTRY_HEADWAY_S * self.speed_mps)
        own_m = too_large_m(behind.headway_s * v)
        gates_m = all_gaps * too_large_m(driver_gap_m(v))
        rest_m = closing_way_m(own_m + (gaps - 1) * entry_m, v, self.coasting)
        gate_m = closing_way_m(gates_m, v, self.coasting)
        open_m = max(rest_m - behind.since_rest_m, gate_m - behind.since_gate_m, 0.0)
        return max(0.0, 1 - open_m / self.length_m)

    def shares(self, pairs: Sequence[tuple[float, Courses]]) -> tuple[float, ...]:
        """Share of the segment on which each place of a platoon saves, in [0, 1].

        Args:
            pairs: of each follower and who is ahead: their way together, m, and its courses.
        """
        followers = []
        for number, (way_m, (unstopped, *stopped)) in enumerate(pairs, 1):
            as_new = sum(other_m <= way_m for other_m, _ in pairs[:number])
            share = unstopped.chance * self.close_share(as_new, number, unstopped)
            share += sum(c.chance * self.close_share(number, number, c) for c in stopped)
            followers.append(share)
        return (followers[0], *followers)
