"""The day's run, its record and its gates; RSUs and what they see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edge_daemon.settings import StabilitySettings
from lab.tests.simulation.scenarios.conftest import BEGIN_S, END_S, Morning
from slipstream.errors import InputError
from slipstream_lab.simulation.closed_loop.history_recording import record_history
from slipstream_lab.simulation.rsus import WatchedStretch, load_rsus
from slipstream_lab.simulation.scenarios.__main__ import main
from slipstream_lab.simulation.scenarios.acceptance import AcceptanceLimits
from slipstream_lab.simulation.scenarios.day import DaySpec, run_day
from slipstream_lab.simulation.scenarios.perception import place_rsus
from slipstream_lab.simulation.scenarios.perception.observer import ObservedVehicle, window_of
from slipstream_lab.simulation.scenarios.record import TripInfo, hours_of
from slipstream_lab.simulation.scenarios.scenario import Scenario, load_scenario

RULE = StabilitySettings().bare()


@pytest.mark.long
def test_a_part_of_the_day_runs_and_is_counted(morning: Morning) -> None:
    """All trips due in the ten minutes come onto the roads, and the tables agree."""
    day, trips = morning.day, morning.background.trips
    assert trips is not None
    due = ((trips.depart_s >= BEGIN_S) & (trips.depart_s < END_S)).sum()
    assert 0 <= due - day.statistics.inserted <= 2
    assert day.traffic.present_s.shape == (2, len(morning.scenario.network.segments))
    assert day.statistics.running > 50
    (hour,) = day.hours
    assert hour.running * 600 == pytest.approx(day.traffic.present_s.sum(), rel=1e-9)
    assert 8.0 < hour.speed_mps < 16.0
    assert 0.2 < hour.stops_per_km < 3.0
    speeds = day.traffic.speed_mps()
    fastest = 1.25 * max(s.speed_limit_mps for s in morning.scenario.network.segments.values())
    assert np.nanmax(speeds) < fastest
    assert np.isnan(speeds[day.traffic.present_s == 0]).all()


@pytest.mark.long
def test_rsus_windows_come_every_minute_from_every_rsu(morning: Morning) -> None:
    """Each RSU gives a window a minute, and traffic on a busy morning shows in some."""
    observations = morning.day.observations
    assert {o.time_s for o in observations} == set(np.arange(BEGIN_S + 60, END_S + 1, 60))
    assert len(observations) == 10 * len(morning.background.rsus)
    seen = [o.truth for o in observations if o.truth is not None]
    assert len(seen) > len(observations) / 3
    assert any(truth.y_e == 1 for truth in seen if truth.vehicles >= 3)


def test_a_window_has_the_edges_features() -> None:
    """Two vehicles at even speeds, one behind the other: the features by hand."""
    stretch = WatchedStretch(segment="s", from_m=100.0, to_m=200.0)
    seen = [
        [
            ObservedVehicle("a", 152.0 + 10 * t, 0, 10.0, 0.0, 4.0),
            ObservedVehicle("b", 132.0 + 12 * t, 0, 12.0, 0.0, 4.0),
            ObservedVehicle("elsewhere", 50.0, 0, 1.0, 3.0, 4.0),
        ]
        for t in range(3)
    ] + [[]]
    window = window_of(stretch, seen, 1.0, RULE)
    assert window is not None
    assert window.vehicles == 2
    assert window.mean_speed_mps == pytest.approx(11.0)
    assert window.speed_std_mps == pytest.approx(1.0)
    assert window.density_veh_per_m == pytest.approx(6 / (4 * 100))
    assert window.mean_gap_m == pytest.approx(np.mean([16.0, 14.0, 12.0]))
    assert window.y_e == 1
    assert window_of(stretch, [[]] * 4, 1.0, RULE) is None


def test_lanes_that_are_not_watched_leave_no_trace() -> None:
    """A vehicle that brakes beside the others is in no feature, and the lanes count from theirs."""
    wide = WatchedStretch(segment="s", from_m=100.0, to_m=200.0)
    through = wide.model_copy(update={"from_lane": 1})
    passing = [ObservedVehicle(f"p{i}", 120.0 + 20 * i, 1, 10.0, 0.0, 4.0) for i in range(3)]
    leaving = ObservedVehicle("leaving", 150.0, 0, 4.0, -2.0, 4.0)
    alone, all_of_them = [passing] * 4, [[*passing, leaving]] * 4
    seen = window_of(through, all_of_them, 1.0, RULE)
    assert seen == window_of(through, alone, 1.0, RULE)
    assert seen == window_of(wide, [[replace(p, lane=0) for p in passing]] * 4, 1.0, RULE)
    turbulent = window_of(wide, all_of_them, 1.0, RULE)
    assert seen is not None
    assert turbulent is not None
    assert (seen.y_e, turbulent.y_e) == (1, 0)


@pytest.mark.long
def test_hours_are_those_of_the_clock(morning: Morning) -> None:
    """Intervals and trips fall into the hour that they begin in, windows into that they end in."""
    traffic = replace(morning.day.traffic, begin_s=3300.0)
    trips = [
        TripInfo("a", 3500.0, 0.0, 100.0, 1000.0, 20.0, 1),
        TripInfo("b", 3700.0, 0, 50.0, 500.0, 0, 0),
    ]
    calm = next(o for o in morning.day.observations if o.truth is not None and o.truth.vehicles > 2)
    assert calm.truth is not None
    windows = [replace(calm, time_s=3600.0, truth=replace(calm.truth, y_e=y_e)) for y_e in (1, 0)]
    windows += [replace(windows[0], time_s=3660.0), replace(calm, time_s=3660.0, truth=None)]
    first, second = hours_of(traffic, trips, 3900.0, windows, 3)
    assert first.running == pytest.approx(traffic.present_s[0].sum() / 300)
    assert second.running == pytest.approx(traffic.present_s[1].sum() / 300)
    assert (first.arrived, first.stops_per_km, first.time_loss_share) == (1, 1.0, 0.2)
    assert (second.arrived, second.stops_per_km) == (1, 0.0)
    assert (first.judged, first.stable_share) == (2, 0.5)
    assert (second.judged, second.stable) == (1, 1)
    assert hours_of(traffic, trips, 3900.0, windows, 99)[0].judged == 0


@pytest.mark.long
def test_gates_name_every_fault(morning: Morning) -> None:
    """A fit day passes; teleports, late departures, vehicles left and a gridlock do not."""
    gates = AcceptanceLimits()
    assert gates.faults(morning.day) == ()
    gates.check(morning.day, "troy")
    bad = replace(morning.day.statistics, teleports=3, mean_depart_delay_s=5.0, running=90)
    sick = replace(morning.day, statistics=replace(bad, waiting=10), end_s=86400.0)
    text = "; ".join(gates.faults(replace(sick, gridlock_s=30600.0)))
    for part in ("gridlock at 08:30", "3 teleports", "5.0 s late", "100 vehicles left"):
        assert part in text
    with pytest.raises(InputError, match="3 teleports"):
        gates.check(sick, "troy")
    few = replace(bad, running=0, mean_depart_delay_s=0.0, inserted=300, collisions=4)
    day = replace(morning.day, statistics=few)
    assert AcceptanceLimits(incidents=0.01).faults(day) == ("4 collisions (at most 3)",)


@pytest.mark.long
def test_gridlock_ends_the_run(corridor: Scenario, tmp_path: Path) -> None:
    """When most vehicles stand for long, the run stops and says when."""
    kind = '<vType id="car" carFollowModel="IDM"/>'
    stop = '<stop lane="e1_on_0" endPos="200" duration="90000" parking="false"/>'
    vehicles = f'<vehicle id="v" type="car" depart="0"><route edges="s1-ts1"/></vehicle>{kind}'
    blocked = "".join(
        f'<vehicle id="b{i}" type="car" depart="{i}"><route edges="ts1-s1 e1_on e1_join"/>'
        f"{stop if i == 0 else ''}</vehicle>"
        for i in range(80)
    )
    routes = tmp_path / "jam.rou.xml"
    routes.write_text(f"<routes>{kind}{vehicles.replace(kind, '')}{blocked}</routes>")
    order = DaySpec(corridor.net, (routes,), tuple(corridor.network.segments), end_s=20_000.0)
    day = run_day(order)
    assert day.gridlock_s is not None
    assert day.end_s == day.gridlock_s < 10_000.0
    assert any(fault.startswith("gridlock") for fault in AcceptanceLimits().faults(day))
    with pytest.raises(InputError, match=r"jam\.rou\.xml: gridlock at 00:30; take fewer trips"):
        record_history(order, corridor.network)


@pytest.mark.long
def test_route_file_of_another_net_is_one_line(troy: Scenario, tmp_path: Path) -> None:
    """It is found before SUMO starts; what SUMO itself refuses is an error that names the file."""
    routes = tmp_path / "other.rou.xml"
    routes.write_text(
        '<routes><vehicle id="v" depart="0"><route edges="nowhere"/></vehicle></routes>'
    )
    with pytest.raises(InputError, match="a route over 'nowhere', which the net has not"):
        load_scenario("troy", routes=(routes,))
    order = DaySpec(troy.net, (routes,), tuple(troy.network.segments), end_s=60.0)
    with pytest.raises(InputError, match=r"other\.rou\.xml: SUMO refuses it: .*'nowhere'"):
        run_day(order)


def test_rsus_off_the_net_are_refused(troy: Scenario, tmp_path: Path) -> None:
    """A segment that does not exist, or a stretch beyond its end, is told with the RSU's name."""
    path = tmp_path / "rsus.toml"
    text = '[[rsus]]\nid = "one"\nwatch = [{{ segment = "{}", from_m = 10.0, to_m = {} }}]\n'
    path.write_text(text.format("nowhere", 20.0))
    with pytest.raises(InputError, match="no segment 'nowhere' in net 'troy'"):
        load_rsus(path, troy.network)
    path.write_text(text.format("4th_adams-4th_liberty", 9000.0))
    with pytest.raises(InputError, match="10 to 9000 m of a segment of 243 m"):
        load_rsus(path, troy.network)
    path.write_text(text.format("4th_adams-4th_liberty", "90.0, from_lane = 9"))
    with pytest.raises(InputError, match="lane 9 of a segment of 2; lanes count from 0"):
        load_rsus(path, troy.network)
    path.write_text(text.format("4th_adams-4th_liberty", 90.0) * 2)
    with pytest.raises(InputError, match="two RSUs with this id"):
        load_rsus(path, troy.network)
    twice = '[[rsus]]\nid = "one"\n' + 2 * (
        '[[rsus.watch]]\nsegment = "4th_adams-4th_liberty"\nfrom_m = 0.0\nto_m = 90.0\n'
    )
    path.write_text(twice)
    with pytest.raises(InputError, match="two stretches of one segment"):
        load_rsus(path, troy.network)


