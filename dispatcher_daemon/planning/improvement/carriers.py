"""What each carrier has from a plan, and plans in which none has less than alone.

A carrier's vehicles cost what their itineraries cost, less what they save themselves by their
places in platoons: no payments between carriers are assumed. Alone it has its part of the base
plan, without platooning and all vehicles leaving when ready. Which carrier serves a stop that is
anybody's is settled by the base plan.
"""

from __future__ import annotations

import math
from bisect import insort
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from dispatcher_daemon.fleet import Passage, RoadUser
from dispatcher_daemon.planning.improvement.exchanges import exchanged
from dispatcher_daemon.planning.plans import Gains
from dispatcher_daemon.planning.platooning import (
    Approach,
    ExpectedDrafting,
    TimedPassage,
    platoons_of,
)
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner

_ROUNDING_KWH: Final = 1e-9


class Accounts:
    """What the vehicles of a plan have more than in the base plan, each by itself.

    Platoons are those of the published plans (`platooning.form_platoons`), who leads where two
    enter at once included; `Meetings` knows their sums only. What is expected of gates that are
    closed now is in no account.
    """

    def __init__(
        self,
        planner: Planner,
        base: Sequence[Itinerary],
        present: Sequence[Itinerary],
        on_road: Iterable[RoadUser] = (),
    ) -> None:
        """Begin with a plan.

        Args:
            on_road: vehicles that earlier cycles sent; what they save is in no account.
        """
        self.present = list(present)
        self._base = base
        vehicles = planner.problem.fleet.vehicles
        self._number = {vehicle.id: number for number, vehicle in enumerate(vehicles)}
        self._carrier = [vehicle.carrier for vehicle in vehicles]
        self._shares = [
            planner.book.shares_by_profile[planner.problem.profile_of(v)] for v in vehicles
        ]
        self._window_s, self._longest = planner.book.sync_window_s, planner.book.longest
        self._expected = planner.book.expected
        self._on: dict[str, list[TimedPassage[Passage]]] = defaultdict(list)
        self._savers: dict[str, set[int]] = {}
        self._saved: list[dict[str, float]] = [{} for _ in vehicles]
        for user in on_road:
            for segment, passage in user.passages():
                insort(self._on[segment], passage)
        for itinerary in present:
            for segment, passage in self._passages(itinerary):
                insort(self._on[segment], passage)
        self._count(self._on)

    def change(self, itineraries: Iterable[Itinerary]) -> None:
        """Change the itineraries of some vehicles."""
        touched = set()
        for itinerary in itineraries:
            for segment, passage in self._passages(self.present[itinerary.number]):
                self._on[segment].remove(passage)
                touched.add(segment)
            for segment, passage in self._passages(itinerary):
                insort(self._on[segment], passage)
                touched.add(segment)
            self.present[itinerary.number] = itinerary
        self._count(sorted(touched))

    def gain_kwh(self, number: int) -> float:
        """What one vehicle has more than in the base plan."""
        more = self._base[number].cost_kwh - self.present[number].cost_kwh
        return more + math.fsum(self._saved[number].values())

    def gains_kwh(self) -> Gains:
        """What each carrier has more than alone."""
        by_carrier: dict[str | None, list[float]] = defaultdict(list)
        for number, carrier in enumerate(self._carrier):
            by_carrier[carrier].append(self.gain_kwh(number))
        return {carrier: math.fsum(gains) for carrier, gains in by_carrier.items()}

    def losing(self) -> list[str | None]:
        """Carriers that have less than alone, in the fleet's order."""
        return [carrier for carrier, gain in self.gains_kwh().items() if gain < -_ROUNDING_KWH]

    def allows(self, itineraries: Sequence[Itinerary]) -> bool:
        """Whether a change of some vehicles' itineraries leaves no carrier with less than alone."""
        before = [self.present[itinerary.number] for itinerary in itineraries]
        self.change(itineraries)
        fair = not self.losing()
        self.change(before)
        return fair

    def vehicles_of(self, carrier: str | None) -> list[int]:
        """Numbers of a carrier's vehicles."""
        return [number for number, own in enumerate(self._carrier) if own == carrier]

    def worst(self, carrier: str | None) -> list[int]:
        """A carrier's vehicles that go back to the base plan: the group that loses most."""
        stops = {itinerary.number: itinerary.stops for itinerary in self.present}
        groups = exchanged(self._base, stops)
        joined = {number for group in groups for number in group}
        groups += [[i.number] for i in self.present if i.number not in joined]
        own = [
            group
            for group in groups
            if self._carrier[group[0]] == carrier
            and any(self.present[number] is not self._base[number] for number in group)
        ]
        return min(own, key=lambda group: math.fsum(map(self.gain_kwh, group)))

    def _passages(self, itinerary: Itinerary) -> Iterable[tuple[str, TimedPassage[Passage]]]:
        if itinerary.route is None:
            return
        vehicle, shares = itinerary.route.vehicle, self._shares[itinerary.number]
        for leg, position, segment, entry, leaving in itinerary.route.entries_s():
            if segment in shares and shares[segment].gate.open:
                yield segment, (entry, leaving, (vehicle, leg, position))

    def _count(self, segments: Iterable[str]) -> None:
        """Count anew who saves how much on some segments."""
        for segment in segments:
            for number in self._savers.pop(segment, ()):
                del self._saved[number][segment]
            saved: dict[int, float] = defaultdict(float)
            for group in platoons_of(self._on[segment], self._window_s, self._longest):
                if len(group) < 2:
                    continue
                close = self._close(group)
                for place, (share, (_, _, (vehicle, _, _))) in enumerate(
                    zip(close, group, strict=True)
                ):
                    if vehicle in self._number:
                        number = self._number[vehicle]
                        ideal_kwh = self._shares[number][segment].at(place, len(group))
                        saved[number] += share * ideal_kwh
            for number, kwh in saved.items():
                self._saved[number][segment] = kwh
            self._savers[segment] = set(saved)

    def _close(self, group: Sequence[TimedPassage[Passage]]) -> Sequence[float]:
        """Share of the segment on which each place of a platoon is expected to be close."""
        expected = self._expected
        if expected is None:
            return [1.0] * len(group)
        return expected.shares(tuple(self._approach(expected, passage) for _, _, passage in group))

    def _approach(self, expected: ExpectedDrafting, passage: Passage) -> Approach:
        vehicle, leg, position = passage
        route = self.present[self._number[vehicle]].route if vehicle in self._number else None
        if route is None:
            return expected.on_road[passage]
        return expected.of_leg(vehicle, leg, route.legs[leg])[position]


def nobody_worse_off(
    planner: Planner,
    base: Sequence[Itinerary],
    present: Sequence[Itinerary],
    on_road: Iterable[RoadUser] = (),
    has_time: Callable[[], bool] = lambda: True,
) -> Accounts | None:
    """Accounts of the plan with changes undone until no carrier has less than alone; None: the
    fleet is of one carrier.

    Of each carrier that has less, the vehicles that lose most go back to the base plan, together
    with those that they have exchanged stops with. In the base plan nobody loses, so it ends.

    Args:
        present: of the plan, in which every stop is with the carrier that the base plan gave it.
        has_time: whether one group after another goes back; else all of a carrier's do.
    """
    if len(planner.problem.fleet.carriers) < 2:
        return None
    accounts = Accounts(planner, base, present, on_road)
    while losing := accounts.losing():
        for carrier in losing:
            back = accounts.worst(carrier) if has_time() else accounts.vehicles_of(carrier)
            accounts.change([base[number] for number in back])
    return accounts
