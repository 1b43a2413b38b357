from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.roads.routes import candidate_arcs, timetable
from dispatcher_daemon.planning.roads.travel import least_energy_legs
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Traffic = Callable[..., TrafficSnapshot]


def test_demo_has_sixteen_arcs_and_both_vans_share_the_avenue_outward(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """Each van goes out over avenue_east in any plan, and returns or crosses over avenue_west."""
    legs = least_energy_legs(demo, traffic())
    assert len(candidate_arcs(demo, legs)) == 16
    assert "avenue_east" in legs["depot", "c1"].path
    assert "avenue_east" in legs["depot", "c3"].path
    assert legs["c1", "c2"].path == ("north_road_west",)
    assert "avenue_west" in legs["c1", "c4"].path
    assert "avenue_west" in legs["c3", "c2"].path


def test_predicted_entry_times_are_exact_where_they_say_so(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """Exact arcs have the times of the finished route; others are never predicted too late."""
    legs = least_energy_legs(demo, traffic())
    arcs = {
        (a.vehicle, a.leg.start, a.leg.end): a for a in candidate_arcs(demo, legs, reference_s=10.0)
    }
    van = demo.fleet.vehicles[1]
    for stops in (("c3",), ("c3", "c4"), ("c3", "c2", "c4"), ("c3", "c4", "c2")):
        route = timetable(demo, legs, van, stops, reference_s=10.0)
        for leg, visit in zip(route.legs, route.visits, strict=False):
            arc = arcs[van.id, leg.start, leg.end]
            if arc.exact:
                assert arc.depart_s == pytest.approx(visit.departure_s)
            else:
                assert arc.depart_s <= visit.departure_s + 1e-9
    assert arcs["van-b", "depot", "c3"].depart_s == 12.0
    exact = {start for (_, start, _), arc in arcs.items() if arc.exact}
    assert exact == {"depot", "c1", "c3"}


def test_timetable_serves_stops_and_joins_up(demo: RoutingProblem, traffic: Traffic) -> None:
    """Segments follow each other without a gap, and each stop takes its service time."""
    legs = least_energy_legs(demo, traffic())
    route = timetable(demo, legs, demo.fleet.vehicles[0], ("c1", "c2"))
    assert [visit.place for visit in route.visits] == ["depot", "c1", "c2", "depot"]
    for visit in route.visits[1:3]:
        assert visit.departure_s - visit.arrival_s == pytest.approx(60.0)
    entries = route.entries_s()
    for (leg, _, _, _, leaving), (next_leg, _, _, entry, _) in pairwise(entries):
        assert entry - leaving == pytest.approx(0.0 if leg == next_leg else 60.0)


def test_turbulence_sends_the_least_energy_path_another_way(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """Measured stop-and-go on the avenue makes the north road the cheaper path back."""
    calm = least_energy_legs(demo, traffic(avenue_west=1))
    turbulent = least_energy_legs(demo, traffic(avenue_west=0))
    assert "avenue_west" in calm["c1", "depot"].path
    assert "avenue_west" not in turbulent["c1", "depot"].path
