"""One fault after the other: injected, held, taken away, and what comes of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import storage
from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream_lab.benchmarks.chaos.camera import NOTICED_S, CameraFaultKind
from slipstream_lab.benchmarks.chaos.faults import DASHBOARD, DISPATCHER, SHARES, Fault, deck
from slipstream_lab.benchmarks.chaos.orders import Caller, Told, lost
from slipstream_lab.benchmarks.chaos.site import Site, open_site
from slipstream_lab.benchmarks.chaos.watch import Seen, Watch

_START_S: Final = 600.0
_GIVEN_UP_S: Final = 60.0
_LOOK_S: Final = 0.05
_WORK_S: Final = 0.03
_STATE_S: Final = 1.0
"""A state comes each second: so much later than the edge may others notice a camera's fault."""


@dataclass(frozen=True)
class Outcome:
    """What came of a fault.

    Attributes:
        begin_s: UTC.
        recovery_s: from its end until all was well; None: not within a minute.
        why: what was lacking when its limit was over; None: nothing.
        lost: what was acknowledged before and is not stored, in words.
        stretch: wall time of a little work by its processor time, at the fault's end: how much
            the machine's other work held ours up.
        was_stable: whether the flag of the faulty camera's road was stable just before.
        shown: where that road was shown as stable, or was open, after the fault had to be noticed,
            and how long after its begin.
        ended: daemons that ended though nobody ended them.
    """

    fault: Fault
    begin_s: float
    end_s: float
    recovery_s: float | None
    why: str | None = None
    lost: tuple[str, ...] = ()
    stretch: float = 1.0
    was_stable: bool | None = None
    shown: tuple[str, ...] = ()
    ended: tuple[str, ...] = ()

    @property
    def in_time(self) -> bool:
        """Whether all was well within the limit."""
        return self.recovery_s is not None and self.recovery_s <= self.fault.recovery_s


@dataclass(frozen=True)
class ChaosResult:
    """All of a run."""

    outcomes: tuple[Outcome, ...]
    told: Mapping[str, Told]
    answers: Mapping[int, int]
    cycles: int
    lost: tuple[str, ...]
    served_again: int
    without: Mapping[str, str]
    seconds: float


@dataclass
class _FlagWatch:
    """Notes where the road of a faulty camera is shown as stable."""

    segment: str = ""
    begin_s: float = 0.0
    since_s: float = float("inf")
    shown: dict[str, float] = field(default_factory=dict)

    def look(self, seen: Seen) -> None:
        """One look of the watch."""
        if seen.at_s <= self.since_s:
            return
        where = list(seen.stable.get(self.segment, ()))
        if self.segment in seen.opened and seen.latest_began_s > self.since_s:
            where.append("cycle")
        for one in where:
            self.shown[one] = round(seen.at_s - self.begin_s, 1)


def run_chaos(
    folder: Path,
    clips: Path,
    number: int,
    seed: int,
    say: Callable[[str], None],
    until_s: float = float("inf"),
    kinds: Collection[str] = (),
) -> ChaosResult:
    """Run a number of faults.

    Args:
        folder: for the state, logs and database; made if missing.
        until_s: monotonic time at which no further fault begins.
        kinds: only these; none: all.

    Raises:
        InputError: the site did not come up.
    """
    folder.mkdir(parents=True, exist_ok=True)
    flags = _FlagWatch()
    began = time.monotonic()
    with ExitStack() as stack:
        site = stack.enter_context(open_site(folder, clips, say))
        bus = stack.enter_context(Bus.open(site.bus))
        watch = stack.enter_context(Watch(site.api, site.page, site.token, bus, flags.look))
        why, _ = _wait(site, watch, time.time(), _START_S)
        if why is not None:
            raise InputError(folder, f"the site did not come up: {why}", "see the logs in it")
        caller = stack.enter_context(Caller(site.api, site.token))
        faults = deck(number, seed, {*site.without, *_left_out(kinds)})
        outcomes = []
        for at, fault in enumerate(faults, 1):
            if time.monotonic() > until_s:
                break
            try:
                outcome = _one(site, watch, caller, flags, fault)
            except KeyboardInterrupt:
                break  # what came of those before is reported
            outcomes.append(outcome)
            say(f"{at} of {len(faults)}: {fault}: {_words(outcome)}")
        told, cycles = dict(caller.told), watch.seen.cycles
        missing = _lost(site, told, cycles)
        report = storage.check(f"sqlite:///{site.database}")
        counts = site.world.counts
        return ChaosResult(
            tuple(outcomes),
            told,
            dict(caller.outcomes),
            len(cycles),
            (*missing, *report.faults),
            0 if counts is None else counts.orders_served_again,
            site.without,
            time.monotonic() - began,
        )


