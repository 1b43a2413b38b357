"""The day's deliveries, and what RSUs report."""

from __future__ import annotations

import numpy as np
import pytest

from dispatcher_daemon.fleet import check_fleet
from slipstream.errors import InputError
from slipstream.messages import Estimate, KinematicFeatures, SegmentState
from slipstream_lab.simulation.ground_truth import TrueWindow
from slipstream_lab.simulation.scenarios.demand.deliveries import (
    FleetSettings,
    draw_deliveries,
    fleet_at,
)
from slipstream_lab.simulation.scenarios.demand.trips import Zone
from slipstream_lab.simulation.scenarios.perception.observer import Observation
from slipstream_lab.simulation.scenarios.perception.reporter import (
    FEATURES,
    Reporter,
    fit_errors,
    measured_errors,
)
from slipstream_lab.simulation.scenarios.scenario import Scenario
from slipstream_lab.simulation.scenarios.sizing import fleet_size

CALM = TrueWindow(13.0, 0.0, 0.03, 0.6, 0.05, 30.0, 5, 1, False)
ROUGH = TrueWindow(5.0, -0.3, 0.1, 2.5, 1.5, 6.0, 9, 0, False)


@pytest.mark.parametrize("name", ["troy", "corridor"])
def test_deliveries_are_the_same_for_a_seed_and_fit_the_net(
    name: str, request: pytest.FixtureRequest
) -> None:
    """Orders come from the seed alone, in the order of release, at places of the net."""
    scenario: Scenario = request.getfixturevalue(name)
    day = draw_deliveries(scenario.fleet, scenario.network, 1)
    assert day == draw_deliveries(scenario.fleet, scenario.network, 1)
    assert day != draw_deliveries(scenario.fleet, scenario.network, 2)
    assert len(day.orders) == scenario.fleet.orders
    releases = [order.release_s for order in day.orders]
    assert releases == sorted(releases)
    assert max(releases) <= scenario.fleet.last_release_s
    waves = [release for release in releases if release % scenario.fleet.wave_s == 0]
    assert len(waves) / len(releases) == pytest.approx(scenario.fleet.wave_share, abs=0.1)
    assert all(order.latest_s > order.release_s + 1800 for order in day.orders)


def test_a_cycles_fleet_holds_what_is_open_then(troy: Scenario) -> None:
    """Released orders that nobody took, vehicles that are in, and times from the moment on."""
    day = draw_deliveries(troy.fleet, troy.network, 1)
    now = 9 * 3600.0
    everything = fleet_at(day, now, {"van-01": now, "van-02": now + 120}, ())
    assert everything is not None
    check_fleet(everything, troy.network, "test")
    released = [order for order in day.orders if order.release_s <= now]
    assert len(everything.stops) == len(released) > 10
    taken = {order.id for order in released[3:]}
    fleet = fleet_at(day, now, {"van-01": now, "van-02": now + 120}, taken)
    assert fleet is not None
    assert {stop.id for stop in fleet.stops} == {order.id for order in released[:3]}
    first, second = fleet.vehicles
    assert (first.ready_s, second.ready_s) == (0.0, 120.0)
    assert second.depart_by_s == 120.0 + troy.fleet.depart_within_s
    assert first.depot != second.depot
    assert fleet_at(day, now, {}, ()) is None
    assert fleet_at(day, 0.0, {"van-01": 0.0}, {order.id for order in day.orders}) is None


