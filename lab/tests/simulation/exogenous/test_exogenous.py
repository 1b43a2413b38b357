"""Exogenous evaluation: a recorded day, its gates, and the fleet driven on its speeds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final, cast

import numpy as np
import pytest

from dispatcher_daemon.settings import DispatcherSettings
from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream.energy.consumption import ETA_FOLLOWER, ETA_LEADER, drive_energies
from slipstream.energy.drive import DrivingStyle, plan_drive
from slipstream.roads import RoadNetwork
from slipstream_lab.research.cities.streets import street_network
from slipstream_lab.simulation.closed_loop.dispatch_settings import evaluation_settings
from slipstream_lab.simulation.closed_loop.policy import Gating, Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation import exogenous as study
from slipstream_lab.simulation.evaluation.exogenous import ARMS, exogenous_evaluation
from slipstream_lab.simulation.evaluation.measures.evaluation import Evaluation
from slipstream_lab.simulation.evaluation.measures.figures import measure
from slipstream_lab.simulation.evaluation.report.exogenous import exogenous_tables
from slipstream_lab.simulation.evaluation.runs.world import World, WorldFiles
from slipstream_lab.simulation.exogenous import recorded as recording
from slipstream_lab.simulation.exogenous.day import exogenous_day
from slipstream_lab.simulation.exogenous.passages import RecordedLeg, evaluate, turbulence_kwh
from slipstream_lab.simulation.exogenous.recorded import (
    RecordedTraffic,
    Watched,
    record_background,
    rsus_everywhere,
)
from slipstream_lab.simulation.exogenous.roadside import RecordedRoadside
from slipstream_lab.simulation.ground_truth import TrueWindow
from slipstream_lab.simulation.scenarios.day import DaySpec
from slipstream_lab.simulation.scenarios.defaults import default_demand
from slipstream_lab.simulation.scenarios.demand.deliveries import FleetSettings
from slipstream_lab.simulation.scenarios.perception.observer import Observation
from slipstream_lab.simulation.scenarios.record import SimulatedDay, Statistics, Traffic
from slipstream_lab.simulation.scenarios.scenario import BackgroundTraffic, Scenario

CALM: Final = TrueWindow(12.0, 0.0, 0.03, 0.4, 0.03, 30.0, 6, 1, False)
ROUGH: Final = TrueWindow(5.0, -0.3, 0.1, 2.5, 1.5, None, 9, 0, False)
BASELINE: Final = Policy("B")
STYLE: Final = DrivingStyle()


def cooperative(gating: Gating = "rsu", noise: float = 0.0) -> Policy:
    """A policy with platoons."""
    return Policy("C", frozenset({"platoons", "departures"}), gating=gating, noise=noise)


def quick() -> DispatcherSettings:
    """Short searches."""
    settings = evaluation_settings()
    search = settings.city.search.model_copy(update={"rounds": 1, "iterations_per_stop": 5})
    city = settings.city.model_copy(update={"search": search, "second_rounds": 0, "ways": 1})
    return settings.model_copy(update={"city": city})


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    """A small town."""
    return street_network(
        np.random.default_rng(3),
        60,
        block_m=300.0,
        arterial_every=3,
        one_way_share=0.0,
        signalled_share=0.5,
    )[1]


@pytest.fixture(scope="module")
def scenario(network: RoadNetwork) -> Scenario:
    """A dozen parcels around one in the morning of the small town."""
    fleet = FleetSettings(
        vehicles=4,
        orders=12,
        hours=(0.0, 1.0, *([0.0] * 22)),
        wave_share=1.0,
        wave_s=3600.0,
        capacity=3,
    )
    return Scenario("town", Path("town"), network, default_demand(network), None, fleet)


def a_day(
    network: RoadNetwork,
    windows: dict[str, TrueWindow | None],
    *,
    pace: float = 0.8,
    hours: float = 1.0,
    every_s: float = 60.0,
) -> RecordedTraffic:
    """The same traffic from midnight on: speeds at a share of the limits, windows of a minute."""
    names = tuple(network.segments)
    count = round(hours * 12)
    limits = np.array([network.segments[name].speed_limit_mps for name in names])
    present = np.ones((count, len(names)))
    traffic = Traffic(0.0, 300.0, names, present, present * limits * pace, 0 * present, 0 * present)
    times = np.arange(every_s, hours * 3600 + 1, every_s).tolist()
    seen = [Observation(t, f"rsu-{n}", n, w) for t in times for n, w in windows.items()]
    return RecordedTraffic(traffic, tuple(seen), every_s)


def legs_on(
    network: RoadNetwork, *departures_s: float, path: tuple[str, ...] = ()
) -> list[RecordedLeg]:
    """Vehicles that drive the same way one after the other."""
    path = path or a_way(network)
    lengths = [network.segments[name].length_m for name in path]
    speeds = [network.segments[name].speed_limit_mps for name in path]
    drive = plan_drive(lengths, speeds, STYLE)
    return [
        RecordedLeg(f"van-{i}", 0, 0, path, due_s, due_s, drive, drive.duration_s)
        for i, due_s in enumerate(departures_s)
    ]


def a_way(network: RoadNetwork, count: int = 4) -> tuple[str, ...]:
    """Some segments in a row."""
    way = [sorted(network.segments)[0]]
    while len(way) < count:
        way.append(next(n for n in network.follows[way[-1]] if n not in way))
    return tuple(way)


def test_a_background_is_simulated_once_and_read_back_as_it_was(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second call reads the file; another route file, or a damaged record, is simulated anew."""
    net, routes = tmp_path / "town.net.xml", tmp_path / "town-1.rou.xml"
    net.write_text("net")
    routes.write_text("routes")
    scenario = replace(scenario, net=net)
    names = sorted(scenario.network.segments)
    made = a_day(
        scenario.network,
        {names[0]: CALM, names[1]: replace(ROUGH, mean_gap_m=None), names[2]: None},
        hours=0.5,
    )
    orders: list[DaySpec] = []

    def simulated(order: DaySpec, progress: object) -> SimulatedDay:
        orders.append(order)
        counts = Statistics(1, 1, 0, 0, 0, 0, 0, 0, 0.0, 0.0)
        return SimulatedDay(0.0, 1800.0, counts, made.traffic, (), made.observations, None, 1.0)

    monkeypatch.setattr(recording, "run_day", simulated)
    background = BackgroundTraffic((routes,), ())
    first = record_background(scenario, background, tmp_path, end_s=1800.0)
    again = record_background(scenario, background, tmp_path, end_s=1800.0)
    assert len(orders) == 1
    assert first.observations == again.observations == made.observations
    for name in ("present_s", "distance_m", "waiting_s", "entered"):
        assert np.array_equal(getattr(again.traffic, name), getattr(made.traffic, name))
    assert again.end_s == 1800.0
    routes.write_text("other routes")
    record_background(scenario, background, tmp_path, end_s=1800.0)
    assert len(orders) == 2
    next(tmp_path.glob("*.npz")).write_bytes(b"damaged")
    record_background(scenario, background, tmp_path, end_s=1800.0)
    assert len(orders) == 3
    record_background(scenario, background, tmp_path, watched="everywhere", end_s=1800.0)
    assert [len(order.rsus) for order in orders] == [
        0,
        0,
        0,
        len(rsus_everywhere(scenario.network)),
    ]


