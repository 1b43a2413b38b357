"""Options of a vehicle in the route form, and the ways for them that like open roads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dispatcher_daemon.planning.improvement.departures import alternatives
from dispatcher_daemon.planning.platooning import Meetings, Shares
from dispatcher_daemon.planning.roads import Roads, searched_again
from dispatcher_daemon.planning.roads.weights import Floats
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner


def add_discounted_ways(
    planner: Planner, may_go_on: Callable[[float], bool] = lambda _: True
) -> bool:
    """Give a planner second paths: open segments are cheaper by a follower's saving.

    Args:
        may_go_on: asked now and then with the share of the search that is done.

    Returns:
        Whether it has them; it has not if the search may not go on.
    """

    def discount_kwh(roads: Roads) -> Floats:
        shares = planner.book.shares_by_profile[roads.profile]
        saving = {name: share.following_kwh(0.0) for name, share in shares.items()}
        return np.array([saving.get(name, 0.0) for name in roads.ids])

    try:
        found = searched_again(planner.travels[0], planner.problem, discount_kwh, may_go_on)
    except TimeoutError:
        return False
    planner.travels += (found,)
    return True


def options_for(
    planner: Planner,
    itinerary: Itinerary,
    partners: Sequence[Itinerary],
    meetings: Meetings,
    max_options: int,
    rng: np.random.Generator,
) -> list[Itinerary]:
    """The present itinerary, the best other and some good ones, all other vehicles unchanged.

    Candidates are other paths between stops and the reversed order of stops, each at the departures
    at which the vehicle would meet most others; other paths of single legs; and a departure at
    which it could meet a partner that changes its own departure.

    Args:
        partners: vehicles that may change at the same time.
        meetings: present passages of all vehicles, this one included.
    """
    if itinerary.route is None or max_options < 2:
        return [itinerary]
    with meetings.tried():
        meetings.remove(itinerary.traversals)
        tried = [
            candidate
            for variant in _variants(planner, itinerary)
            for candidate in (variant, *alternatives(planner, variant, meetings))
        ]
        tried += _detours(planner, itinerary)
        saved_kwh = meetings.gains_kwh(candidate.traversals for candidate in tried)
    gains = [kwh - candidate.cost_kwh for kwh, candidate in zip(saved_kwh, tried, strict=True)]
    ranked = [tried[i] for i in sorted(range(len(tried)), key=lambda i: -gains[i])]
    joint = list(_joint(planner, itinerary, partners, meetings.shares))
    # `itinerary` is among the tried, so the best other one is among the first two.
    good = ranked[2 : 2 + 2 * max_options]
    drawn = [good[i] for i in rng.permutation(len(good))]
    wanted = [itinerary, *ranked[:2], *joint, *drawn]
    distinct: dict[tuple[object, ...], Itinerary] = {}
    for candidate in wanted:
        distinct.setdefault(candidate.key, candidate)
    return list(distinct.values())[:max_options]


def _variants(planner: Planner, itinerary: Itinerary) -> Iterator[Itinerary]:
    """The same stops at the same departure, by other paths or in reversed order."""
    number, stops, depart_s = itinerary.number, itinerary.stops, itinerary.depart_s
    yield itinerary
    vehicle = planner.problem.fleet.vehicles[number]
    orders = [stops]
    if len(stops) > 1 and vehicle.first_stop is None:
        orders.append(stops[::-1])
    for order in orders:
        for travel in range(len(planner.travels)):
            variant = planner.itinerary(
                number, order, planner.legs(number, order, travel), depart_s
            )
            if variant is not None and variant.key != itinerary.key:
                yield variant


def _detours(planner: Planner, itinerary: Itinerary) -> Iterator[Itinerary]:
    """The same with another of the cheapest paths of one leg."""
    if itinerary.route is None or planner.paths_per_leg < 2:
        return
    legs = list(itinerary.route.legs)
    fixed = len(planner.fixed_legs(itinerary.number) or ())
    travel = planner.travels[0].of(planner.problem.fleet.vehicles[itinerary.number])
    for at, leg in enumerate(legs[fixed:], fixed):
        if leg.pause is not None:
            continue
        for other in travel.paths(leg.start, leg.end, planner.paths_per_leg):
            if other.path != leg.path:
                changed = [*legs[:at], replace(other, charging=leg.charging), *legs[at + 1 :]]
                detour = planner.itinerary(
                    itinerary.number,
                    itinerary.stops,
                    changed,
                    itinerary.depart_s,
                    itinerary.waits_s,
                )
                if detour is not None:
                    yield detour


def _joint(
    planner: Planner,
    itinerary: Itinerary,
    partners: Sequence[Itinerary],
    shares: Mapping[str, Shares],
) -> Iterator[Itinerary]:
    """The departure for the earliest moment at which vehicle and closest partner can meet."""
    strongest, shared = 0.0, None
    for partner in partners:
        common = [s for s in itinerary.traversals if s in partner.traversals]
        weight = sum(shares[s].following_kwh(itinerary.traversals[s][0][0]) for s in common)
        if partner.number != itinerary.number and weight > strongest:
            strongest, shared = weight, (partner, common)
    if shared is None or itinerary.route is None:
        return
    partner, common = shared
    first = min(common, key=lambda s: itinerary.traversals[s][0][0])
    own, other = itinerary.traversals[first][0][0], partner.traversals[first][0][0]
    low, high = planner.windows.of(itinerary.number)
    partner_low, partner_high = planner.windows.of(partner.number)
    begins = max(own + low - itinerary.depart_s, other + partner_low - partner.depart_s)
    ends = min(own + high - itinerary.depart_s, other + partner_high - partner.depart_s)
    if begins <= ends:
        depart_s = itinerary.depart_s + begins - own
        moved = planner.itinerary(
            itinerary.number, itinerary.stops, itinerary.route.legs, depart_s, itinerary.waits_s
        )
        if moved is not None:
            yield moved
