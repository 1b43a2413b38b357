from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem, routing_problem
from dispatcher_daemon.planning.improvement.departures import (
    alternatives,
    best_departure,
    encounters,
    longest_wait_s,
    meeting_departures,
    schedule_greedily,
)
from dispatcher_daemon.planning.improvement.sweeps import choice_of
from dispatcher_daemon.planning.platooning.meetings import Meetings
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic.snapshot import PERSISTENCE_S, TrafficSnapshot
from slipstream.prices import PriceSettings

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
    meetings = Meetings(planner.book.shares, 3.0, planner.book.longest)
    meetings.add(late.traversals)
    found = meeting_departures(planner, early, encounters(planner, early, meetings))
    assert found[0] == pytest.approx(50.0)
    best = max(
        alternatives(planner, early, meetings), key=lambda i: meetings.gain_kwh(i.traversals)
    )
    together = sum(
        planner.book.shares[s].leader_kwh + planner.book.shares[s].follower_kwh
        for s in late.traversals
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
        planner.book.shares[s].leader_kwh + planner.book.shares[s].follower_kwh
        for s in late.traversals
    )
    planner, (early, late) = planned(town, vans, price_of_waiting_kw=share * gain * 3600 / 40)
    assert early.cost_kwh == sum(leg.cost_kwh for leg in planner.legs(0, early.stops) or ())
    meetings = Meetings(planner.book.shares, 3.0, planner.book.longest)
    meetings.add(late.traversals)
    best = best_departure(planner, early, meetings)
    assert (best.depart_s == pytest.approx(50.0)) == waits
    assert best.cost_kwh == pytest.approx(early.cost_kwh + waits * share * gain)


def test_departures_are_apart_and_the_most_promising_comes_first(town: Town) -> None:
    """Two that leave together outweigh one alone, and no two departures lie within the window."""
    vans = [{"depart_by_s": 200.0}, {"ready_s": 60.0}, {"ready_s": 120.0}, {"ready_s": 121.0}]
    planner, itineraries = planned(town, vans)
    meetings = Meetings(planner.book.shares, 3.0, planner.book.longest)
    for other in itineraries[1:]:
        meetings.add(other.traversals)
    found = meeting_departures(
        planner, itineraries[0], encounters(planner, itineraries[0], meetings)
    )
    assert found[0] == pytest.approx(130.5, abs=0.51)
    assert any(abs(depart_s - 70.0) < 1e-6 for depart_s in found)
    ordered = sorted(found)
    assert all(b - a > 3.0 for a, b in pairwise(ordered))
    assert (
        len(
            meeting_departures(
                planner,
                itineraries[0],
                encounters(planner, itineraries[0], meetings),
                max_departures=1,
            )
        )
        == 1
    )


def test_alternatives_that_would_miss_a_stop_s_window_are_left_out(town: Town) -> None:
    """Waiting for the other would make the parcel late: no alternative."""
    late_stop = {"id": "s", "node": "33", "latest_s": 160.0}
    other = {"id": "t", "node": "33"}
    planner, (early, late) = planned(
        town, [{"depart_by_s": 100.0}, {"ready_s": 90.0}], [late_stop, other]
    )
    assert early.route is not None
    assert early.route.visits[1].arrival_s - early.depart_s > 70.0
    meetings = Meetings(planner.book.shares, 3.0, planner.book.longest)
    meetings.add(late.traversals)
    assert meeting_departures(planner, early, encounters(planner, early, meetings))
    others = list(alternatives(planner, early, meetings))
    assert {other.depart_s for other in others} <= {early.depart_s}
    assert all(o.route is not None and o.route.visits[1].arrival_s <= 160 + 10 for o in others)


def to_and_fro(
    town: Town, price_kw: float = 0.0, objective: Literal["energy", "paper"] = "energy"
) -> tuple[Planner, Itinerary, Itinerary]:
    """Two vans to the same place; the second is there 45 s after the first one could go home."""
    problem, snapshot = town(["33", "33"], [{}, {"ready_s": 45.0}])
    problem = replace(problem, price_of_time_kw=price_kw, objective=objective)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0, 10.0)
    first, second = (planner.itinerary(n, (f"s{n}",), planner.legs(n, (f"s{n}",))) for n in (0, 1))
    assert first is not None
    assert second is not None
    return planner, first, second


