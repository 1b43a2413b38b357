"""What is wrong with RSUs, and which vehicles stand where none should."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final

from dispatcher_daemon.service.alarms.conditions import STARTED_S, Condition
from dispatcher_daemon.traffic import MAX_RSUS, Reception
from slipstream import freshness
from slipstream.errors import InputError
from slipstream.messages import (
    RsuHealth,
    SegmentState,
    StoppedVehicles,
    decode,
    stopped_key,
)
from slipstream.orders import utc
from slipstream.roads import RoadNetwork
from slipstream.roads.admission import refusal

AHEAD_S: Final = 0.5
BEHIND_S: Final = 2.5
"""Arrival less a state's time: above it, its clock is behind, or what it sends is held up, s."""
MISSED_SHARE: Final = 0.1
MISSED_LEAST: Final = 5
"""Of the states of the last `WINDOW_S`: from so many on, and at this share, an RSU's are missed."""
WINDOW_S: Final = 60.0
_STEP_S: Final = 10.0
_NAMED: Final = 10

Receptions = Sequence[tuple[str, Reception]]


class MissedRates:
    """How many of the latest states of each RSU did not come, by counts that only grow."""

    def __init__(self) -> None:
        self._past: deque[tuple[float, dict[str, tuple[int, int]]]] = deque()

    def update(self, receptions: Receptions, now_s: float) -> dict[str, tuple[int, int]]:
        """(missed, sent) of the last `WINDOW_S` by RSU, of those of which some were missed."""
        if not self._past or now_s - self._past[-1][0] >= _STEP_S:
            counts = {rsu: (found.missed, found.received) for rsu, found in receptions}
            self._past.append((now_s, counts))
        while len(self._past) > 1 and now_s - self._past[1][0] >= WINDOW_S:
            self._past.popleft()
        before = self._past[0][1]
        rates = {}
        for rsu, found in receptions:
            past = before.get(rsu)
            if past is not None and found.missed > past[0]:
                new = found.missed - past[0]
                rates[rsu] = new, new + max(0, found.received - past[1])
        return rates


