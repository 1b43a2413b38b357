"""Freshness of messages, and the decisive one where several RSUs watch a segment.

The dispatcher opens gates by this rule and publishes its limits in `DispatcherHealth`. The
dashboard shows traffic by the same rule and limits.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Generic, Literal, Protocol, TypeVar

STALE_AFTER_S: Final = 5.0
"""Default age limit of a SegmentState."""
FUTURE_TOLERANCE_S: Final = 1.0
"""Default of how far ahead of the receiver's clock a message may be dated."""
COUNTS_FRESH_S: Final = 1200.0
"""Counts are shown for so long after their quarter hour: until the next one has surely come."""

Fault = Literal["stale", "future"]

_SEVERITY: Final[dict[int | None, int]] = {None: 0, 1: 1, 0: 2}


class Judged(Protocol):
    """What a state is judged by: a SegmentState, or what is kept of one."""

    @property
    def rsu(self) -> str: ...  # noqa: D102

    @property
    def time_ns(self) -> int: ...  # noqa: D102

    @property
    def y_e(self) -> Literal[0, 1] | None: ...  # noqa: D102

    @property
    def features(self) -> object: ...  # noqa: D102


_S = TypeVar("_S", bound=Judged)


@dataclass(frozen=True)
class Decisive(Generic[_S]):
    """The state that a segment is judged by.

    Attributes:
        state: the state.
        age_s: its age; negative where it is dated ahead.
        fault: why it counts for nothing all the same; None where it counts.
    """

    state: _S
    age_s: float
    fault: Fault | None


def age_s(time_ns: int, now_ns: int) -> float:
    """Age at ``now_ns`` of what is dated ``time_ns`` (both UTC), s."""
    return (now_ns - time_ns) / 1e9


def is_ahead(time_ns: int, now_ns: int, tolerance_s: float = FUTURE_TOLERANCE_S) -> bool:
    """True where a date is further ahead than clocks may differ: one of the two is wrong."""
    return age_s(time_ns, now_ns) < -tolerance_s


def fault(
    time_ns: int,
    now_ns: int,
    *,
    stale_after_s: float = STALE_AFTER_S,
    future_tolerance_s: float = FUTURE_TOLERANCE_S,
) -> Fault | None:
    """Why a message of ``time_ns`` counts for nothing at ``now_ns``; None where it counts.

    One that is dated ahead counts no more than an old one: a sender whose clock is ahead cannot
    be told from one that has stopped.
    """
    if is_ahead(time_ns, now_ns, future_tolerance_s):
        return "future"
    return "stale" if age_s(time_ns, now_ns) > stale_after_s else None


def decisive(
    states: Iterable[_S],
    now_ns: int,
    *,
    stale_after_s: float = STALE_AFTER_S,
    future_tolerance_s: float = FUTURE_TOLERANCE_S,
) -> Decisive[_S] | None:
    """The state that counts among those of one segment: turbulent before stable before unknown.

    Of several that say the same, one with features goes first, then the latest, then the one of
    the last RSU by name. Where none is fresh it is the latest, with its fault.

    Args:
        states: the latest state of each RSU that watches the segment.
        now_ns: UTC.
        stale_after_s: age limit.
        future_tolerance_s: see `is_ahead`.

    Returns:
        None where there are no states.
    """
    judged = [
        Decisive(
            state,
            age_s(state.time_ns, now_ns),
            fault(
                state.time_ns,
                now_ns,
                stale_after_s=stale_after_s,
                future_tolerance_s=future_tolerance_s,
            ),
        )
        for state in states
    ]
    return judged[0] if len(judged) == 1 else max(judged, key=_weight, default=None)


def _weight(judged: Decisive[_S]) -> tuple[object, ...]:
    state = judged.state
    if judged.fault is not None:
        return (False, 0, False, state.time_ns, state.rsu)
    return (True, _SEVERITY[state.y_e], state.features is not None, state.time_ns, state.rsu)
