from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import pytest

from dispatcher_daemon.planning.departures import (
    alternatives,
    best_departure,
    meeting_departures,
    schedule_greedily,
)
from dispatcher_daemon.planning.itineraries import Itinerary, Planner
from dispatcher_daemon.planning.sweeps import choice_of
from dispatcher_daemon.platooning.meetings import Meetings
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.travel import Travel, roads_of
from dispatcher_daemon.traffic import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]


def planned(
    town: Town,
    vehicles: Sequence[dict[str, float]],
    stops: Sequence[object] = ("33",) * 4,
    price_of_waiting_kw: float = 0.0,
) -> tuple[Planner, list[Itinerary]]:
    """Each vehicle on its way to a stop of its own, as soon as it is ready."""
    problem, snapshot = town(stops, vehicles)
    problem = replace(problem, price_of_waiting_kw=price_of_waiting_kw)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0, 10.0)
    itineraries = []
    for number in range(len(vehicles)):
        visits = (problem.fleet.stops[number].id,)
        itinerary = planner.itinerary(number, visits, planner.legs(number, visits))
        assert itinerary is not None
        itineraries.append(itinerary)
    return planner, itineraries


def test_who_can_wait_leaves_with_the_one_that_comes_later(town: Town) -> None:
    """One is ready 40 s later and cannot wait, the other can: it waits, and they drive together."""
    planner, (early, late) = planned(town, [{"depart_by_s": 100.0}, {"ready_s": 40.0}])
    meetings = Meetings(planner.shares, 3.0)
    meetings.add(late.traversals)
    found = meeting_departures(planner, early, meetings)
    assert found[0] == pytest.approx(50.0)
    best = max(
        alternatives(planner, early, meetings), key=lambda i: meetings.gain_kwh(i.traversals)
    )
    together = sum(
        planner.shares[s].leader_kwh + planner.shares[s].follower_kwh for s in late.traversals
    )
    assert meetings.gain_kwh(best.traversals) == pytest.approx(together)


@pytest.mark.parametrize(("share", "waits"), [(0.9, True), (1.1, False)])
def test_nobody_waits_for_what_is_worth_less_than_the_time(
    town: Town, share: float, waits: bool
) -> None:
    """40 s at the depot are worth the drafting that they bring, or a little more than that."""
    vans = [{"depart_by_s": 100.0}, {"ready_s": 40.0}]
    planner, (_, late) = planned(town, vans)
    gain = sum(
        planner.shares[s].leader_kwh + planner.shares[s].follower_kwh for s in late.traversals
    )
    planner, (early, late) = planned(town, vans, price_of_waiting_kw=share * gain * 3600 / 40)
    assert early.cost_kwh == sum(leg.cost_kwh for leg in planner.legs(0, early.stops) or ())
    meetings = Meetings(planner.shares, 3.0)
    meetings.add(late.traversals)
    best = best_departure(planner, early, meetings)
    assert (best.depart_s == pytest.approx(50.0)) == waits
    assert best.cost_kwh == pytest.approx(early.cost_kwh + waits * share * gain)


def test_departures_stay_within_the_window(town: Town) -> None:
    """Whom nobody can be met by within the window gets no departure; nor does one that is idle."""
    planner, (early, late) = planned(town, [{"depart_by_s": 39.9}, {"ready_s": 40.0}])
    meetings = Meetings(planner.shares, 3.0)
    meetings.add(late.traversals)
    assert meeting_departures(planner, early, meetings) == []
    assert list(alternatives(planner, planner.idle(0), meetings)) == []


def test_departures_are_apart_and_the_most_promising_comes_first(town: Town) -> None:
    """Two that leave together outweigh one alone, and no two departures lie within the window."""
    vans = [{"depart_by_s": 200.0}, {"ready_s": 60.0}, {"ready_s": 120.0}, {"ready_s": 121.0}]
    planner, itineraries = planned(town, vans)
    meetings = Meetings(planner.shares, 3.0)
    for other in itineraries[1:]:
        meetings.add(other.traversals)
    found = meeting_departures(planner, itineraries[0], meetings)
    assert found[0] == pytest.approx(130.5, abs=0.51)
    assert any(abs(depart_s - 70.0) < 1e-6 for depart_s in found)
    ordered = sorted(found)
    assert all(b - a > 3.0 for a, b in pairwise(ordered))
    assert len(meeting_departures(planner, itineraries[0], meetings, max_departures=1)) == 1


def test_alternatives_that_would_miss_a_stop_s_window_are_left_out(town: Town) -> None:
    """Waiting for the other would make the parcel late: no alternative."""
    late_stop = {"id": "s", "node": "33", "latest_s": 160.0}
    other = {"id": "t", "node": "33"}
    planner, (early, late) = planned(
        town, [{"depart_by_s": 100.0}, {"ready_s": 90.0}], [late_stop, other]
    )
    assert early.route is not None
    assert early.route.visits[1].arrival_s - early.depart_s > 70.0
    meetings = Meetings(planner.shares, 3.0)
    meetings.add(late.traversals)
    assert meeting_departures(planner, early, meetings)
    assert list(alternatives(planner, early, meetings)) == []


def test_greedy_scheduling_never_saves_less_and_keeps_routes(town: Town) -> None:
    """Those ready last choose first: all four end up in one platoon, on the routes they had."""
    vans = [{"ready_s": 20.0 * n, "depart_by_s": 20.0 * n + 90.0} for n in range(4)]
    planner, itineraries = planned(town, vans)
    moved = schedule_greedily(planner, itineraries[::-1])
    assert [i.stops for i in moved] == [i.stops for i in itineraries[::-1]]
    before, after = choice_of(planner, itineraries), choice_of(planner, moved)
    assert before.saving_kwh == 0
    one_platoon = sum(
        planner.shares[s].leader_kwh + 3 * planner.shares[s].follower_kwh
        for s in moved[0].traversals
    )
    assert after.saving_kwh == pytest.approx(one_platoon)
    assert after.cost_kwh == pytest.approx(before.cost_kwh)