def _left_out(kinds: Collection[str]) -> set[str]:
    return {kind for kind in SHARES if kinds and kind not in kinds}


def _one(site: Site, watch: Watch, caller: Caller, flags: _FlagWatch, fault: Fault) -> Outcome:
    told, cycles, ends = dict(caller.told), set(watch.seen.cycles), len(site.units.unwanted)
    site.units.excuse(*_excused(fault))
    begin_s = time.time()
    segment = site.segments.get(fault.targets[0], "")
    was_stable = "bus" in watch.seen.stable.get(segment, ()) if fault.kind == "camera" else None
    flags.segment, flags.begin_s, flags.shown = segment, begin_s, {}
    if fault.kind == "camera":
        way: CameraFaultKind = fault.value  # type: ignore[assignment]
        flags.since_s = begin_s + NOTICED_S[way] + _STATE_S
    site.begin(fault)
    _hold(site, fault.hold_s)
    flags.since_s = float("inf")
    site.end(fault)
    end_s = time.time()
    why_late, _ = _wait(site, watch, end_s, fault.recovery_s)
    why, well_s = _wait(site, watch, end_s, _GIVEN_UP_S - fault.recovery_s)
    for name in fault.targets:
        site.units.start(name)
    return Outcome(
        fault,
        begin_s,
        end_s,
        None if why is not None else well_s - end_s,
        why_late or why,
        tuple(_lost(site, told, cycles)),
        _stretch(),
        was_stable,
        tuple(f"{where} {late_s:g} s after its begin" for where, late_s in flags.shown.items()),
        tuple(site.units.unwanted[ends:]),
    )


def _stretch() -> float:
    """Wall time by processor time of some tens of ms of work."""
    wall_s, used_s = time.monotonic(), time.thread_time()
    while (worked_s := time.thread_time() - used_s) < _WORK_S:
        pass
    return (time.monotonic() - wall_s) / worked_s


def _excused(fault: Fault) -> tuple[str, ...]:
    """Daemons that a fault may end."""
    if fault.kind == "read-only disk":
        return DISPATCHER, DASHBOARD
    return fault.targets if fault.kind in ("kill", "restart") else ()


def _hold(site: Site, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while (left_s := until_s - time.monotonic()) > 0:
        site.world.poll()
        time.sleep(min(left_s, _LOOK_S))


def _wait(site: Site, watch: Watch, since_s: float, seconds: float) -> tuple[str | None, float]:
    """Wait until all is well since a moment; what is not in words, and when that was found, UTC."""
    until_s = time.monotonic() + seconds
    while True:
        seen = watch.seen
        why = seen.why_unwell(since_s)
        if why is None or time.monotonic() > until_s:
            return why, seen.at_s
        _hold(site, _LOOK_S)


def _lost(site: Site, told: Mapping[str, Told], cycles: Collection[int]) -> list[str]:
    """What was acknowledged, or shown, and is not in the database."""
    with storage.open_reader(f"sqlite:///{site.database}") as reader:
        stored = {order.order: order for order in reader.orders()}
        numbers = {cycle.cycle for cycle in reader.cycles(limit=1_000_000)}
    gone = sorted(set(cycles) - numbers)
    return lost(told, stored) + [f"cycle {cycle}: shown, and not stored" for cycle in gone]


def _words(outcome: Outcome) -> str:
    recovery_s = outcome.recovery_s
    well = "NOT WELL" if recovery_s is None else f"well after {recovery_s:.1f} s"
    late = "" if outcome.in_time else f", too late ({outcome.why})"
    more = (*outcome.lost, *outcome.shown, *outcome.ended)
    return f"{well}{late}{''.join(f'; {one}' for one in more)}"