def test_a_van_waits_at_its_stop_to_drive_home_with_another(town: Town) -> None:
    """It leaves when the other does, 45 s later, and both save on each segment of the way home."""
    planner, first, second = to_and_fro(town)
    meetings = planner.book.meetings()
    meetings.add(second.traversals)
    best = best_departure(planner, first, meetings)
    assert best.waits_s == pytest.approx([45.0])
    assert best.route is not None
    assert best.route.visits[1].departure_s == pytest.approx(best.route.visits[1].arrival_s + 65.0)
    home = best.route.legs[1].path
    saved = sum(
        planner.book.shares[s].leader_kwh + planner.book.shares[s].follower_kwh for s in home
    )
    assert meetings.gain_kwh(best.traversals) == pytest.approx(saved)
    assert best.cost_kwh == first.cost_kwh


@pytest.mark.parametrize(("share", "waits"), [(0.9, True), (1.1, False)])
def test_a_wait_on_the_way_costs_what_driving_time_costs(
    town: Town, share: float, waits: bool
) -> None:
    """It is taken as long as both save more than its 45 s cost."""
    planner, first, _ = to_and_fro(town)
    assert first.route is not None
    home = first.route.legs[1].path
    saved = sum(
        planner.book.shares[s].leader_kwh + planner.book.shares[s].follower_kwh for s in home
    )
    planner, first, second = to_and_fro(town, share * saved * 3600 / 45.0)
    meetings = planner.book.meetings()
    meetings.add(second.traversals)
    best = best_departure(planner, first, meetings)
    assert best.waits_s == pytest.approx([45.0 if waits else 0.0])
    if waits:
        assert best.cost_kwh - first.cost_kwh == pytest.approx(share * saved)
    assert longest_wait_s(planner, first) == pytest.approx(
        sum(planner.book.shares[s].follower_kwh for s in home) / (share * saved) * 45.0
    )


def test_the_settings_price_of_a_wait_at_a_stop_reaches_the_planner(town: Town) -> None:
    """In kWh an hour; without one it is that of driving, or of waiting if that is more."""
    problem, _ = town(["33"], [{}])

    def standing_kw(**prices: float) -> float:
        settings = DispatcherSettings(prices=PriceSettings(energy_kwh=0.5, **prices))
        return routing_problem(problem.network, problem.fleet, settings).price_of_standing_kw

    assert standing_kw(driving_hour=4.0) == 8.0
    assert standing_kw(driving_hour=4.0, waiting_hour=5.0) == 10.0
    assert standing_kw(driving_hour=4.0, waiting_hour=5.0, standing_hour=1.0) == 2.0
    assert standing_kw(driving_hour=4.0, standing_hour=0.0) == 0.0


def test_the_paper_s_objective_has_no_waits_on_the_way(town: Town) -> None:
    """Its schedule manager shifts departures from depots only."""
    planner, first, second = to_and_fro(town, objective="paper")
    meetings = planner.book.meetings()
    meetings.add(second.traversals)
    assert [i.waits_s for i in alternatives(planner, first, meetings)] == []
    assert longest_wait_s(planner, first) == 0.0


