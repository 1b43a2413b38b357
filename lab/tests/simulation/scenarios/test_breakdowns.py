"""Vehicles that break down: where and when, and what it does to the road behind them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from slipstream.errors import InputError
from slipstream_lab.simulation.rsus import Rsu, WatchedStretch
from slipstream_lab.simulation.scenarios.day import run_day
from slipstream_lab.simulation.scenarios.demand.breakdowns import Breakdown, draw_breakdowns
from slipstream_lab.simulation.scenarios.demand.trips import DemandSettings, Flow, Zone
from slipstream_lab.simulation.scenarios.networks.route_files import check_routes
from slipstream_lab.simulation.scenarios.perception.observer import Observation
from slipstream_lab.simulation.scenarios.record import SimulatedDay
from slipstream_lab.simulation.scenarios.scenario import Scenario, day_spec, prepare

BEGIN_S, END_S = 21600.0, 22800.0
STOPS = Breakdown(
    name="test", segments=("e2_main",), begin_s=(21840.0, 21840.0), duration_s=(3600.0, 3600.0)
)


def test_breakdowns_hang_on_the_seed_and_stay_within_their_ranges(corridor: Scenario) -> None:
    """Place, beginning and length are drawn; the same seed draws the same."""
    kinds = {kind.name: kind for kind in corridor.demand.breakdowns}
    assert set(kinds) == {"morning", "evening"}
    days = [
        draw_breakdowns(corridor.demand.breakdowns, corridor.network, seed, "x")
        for seed in range(40)
    ]
    assert days[3] == draw_breakdowns(corridor.demand.breakdowns, corridor.network, 3, "x")
    for day in days:
        assert [standing.begin_s for standing in day] == sorted(s.begin_s for s in day)
        for standing in day:
            kind = kinds[standing.name]
            assert standing.segment in kind.segments
            assert kind.begin_s[0] <= standing.begin_s <= kind.begin_s[1]
            duration_s = standing.end_s - standing.begin_s
            assert kind.duration_s[0] - 0.2 <= duration_s <= kind.duration_s[1] + 0.2
            assert 400.0 <= standing.at_m < corridor.network.segments[standing.segment].length_m
    for kind in kinds.values():
        drawn = {s.segment for day in days for s in day if s.name == kind.name}
        assert drawn == set(kind.segments)


@pytest.mark.nightly
def test_a_car_that_stands_makes_a_calm_road_turbulent(corridor: Scenario, tmp_path: Path) -> None:
    """A busy motorway is calm; behind a car in the right lane it is slow and turbulent."""
    calm, stopped = (_day(corridor, kinds, tmp_path) for kinds in ((), (STOPS,)))
    assert calm.statistics.inserted + 1 == stopped.statistics.inserted
    assert stopped.statistics.teleports == stopped.statistics.emergency_stops == 0
    assert not any(o.truth is not None and o.truth.y_e == 0 for o in _late(calm))
    behind = [o.truth for o in _late(stopped) if o.truth is not None]
    assert sum(truth.y_e == 0 for truth in behind) > 0.7 * len(behind)
    assert min(truth.mean_speed_mps for truth in behind) < 15.0
    check_routes((tmp_path / "corridor-1.rou.xml",), corridor.network.segments)


@pytest.mark.parametrize(
    ("segment", "problem"),
    [("e99_main", "no segment 'e99_main' in net 'corridor'"), ("e3_join", "e3_join is 35. m long")],
)
def test_a_breakdown_that_does_not_fit_the_net_is_told(
    corridor: Scenario, segment: str, problem: str
) -> None:
    """A segment that is not there, or on which a car could only stand by an emergency stop."""
    odd = STOPS.model_copy(update={"segments": (segment,)})
    with pytest.raises(InputError, match=problem) as error:
        draw_breakdowns((odd,), corridor.network, 1, "mine.toml")
    assert str(error.value).startswith("mine.toml: breakdowns.test")


def test_two_breakdowns_of_one_name_are_told(corridor: Scenario) -> None:
    """They would be two vehicles of one name, which SUMO refuses."""
    with pytest.raises(InputError, match="two breakdowns with this name"):
        draw_breakdowns((STOPS, STOPS), corridor.network, 1, "mine.toml")


def test_a_demand_without_breakdowns_is_told_as_before(corridor: Scenario) -> None:
    """Digests of evaluations that are stored do not hang on a setting that says nothing."""
    assert "breakdowns" in corridor.demand.digest_text()
    calm = corridor.demand.model_copy(update={"breakdowns": ()})
    assert "breakdowns" not in calm.digest_text()


def test_a_range_that_runs_backwards_is_told() -> None:
    """Nobody breaks down between nine and eight."""
    with pytest.raises(ValidationError, match="begin_s: 32400 to 28800 runs backwards"):
        Breakdown(name="x", segments=("s",), begin_s=(32400.0, 28800.0), duration_s=(60.0, 60.0))


def _day(corridor: Scenario, kinds: tuple[Breakdown, ...], folder: Path) -> SimulatedDay:
    """Twenty minutes with 3,200 vehicles an hour from end to end."""
    hours = tuple(1.0 if hour in (5, 6) else 0.0 for hour in range(24))
    flow = Flow(name="through", trips=6400, origin="west", destination="east", hours=hours)
    zones = {name: Zone(junctions={name: 1.0}) for name in ("west", "east")}
    demand = DemandSettings(
        zones=zones, flows=(flow,), types={"car": 0.85, "truck": 0.15}, breakdowns=kinds
    )
    (stands,) = draw_breakdowns((STOPS,), corridor.network, 1, "x")
    behind = WatchedStretch(segment="e2_main", from_m=stands.at_m - 350.0, to_m=stands.at_m - 50.0)
    rsus = (Rsu(id="behind", watch=(behind,)),)
    scenario = replace(corridor, demand=demand, rsus=rsus)
    background = prepare(scenario, 1, folder)
    order = day_spec(scenario, background, folder, begin_s=BEGIN_S, end_s=END_S)
    return run_day(replace(order, window_every_s=60.0, window_s=60.0))


def _late(day: SimulatedDay) -> list[Observation]:
    """Windows of the last seven minutes."""
    return [o for o in day.observations if o.time_s > END_S - 420.0]