@pytest.mark.long
def test_rsus_are_placed_on_busy_approaches_apart_from_each_other(
    troy: Scenario, morning: Morning
) -> None:
    """The busiest segment that is long enough comes first, the next one stands elsewhere; and so
    Troy's were placed.
    """
    passages = {
        "4th_adams-4th_liberty": 9,
        "3rd_liberty-3rd_adams": 8,
        "hoosick_lord-hoosick_lake": 7,
    }
    rsus = place_rsus(troy.network, passages, 2)
    assert [rsu.watch[0].segment for rsu in rsus] == [
        "4th_adams-4th_liberty",
        "hoosick_lord-hoosick_lake",
    ]
    routes = morning.background.routes
    assert routes is not None
    assert place_rsus(troy.network, routes.passages()) == troy.rsus
    stretch = rsus[0].watch[0]
    length = troy.network.segments[stretch.segment].length_m
    assert stretch.to_m == pytest.approx(length - 60.0, abs=0.1)
    assert stretch.from_m == 0.0
    other = rsus[1].watch[0]
    assert other.to_m - other.from_m == pytest.approx(300.0, abs=0.1)


@pytest.mark.long
def test_the_command_writes_figures_and_tells_bad_input_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`day` writes a JSON and a CSV; an unknown scenario exits with 2 and one line."""
    demand = tmp_path / "demand.toml"
    hours = ", ".join(["1.0"] * 24)
    demand.write_text(
        "[zones.all]\nbase = 1.0\n[types]\ncar = 1.0\n[[flows]]\n"
        f'name = "few"\ntrips = 2000\norigin = "all"\ndestination = "all"\nhours = [{hours}]\n'
    )
    options = ["day", "troy", "--begin", "3", "--end", "3.1", "--out", str(tmp_path)]
    assert main([*options, "--demand", str(demand), "--signals", "fixed"]) == 0
    assert "fit" in capsys.readouterr().out
    assert (tmp_path / "troy-1.json").is_file()
    assert (tmp_path / "troy-1-hours.csv").read_text().startswith("hour,speed_mps,")
    assert main(["day", "atlantis", "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no such scenario" in error
    assert main([*options, "--end", "2"]) == 2


def test_a_users_own_net_needs_nothing_else(corridor: Scenario) -> None:
    """Demand, RSUs and fleet are made up around any net."""
    own = load_scenario("mine", net=corridor.net)
    assert own.rsus is None
    assert own.demand.flows[0].name == "any"
    assert own.fleet.depots == ()
