"""A plan, and what it is worth: the same evaluation for every strategy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dispatcher_daemon.planning.platooning import TimedPassage, platoons_of
from slipstream_lab.research.coordination.case import CoordinationCase, Floats, Ints
from slipstream_lab.research.coordination.trips.freight import MS

Plan = Ints
"""How much later than undelayed each trip is on each of its stretches, ms: shape (trips, stretches)
of `CoordinationCase.stop_kwh`. Column 0 is the wait at the origin; increments are waits at hubs on
the way; columns beyond a trip's last stretch repeat the one before."""

Strategy = Callable[[CoordinationCase], Plan]
"""A way to coordinate. A plan that it returns has to pass `check`."""


@dataclass(frozen=True)
class PlanOutcome:
    """What a plan is worth."""

    drafting_kwh: float
    stops_kwh: float
    waiting_kwh: float
    mean_wait_s: float
    max_wait_s: float
    platooned_km: float
    open_km: float
    carrier_kwh: tuple[float, ...]

    @property
    def net_kwh(self) -> float:
        """What strategies maximise: drafting less stops and waiting."""
        return self.drafting_kwh - self.stops_kwh - self.waiting_kwh


def check(case: CoordinationCase, plan: Plan) -> None:
    """Check that a plan can be driven, and nobody is late. Raises ValueError: another shape, a
    wait below 0, or one beyond a trip's latest arrival.
    """
    if plan.shape != case.stop_kwh.shape or plan.dtype != np.int64:
        raise ValueError(f"a plan of shape {case.stop_kwh.shape} in ms is needed")
    if (plan[:, 0] < 0).any() or (np.diff(plan, axis=1) < 0).any():
        raise ValueError("a wait below 0")
    if (plan[:, -1] > case.slack_ms).any():
        raise ValueError("a trip is late")


def evaluate(case: CoordinationCase, plan: Plan) -> PlanOutcome:
    """Form the platoons of a plan as the dispatcher does, link by link, and add up. Raises
    ValueError: `check`.
    """
    check(case, plan)
    saved_kwh, platooned_m = _drafting(case, plan)
    stops_kwh = stop_energy_kwh(case, plan)
    waiting_kwh = case.price_kwh_per_ms * plan[:, -1]
    carriers = np.bincount(case.carrier, weights=saved_kwh - stops_kwh - waiting_kwh)
    return PlanOutcome(
        float(saved_kwh.sum()),
        float(stops_kwh.sum()),
        float(waiting_kwh.sum()),
        float(plan[:, -1].mean()) / MS,
        float(plan[:, -1].max()) / MS,
        platooned_m / 1000,
        float(np.append(case.length_m, 0.0)[case.link].sum()) / 1000,
        tuple(carriers.tolist()),
    )


def trip_values_kwh(case: CoordinationCase, plan: Plan) -> Floats:
    """What each trip has of a plan: its own drafting less its stops and waiting, kWh."""
    own = _drafting(case, plan)[0] - stop_energy_kwh(case, plan)
    return np.asarray(own - case.price_kwh_per_ms * plan[:, -1])


def _drafting(case: CoordinationCase, plan: Plan) -> tuple[Floats, float]:
    """(Saved by each trip, kWh; driven in platoons by all, m)."""
    saved_kwh, platooned_m = np.zeros(len(plan)), 0.0
    for link, group in platoons(case, plan):
        if len(group) > 1:
            saved_kwh[group[0]] += case.leader_kwh[link]
            saved_kwh[group[1:]] += case.follower_kwh[link]
            platooned_m += len(group) * float(case.length_m[link])
    return saved_kwh, platooned_m


def platoons(case: CoordinationCase, plan: Plan) -> Iterator[tuple[int, list[int]]]:
    """(Link, trips in the order of driving) of all platoons, vehicles alone included."""
    entries = entries_ms(case, plan)
    passages: list[list[TimedPassage[tuple[int]]]] = [[] for _ in case.length_m]
    for trip, position in np.argwhere(case.link >= 0).tolist():
        link, entry = int(case.link[trip, position]), float(entries[trip, position])
        passages[link].append((entry, entry + float(case.duration_ms[link]), (trip,)))
    for link, timed in enumerate(passages):
        for group in platoons_of(sorted(timed), case.sync_window_ms, longest=len(timed)):
            yield link, [trip for _, _, (trip,) in group]


def entries_ms(case: CoordinationCase, plan: Plan) -> Ints:
    """Entries of all trips to their links, ms, in the shape of `CoordinationCase.link`."""
    delays = np.take_along_axis(plan, np.maximum(case.stretch, 0), axis=1)
    return np.asarray(case.ready_ms[:, None] + case.offset_ms + delays)


def stop_energy_kwh(case: CoordinationCase, plan: Plan) -> Floats:
    """Energy of each trip's stops at hubs, kWh, shape (trips,)."""
    waits = np.diff(plan, axis=1) > 0
    return np.asarray(np.where(waits, case.stop_kwh[:, 1:], 0.0).sum(axis=1))


def undelayed(case: CoordinationCase) -> Plan:
    """Everybody leaves when ready."""
    return np.zeros(case.stop_kwh.shape, dtype=np.int64)