def test_breaks_of_a_day_count_from_each_cycle(troy: Scenario) -> None:
    """Each van has them; clock times are refused, and days without breaks are those of before."""
    pause = {"duration_s": 1800.0, "earliest_s": 41400.0, "latest_s": 46800.0}
    settings = FleetSettings.model_validate({**troy.fleet.model_dump(), "breaks": [pause]})
    day = draw_deliveries(settings, troy.network, 1)
    assert day.orders == draw_deliveries(troy.fleet, troy.network, 1).orders
    fleet = fleet_at(day, 43200.0, dict.fromkeys(day.vehicles, 43200.0), ())
    assert fleet is not None
    assert {(own.earliest_s, own.latest_s) for van in fleet.vehicles for own in van.breaks} == {
        (-1800.0, 3600.0)
    }
    assert "breaks" not in troy.fleet.digest_text()
    assert "breaks" in settings.digest_text()
    with pytest.raises(ValueError, match="no clock times"):
        FleetSettings.model_validate({"breaks": [{"duration_s": 1.0, "earliest": "11:30"}]})


def test_size_of_a_small_day_is_that_of_its_rounds(troy: Scenario) -> None:
    """Three orders released together: all served, over at least the way to the farthest."""
    settings = troy.fleet.model_copy(update={"orders": 3, "wave_share": 1.0, "wave_s": 86400.0})
    day = draw_deliveries(settings, troy.network, 1)
    size = fleet_size(day, troy.network)
    assert (size.orders, size.served) == (3, 3)
    assert sum(size.departures) == size.rounds <= 3
    where = troy.network.junctions
    depots = [np.array(where[depot.node]) for depot in day.settings.depots]
    farthest = max(
        min(float(np.hypot(*(np.array(where[o.node]) - depot))) for depot in depots)
        for o in day.orders
    )
    assert size.distance_km >= 2 * farthest / 1000 * 0.98
    assert size.time_h * 3600 > sum(order.service_s for order in day.orders)


def test_fleets_that_do_not_fit_are_told(troy: Scenario) -> None:
    """A depot elsewhere, an order no vehicle can carry, and no customer at all."""
    fleet, network = troy.fleet, troy.network
    depot = fleet.depots[0].model_copy(update={"node": "atlantis"})
    with pytest.raises(InputError, match=r"depots\.south: no junction 'atlantis'"):
        draw_deliveries(fleet.model_copy(update={"depots": (depot,)}), network, 1)
    with pytest.raises(InputError, match="parcels"):
        draw_deliveries(fleet.model_copy(update={"parcels": (1, 99)}), network, 1)
    with pytest.raises(InputError, match="no place has a customer"):
        draw_deliveries(fleet.model_copy(update={"stops": Zone()}), network, 1)


def test_a_fleet_without_depots_gets_two_far_apart(troy: Scenario) -> None:
    """On a net of which nothing is known, depots come from the seed."""
    fleet = troy.fleet.model_copy(update={"depots": ()})
    day = draw_deliveries(fleet, troy.network, 7)
    one, two = (np.array(troy.network.junctions[d.node]) for d in day.settings.depots)
    assert np.hypot(*(one - two)) > 3000.0


def _look(truth: TrueWindow | None, time_s: float = 60.0) -> Observation:
    return Observation(time_s, "rsu", "segment", truth)


def test_without_errors_the_truth_is_reported() -> None:
    """The features as they are, and the edge's own judgement of them."""
    reporter = Reporter(None, 1)
    calm, rough = reporter.report(_look(CALM)), reporter.report(_look(ROUGH))
    assert calm.features is not None
    for name in FEATURES:
        assert getattr(calm.features, name).value == getattr(CALM, name)
    assert (calm.y_e, rough.y_e) == (1, 0)
    nobody = reporter.report(_look(None))
    assert (nobody.y_e, nobody.reason) == (None, "too_few_vehicles")
    assert reporter.report(_look(ROUGH)).sequence == 4


def test_each_rsu_keeps_its_flags_for_as_long_as_it_is_set_to() -> None:
    """On an empty road; one that is not set to does not."""
    windows = [(CALM, 60.0), (None, 120.0), (None, 180.0), (None, 240.0)]

    def flags(keep_s: dict[str, float]) -> list[int | None]:
        reporter = Reporter(None, 1, keep_s=keep_s)
        return [reporter.report(_look(truth, time_s)).y_e for truth, time_s in windows]

    assert flags({"rsu": 120.0}) == [1, 1, 1, None]
    assert flags({"other": 120.0}) == [1, None, None, None]