def test_everywhere_watches_what_lies_before_the_queues(network: RoadNetwork) -> None:
    """Every segment that is long enough has one stretch, which ends 60 m before its junction."""
    rsus = rsus_everywhere(network)
    watched = {stretch.segment: stretch for rsu in rsus for stretch in rsu.watch}
    long = {name for name, segment in network.segments.items() if segment.length_m >= 120.1}
    assert long <= set(watched)
    assert len(rsus) == len(watched)
    for name, stretch in watched.items():
        length = network.segments[name].length_m
        assert stretch.to_m == pytest.approx(length - 60, abs=0.1)
        assert 0 <= stretch.from_m < stretch.to_m
        assert stretch.to_m - stretch.from_m <= 300.1


@pytest.mark.parametrize("gating", ["rsu", "open", "random"])
def test_gates_open_where_the_policy_lets_them(network: RoadNetwork, gating: Gating) -> None:
    """Reported ones where traffic is calm, open ones wherever is watched, random ones as many as
    are reported; none at all in the baseline; nowhere before the first report."""
    names = sorted(network.segments)[:20]
    windows: dict[str, TrueWindow | None] = {
        name: CALM if i < 8 else ROUGH for i, name in enumerate(names)
    }
    day = a_day(network, windows, hours=0.25)
    roadside = RecordedRoadside(day, network, cooperative(gating), 5)
    snapshot = roadside.snapshot(300.0)
    opened = {name for name, traffic in snapshot.segments.items() if traffic.open}
    reported = set(names[:8])
    if gating == "rsu":
        assert opened == reported
    elif gating == "open":
        assert opened == set(names)
    else:
        assert len(opened) == 8
        assert opened <= set(names)
        assert opened != reported
    assert all(roadside.is_open(name, 300.0) == (name in opened) for name in network.segments)
    assert not any(roadside.is_open(name, 59.0) for name in names)
    closed = RecordedRoadside(day, network, BASELINE, 5)
    assert not any(traffic.open for traffic in closed.snapshot(300.0).segments.values())
    assert closed.counts() == (20, 20, 0, 0)