def test_a_wait_makes_no_stop_late_and_nobody_back_late(town: Town) -> None:
    """Of two stops the second has a window, and the van has to be back."""
    stops = [
        {"id": "s0", "node": "33", "service_s": 20.0},
        {"id": "s1", "node": "30", "service_s": 20.0, "latest_s": 400.0},
        {"id": "s2", "node": "33", "service_s": 20.0},
    ]
    vans = [{"return_by_s": 600.0}, {"ready_s": 300.0}]
    problem, snapshot = town(stops, vans)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0, 10.0)
    first = planner.itinerary(0, ("s0", "s1"), planner.legs(0, ("s0", "s1")))
    second = planner.itinerary(1, ("s2", "s1"), planner.legs(1, ("s2",)))
    assert first is not None
    assert second is not None
    legs = planner.legs(0, ("s0", "s1"))
    assert legs is not None
    on_time = planner.itinerary(0, ("s0", "s1"), legs, None, (10.0, 10.0))
    assert on_time is not None
    assert on_time.waits_s == (10.0, 10.0)
    assert planner.itinerary(0, ("s0", "s1"), legs, None, (400.0, 0.0)) is None
    assert planner.itinerary(0, ("s0", "s1"), legs, None, (0.0, 600.0)) is None
    meetings = planner.book.meetings()
    meetings.add(second.traversals)
    found = list(alternatives(planner, first, meetings))
    assert all(i.route is not None and i.route.visits[2].arrival_s <= 410.0 for i in found)
    assert all(i.route is not None and i.route.visits[-1].arrival_s <= 610.0 for i in found)


def test_greedy_scheduling_never_saves_less_and_keeps_routes(town: Town) -> None:
    """Those ready last choose first: all three end up in one platoon, on the routes they had."""
    vans = [{"ready_s": 20.0 * n, "depart_by_s": 20.0 * n + 90.0} for n in range(3)]
    planner, itineraries = planned(town, vans)
    moved = schedule_greedily(planner, itineraries[::-1])
    assert [i.stops for i in moved] == [i.stops for i in itineraries[::-1]]
    before, after = choice_of(planner, itineraries), choice_of(planner, moved)
    assert before.saving_kwh == 0
    one_platoon = sum(
        planner.book.shares[s].leader_kwh + 2 * planner.book.shares[s].follower_kwh
        for s in moved[0].traversals
    )
    assert after.saving_kwh == pytest.approx(one_platoon)
    assert after.cost_kwh == pytest.approx(before.cost_kwh)


def expecting(snapshot: TrafficSnapshot, *, open_now: bool, usual_share: float) -> TrafficSnapshot:
    """All gates as they are now, with the same history."""
    segments = {
        name: replace(
            traffic,
            open=open_now,
            y_e=int(open_now),
            reason=None if open_now else "turbulent",
            age_s=1.0,
            usual_share=usual_share,
        )
        for name, traffic in snapshot.segments.items()
    }
    return replace(snapshot, segments=segments)


@pytest.mark.parametrize(
    ("open_now", "usual_share", "meet"), [(False, 0.9, True), (True, 0.0, False), (True, 0.9, True)]
)
def test_later_meetings_count_as_often_as_gates_are_open_at_the_hour(
    town: Town, open_now: bool, usual_share: float, meet: bool
) -> None:
    """Half an hour ahead a turbulent road is worth a wait if it is usually calm, a calm one is not
    if it is usually turbulent. The saving is the sum over segments with the chance at the entry.
    """
    problem, snapshot = town(["33", "33"], [{"ready_s": 1800.0}, {"ready_s": 1845.0}])
    snapshot = expecting(snapshot, open_now=open_now, usual_share=usual_share)
    problem = replace(problem, price_of_time_kw=0.3)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0, 10.0)
    first, second = (planner.itinerary(n, (f"s{n}",), planner.legs(n, (f"s{n}",))) for n in (0, 1))
    assert first is not None
    assert second is not None
    meetings = planner.book.meetings()
    meetings.add(second.traversals)
    best = best_departure(planner, first, meetings)
    assert (best.waits_s[0] > 0) == meet
    if meet:
        shares = planner.book.shares
        expected = sum(
            (shares[s].leader_kwh + shares[s].follower_kwh)
            * (usual_share + (open_now - usual_share) * math.exp(-passages[0][0] / PERSISTENCE_S))
            for s, passages in best.traversals.items()
            if s in second.traversals
            and passages[0][0] >= second.traversals[s][0][0] - 1e-6
            and passages[0][0] >= best.route.visits[1].departure_s  # type: ignore[union-attr]
        )
        assert meetings.gain_kwh(best.traversals) == pytest.approx(expected)