class RoadsideWatch:
    """What RSUs say of themselves and which vehicles stand; the bus's threads tell, others ask.

    Args:
        rsus: the segments that each RSU may report on; None: any RSU may report on any segment.
        healths: when each RSU was heard last, UTC ns, and what it said.
        states: the latest one of each segment and RSU.
    """

    def __init__(
        self,
        network: RoadNetwork,
        rsus: Mapping[str, tuple[str, ...]] | None,
        silent_s: float,
        healths: Callable[[], Mapping[str, tuple[int, RsuHealth]]],
        refuse: Callable[[InputError], None],
        clock: Callable[[], int],
        states: Callable[[], Iterable[SegmentState]] = tuple,
    ) -> None:
        self._network, self._rsus, self._silent_ns = network, rsus, silent_s * 1e9
        self._silent_s, self._states = silent_s, states
        self._refuse, self._clock = refuse, clock
        self._started_ns = clock()
        self._seen_ns: int | None = None
        self._lock = threading.Lock()
        self._healths = healths
        self._stopped: OrderedDict[tuple[str, str], tuple[int, StoppedVehicles]] = OrderedDict()
        self._rates = MissedRates()

    def on_stopped(self, key: str, payload: bytes) -> None:
        """Take in one message from `slipstream.messages.ALL_STOPPED`."""
        try:
            stopped = decode(StoppedVehicles, payload, key)
            if stopped_key(stopped.rsu, stopped.segment) != key:
                raise InputError(key, "not the RSU or segment of its key", "check the sender")
            refused = refusal(stopped, self._network, self._rsus)
            if refused is not None:
                raise InputError(key, refused.text, "check the sender")
        except InputError as error:
            self._refuse(error)
            return
        place = stopped.segment, stopped.rsu
        with self._lock:
            self._stopped.pop(place, None)
            if stopped.unusual:
                self._stopped[place] = self._clock(), stopped
            if len(self._stopped) > MAX_RSUS:
                self._stopped.popitem(last=False)

    def conditions(self, receptions: Receptions, now_s: float) -> Iterator[Condition]:
        """What is wrong; the call of one thread only."""
        now_ns = self._clock()
        with self._lock:
            stopped = list(self._stopped.values())
        healths = self._healths()
        fresh = {
            rsu for rsu, (heard_ns, _) in healths.items() if now_ns - heard_ns <= self._silent_ns
        }
        yield from self._none_sees(now_ns)
        if now_ns - self._started_ns > STARTED_S * 1e9:
            for rsu in self._rsus or ():
                if rsu not in healths:
                    text = "not heard of since the dispatcher started"
                    yield Condition("rsu_silent", f"rsu/{rsu}", text, self._started_ns)
        for rsu, (heard_ns, health) in healths.items():
            if rsu in fresh:
                yield from _of_health(health)
            elif health.status != "ended":
                text = f"last heard of at {utc(heard_ns)}"
                yield Condition("rsu_silent", f"rsu/{rsu}", text, heard_ns)
        yield from self._of_reception(receptions, fresh, now_s)
        yield from self._wrong_way(now_ns)
        yield from _standing(
            message for heard_ns, message in stopped if now_ns - heard_ns <= self._silent_ns
        )

    def _none_sees(self, now_ns: int) -> Iterator[Condition]:
        """No RSU of the settings says now how a road is. One without a picture says so itself."""
        if not self._rsus:
            return
        for state in self._fresh_states(now_ns):
            if state.reason not in ("stale", "no_frames"):
                self._seen_ns = now_ns
                return
        names = ", ".join(islice(self._rsus, _NAMED))
        names += f" and {len(self._rsus) - _NAMED} more" if len(self._rsus) > _NAMED else ""
        text = f"no fresh state from any RSU ({names}): all roads are unknown, no gate opens"
        awaited = self._seen_ns is None and now_ns - self._started_ns <= STARTED_S * 1e9
        since_ns = self._seen_ns or self._started_ns
        yield Condition("rsus_lost", "dispatcher", text, since_ns, awaited=awaited)

    def _fresh_states(self, now_ns: int) -> Iterator[SegmentState]:
        for state in self._states():
            if freshness.fault(state.time_ns, now_ns, stale_after_s=self._silent_s) is None:
                yield state

    def _wrong_way(self, now_ns: int) -> Iterator[Condition]:
        """A road once, however many RSUs see it."""
        seen: dict[str, SegmentState] = {}
        for state in self._fresh_states(now_ns):
            if state.reason == "wrong_way":
                seen.setdefault(state.segment, state)
        for segment, state in seen.items():
            text = f"a vehicle drives against the traffic, seen by {state.rsu}"
            yield Condition("wrong_way", f"road/{segment}", text)

    def _of_reception(
        self, receptions: Receptions, fresh: set[str], now_s: float
    ) -> Iterator[Condition]:
        rates = self._rates.update(receptions, now_s)
        for rsu, found in receptions:
            if rsu not in fresh:
                continue
            delay_s, (missed, sent) = found.delay_s, rates.get(rsu, (0, 0))
            if delay_s is not None and delay_s < -AHEAD_S:
                text = f"its clock is {-delay_s:.1f} s ahead of the dispatcher's"
                yield Condition("rsu_clock", f"rsu/{rsu}", text)
            elif delay_s is not None and delay_s > BEHIND_S:
                text = f"its states come {delay_s:.1f} s after their time: its clock is behind, or "
                yield Condition("rsu_clock", f"rsu/{rsu}", f"{text}they are held up on the way")
            if missed >= MISSED_LEAST and missed >= MISSED_SHARE * sent:
                text = f"{missed} of its last {sent} states have not come"
                yield Condition("rsu_states_missed", f"rsu/{rsu}", text)


def _of_health(health: RsuHealth) -> Iterator[Condition]:
    name = f"rsu/{health.rsu}"
    if health.status == "no_signal":
        yield Condition("rsu_no_signal", name, f"no picture from {health.source}")
    if health.fault is not None and health.fault != "stale":
        text = f"its pictures cannot be trusted: {health.fault.replace('_', ' ')}"
        yield Condition("camera_fault", name, text)


def _standing(messages: Iterable[StoppedVehicles]) -> Iterator[Condition]:
    by_segment: dict[str, StoppedVehicles] = {}
    for message in messages:
        known = by_segment.get(message.segment)
        if known is None or len(message.unusual) > len(known.unusual):
            by_segment[message.segment] = message
    for segment, message in by_segment.items():
        longest, *others = message.unusual
        more = f" and {len(others)} more" if others else ""
        place = f"in lane {longest.lane + 1}, {longest.along_m:.0f} m along"
        text = (
            f"a vehicle{more} stands since {utc(longest.since_ns)} {place}, seen by {message.rsu}"
        )
        yield Condition("vehicle_stopped", f"road/{segment}", text, longest.since_ns)