def test_plans_know_the_speeds_of_the_interval_before(network: RoadNetwork) -> None:
    """Planning speeds are those recorded up to now; a leg finds those of its own departure."""
    name = sorted(network.segments)[0]
    day = a_day(network, {name: CALM}, hours=0.5)
    day.traffic.distance_m[2:] *= 0.5
    roadside = RecordedRoadside(day, network, cooperative(), 1)
    limit = network.segments[name].speed_limit_mps
    assert roadside.snapshot(600.0).segments[name].speed_mps == pytest.approx(0.8 * limit)
    assert roadside.speed_mps(name, 600.0) == pytest.approx(0.4 * limit)
    day.traffic.present_s[:] = 0.0
    assert RecordedRoadside(day, network, BASELINE, 1).speed_mps(name, 0.0) == limit


def test_vehicles_close_together_draft_on_open_segments_alone(network: RoadNetwork) -> None:
    """The first leads, who enters within 3 s follows, a late one drives alone; energies are the
    drives' with exactly these drag reductions."""
    path = a_way(network)
    roadside = RecordedRoadside(
        a_day(network, dict.fromkeys(path[1:3], CALM)), network, cooperative(), 1
    )
    roadside.until(3600.0)
    legs = legs_on(network, 1000.0, 1002.0, 1010.0)
    (first, second, third), disengagements = evaluate(legs, roadside, network, 3.0, 8)
    together = sum(network.segments[name].length_m for name in path[1:3])
    assert first.led_m == second.followed_m == pytest.approx(together)
    assert first.followed_m == second.led_m == 0.0
    assert third.led_m == third.followed_m == 0.0
    assert third.driven == third.alone
    for leg, eta in ((first, ETA_LEADER), (second, ETA_FOLLOWER)):
        whole = drive_energies([legs[0].drive], [[0.0, eta, eta, 0.0]]).sum()
        assert leg.driven.total_kwh == pytest.approx(whole.total_kwh)
        assert leg.alone.total_kwh > leg.driven.total_kwh
        assert sum(leg.losses) == pytest.approx(leg.alone.total_kwh, rel=2e-3)
    assert disengagements == 0


def test_platoons_in_turbulent_traffic_are_violations(network: RoadNetwork) -> None:
    """Where gates are open whatever the traffic does, turbulence is counted, and costs energy."""
    path = a_way(network)
    day = a_day(network, {path[1]: ROUGH, path[2]: CALM})
    roadside = RecordedRoadside(day, network, cooperative("open"), 1)
    roadside.until(3600.0)
    found, disengagements = evaluate(legs_on(network, 1000.0, 1001.0), roadside, network, 3.0, 8)
    assert disengagements == 1
    assert all(leg.turbulent_s > 0 for leg in found)
    calm = RecordedRoadside(
        a_day(network, dict.fromkeys(path[1:3], CALM)), network, cooperative(), 1
    )
    calm.until(3600.0)
    without, _ = evaluate(legs_on(network, 1000.0, 1001.0), calm, network, 3.0, 8)
    extra = turbulence_kwh(roadside, network, path[1], 1100.0, 1120.0)
    assert extra > 0 == turbulence_kwh(roadside, network, path[2], 1100.0, 1120.0)
    for rough, smooth in zip(found, without, strict=True):
        more = rough.driven.acceleration_kwh - smooth.driven.acceleration_kwh
        assert more == pytest.approx(rough.alone.total_kwh - smooth.alone.total_kwh)
        assert more > 0