@pytest.mark.slow
def test_errors_have_the_measured_bias_and_spread() -> None:
    """Over many windows, reported speeds and variances scatter as the model says."""
    errors = measured_errors()
    states = [Reporter(errors, seed).report(_look(CALM)) for seed in range(1500)]
    made = [state.features for state in states if state.features is not None]
    assert len(made) >= len(states) * (1 - errors.lost_share) - 30
    speed = np.array([f.mean_speed_mps.value for f in made]) / CALM.mean_speed_mps - 1
    model = errors.calm.features["mean_speed_mps"]
    assert speed.mean() == pytest.approx(model.bias, abs=4 * model.std / np.sqrt(1500))
    assert speed.std() == pytest.approx(model.std, rel=0.1)
    acceleration = np.array([f.mean_acceleration_mps2.value for f in made])
    density = np.array([f.density_veh_per_m.value for f in made])
    wanted = errors.calm.correlation[1][2]
    assert np.corrcoef(acceleration, density)[0, 1] == pytest.approx(wanted, abs=0.1)
    assert all(f.acceleration_variance_m2ps4.value >= 0 for f in made)


def test_errors_hang_on_seed_place_and_time_alone() -> None:
    """Whatever else was reported before, a window gets the same errors."""
    errors = measured_errors()
    one, other = Reporter(errors, 1), Reporter(errors, 1)
    other.report(_look(ROUGH, 10.0))
    a, b = one.report(_look(CALM)), other.report(_look(CALM))
    assert a.features == b.features
    assert one.report(_look(CALM, 70.0)).features != a.features
    assert Reporter(errors, 2).report(_look(CALM)).features != a.features


def test_noise_scales_features_on_top() -> None:
    """The paper's noise multiplies each feature by 1 + level times a normal draw."""
    speeds = [
        state.features.mean_speed_mps.value
        for seed in range(800)
        if (state := Reporter(None, seed, noise=0.2).report(_look(CALM))).features is not None
    ]
    assert np.std(speeds) / CALM.mean_speed_mps == pytest.approx(0.2, rel=0.12)
    with pytest.raises(ValueError, match="noise"):
        Reporter(None, 1, noise=-0.1)


def _state(truth: TrueWindow, off: float) -> SegmentState:
    features = KinematicFeatures(
        **{
            name: Estimate(value=getattr(truth, name) * (1 + off), standard_error=0.5)
            for name in FEATURES
        }
    )
    return SegmentState(
        rsu="r",
        segment="s",
        sequence=0,
        time_ns=0,
        window_s=10.0,
        features=features,
        y_e=truth.y_e,
        reason=None,
        vehicles=5,
        frames=300,
        coverage=1.0,
    )


def test_error_model_is_fitted_to_pairs_of_state_and_truth() -> None:
    """Biases and spreads come out of the pairs as they went in; too few are refused."""
    rng = np.random.default_rng(1)
    pairs = [
        (_state(truth, off), truth)
        for truth in (CALM, ROUGH)
        for off in rng.normal(0.05, 0.02, 300).tolist()
    ]
    fitted = fit_errors(pairs, "test")
    for regime in (fitted.calm, fitted.turbulent):
        assert regime.windows == 300
        assert regime.features["density_veh_per_m"].bias == pytest.approx(0.05, abs=0.005)
        assert regime.features["density_veh_per_m"].std == pytest.approx(0.02, rel=0.15)
        assert regime.correlation[0][5] == pytest.approx(1.0)
    assert fitted.calm.features["mean_speed_mps"].standard_error == pytest.approx(0.5 / 13.0)
    assert fitted.lost_share == 0.0
    with pytest.raises(InputError, match="turbulent windows are too few"):
        fit_errors(pairs[:310], "test")