@pytest.fixture(scope="module")
def calm_day(network: RoadNetwork) -> RecordedTraffic:
    """Four hours in which the whole town is watched and calm."""
    return a_day(network, dict.fromkeys(network.segments, CALM), hours=4.0, every_s=300.0)


@pytest.mark.long
def test_a_fleets_day_is_the_same_again_and_saves_by_platoons(
    scenario: Scenario, calm_day: RecordedTraffic
) -> None:
    """Same arguments, same day; every order is served; in a calm town platoons form as planned,
    and their drag is all that differs from the same drives alone."""
    base = exogenous_day(scenario, calm_day, BASELINE, 4, settings=quick())
    ours = exogenous_day(scenario, calm_day, cooperative(), 4, settings=quick())
    assert ours == exogenous_day(scenario, calm_day, cooperative(), 4, settings=quick())
    for day in (base, ours):
        assert len(day.services) == 12
        assert all(s.begun_s is not None and s.begun_s <= s.latest_s for s in day.services)
    alone, driven = measure(base), measure(ours)
    assert alone.platooned_km == 0.0
    assert alone.driven == alone.alone
    assert driven.platooned_share > 0.02
    assert driven.planned_platooned_km <= driven.platooned_km
    assert driven.disengagements == 0
    assert driven.driven.total_kwh < driven.alone.total_kwh
    assert driven.driven.rolling_kwh == pytest.approx(driven.alone.rolling_kwh, rel=1e-3)
    rounds = {(leg.vehicle, leg.round) for leg in ours.legs}
    assert sum(c.vehicles for c in ours.cycles) == len(rounds)


@pytest.mark.slow
def test_slow_traffic_takes_longer(scenario: Scenario, calm_day: RecordedTraffic) -> None:
    """Legs are driven at the recorded speeds: at half of them, nearly twice as long."""
    slow = a_day(scenario.network, {}, pace=0.4, hours=4.0)
    fast = exogenous_day(scenario, calm_day, BASELINE, 4, settings=quick())
    crawl = exogenous_day(scenario, slow, BASELINE, 4, settings=quick())
    slower, faster = measure(crawl), measure(fast)
    ratio = (slower.travel_h / slower.distance_km) / (faster.travel_h / faster.distance_km)
    assert 1.6 < ratio < 2.1
    assert slower.driven.drag_kwh < 0.4 * faster.driven.drag_kwh


def test_an_evaluations_exogenous_arms_are_kept_and_shown(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each arm once, on a background that is there before it; a second call simulates nothing; the
    tables stand beside the paper's."""
    background = BackgroundTraffic((tmp_path / "town-1.rou.xml",), ())
    seen: list[tuple[str, str]] = []

    class Town:
        provenance = GROUND
        files = WorldFiles("troy")
        folder = tmp_path

        def background(self, seed: int) -> BackgroundTraffic:
            return background

    def apart(
        simulate: object, order: study.ExogenousSpec, source: str, end_s: float, progress: object
    ) -> ArmResult:
        seen.append((order.watched, order.policy.name))
        return make_arm(order.policy, order.seed)

    monkeypatch.setattr(study, "run_in_subprocess", apart)
    monkeypatch.setattr(study, "_recorded", lambda order: seen.append((order.watched, "")))

    def evaluation(watched: Watched) -> Evaluation:
        town = cast(World, Town())
        return exogenous_evaluation(town, watched, (1,), tmp_path, 1, lambda done, whole: None)

    near, everywhere = evaluation("rsus"), evaluation("everywhere")
    for watched, names in ARMS.items():
        mine = [name for where, name in seen if where == watched]
        assert mine == [part for name in names for part in ("", name)]
    seen.clear()
    assert evaluation("rsus").runs == near.runs
    assert seen == []
    day, noise = exogenous_tables(None, near, everywhere)
    assert len(day.columns) == 3 + 4 + 3 == len(day.rows[0])
    assert day.rows[0][1:3] == ("1,420.5", "1,385.2")
    assert "`exogenous-everywhere/arms/B-1.json`" in day.source
    assert len(noise.rows) == 4
    assert "exogenous-rsus/arms" in noise.source
