"""A whole arm: Troy's morning, dispatched, advised and driven."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream_lab.simulation.closed_loop.arm import ArmSpec, home_by_s, run_arm
from slipstream_lab.simulation.closed_loop.policy import LEVERS, Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.measures.figures import measure
from slipstream_lab.simulation.scenarios.scenario import load_scenario, prepare
from storage import open_reader

pytestmark = pytest.mark.long

BEGIN_S, END_S = 36000.0, 37800.0


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> tuple[ArmResult, ArmResult, ArmResult]:
    """Half an hour at ten o'clock: the baseline once, every lever twice."""
    folder = tmp_path_factory.mktemp("arm")
    scenario = load_scenario("troy")
    background = prepare(scenario, 1, folder)
    baseline = Policy("B")
    every = Policy("C+", frozenset(LEVERS) - {"routes"})

    def order(policy: Policy) -> ArmSpec:
        return ArmSpec(
            "troy", background.files, background.rsus, 1, policy, begin_s=BEGIN_S, end_s=END_S
        )

    with ThreadPoolExecutor(2) as threads:
        first, again = threads.map(run_arm, (order(every), order(every)))
    return run_arm(order(baseline)), first, again


@pytest.mark.nightly
def test_the_same_order_gives_the_same_result(results: tuple[ArmResult, ...]) -> None:
    """Every speed, energy and count of an arm is there again, to the last bit."""
    _, first, again = results
    assert first == again
    assert repr(first) == repr(again)


def test_every_order_is_served_once_and_no_vehicle_is_sent_back(
    results: tuple[ArmResult, ...],
) -> None:
    """Each leg begins where its vehicle's last one ended, in the order of legs and tours."""
    segments = load_scenario("troy").network.segments
    for result in results[:2]:
        assert result.served_again == 0
        begun = [service.order for service in result.services if service.begun_s is not None]
        assert len(begun) == len(set(begun)) >= 15
        for vehicle in {leg.vehicle for leg in result.legs}:
            legs = [leg for leg in result.legs if leg.vehicle == vehicle]
            for before, after in pairwise(legs):
                assert segments[before.path[-1]].end == segments[after.path[0]].start
                assert after.departed_s >= before.arrived_s
                follows = (before.round, before.leg + 1), (before.round + 1, 0)
                assert (after.round, after.leg) in follows


def test_arms_do_the_same_work_to_its_end(results: tuple[ArmResult, ...]) -> None:
    """The orders of the half hour are served by all and everybody is at home, whenever that is."""
    for result in results[:2]:
        assert result.unfinished == 0
        assert result.end_s == END_S < result.ended_s
        assert all(service.begun_s is not None for service in result.services)
        last = {leg.vehicle: leg for leg in result.legs}
        homes = {leg.vehicle: leg.path[0] for leg in reversed(result.legs) if leg.leg == 0}
        segments = load_scenario("troy").network.segments
        for vehicle, leg in last.items():
            assert segments[leg.path[-1]].end == segments[homes[vehicle]].start
        assert set(result.opened) <= set(result.watched)
    served = [{s.order for s in result.services} for result in results[:2]]
    assert served[0] == served[1]


def test_an_arm_waits_for_its_last_orders_but_not_beyond_the_day() -> None:
    """An hour after the last one is due; a whole day ends at midnight."""
    fleet = load_scenario("troy").fleet
    due_s = max(fleet.wave_due_s[1], fleet.express_due_s[1])
    assert home_by_s(fleet, END_S) == END_S + due_s + 3600
    assert home_by_s(fleet, 86_400.0) == 86_400.0
    assert home_by_s(fleet, 82_800.0) == 86_400.0


def test_every_leg_is_as_long_as_its_path(results: tuple[ArmResult, ...]) -> None:
    """With its junctions; a vehicle is taken off the road up to 5 m before the end."""
    network = load_scenario("troy").network
    for leg in (leg for result in results[:2] for leg in result.legs):
        length_m = sum(network.segments[name].length_m for name in leg.path)
        length_m += sum(network.crossings[pair].length_m for pair in pairwise(leg.path))
        assert leg.distance_m == pytest.approx(length_m, abs=20.0)


def test_planned_and_driven_platoons_stand_side_by_side(results: tuple[ArmResult, ...]) -> None:
    """Both in kilometres, none of them negative; the baseline has neither."""
    none, some = (measure(result) for result in results[:2])
    assert (none.planned_platooned_km, none.platooned_km) == (0.0, 0.0)
    assert some.planned_platooned_km >= 0.0
    assert some.platooned_km >= 0.0
    assert (none.faults, some.faults) == ((), ())


def test_a_baseline_delivers_alone(results: tuple[ArmResult, ...]) -> None:
    """Vehicles leave the depots, need a car's energy, and nobody drafts or is hurt."""
    baseline, _, _ = results
    assert sum(service.begun_s is not None for service in baseline.services) >= 5
    energy = sum(leg.driven.total_kwh for leg in baseline.legs)
    assert 0.1 < 1000 * energy / sum(leg.distance_m for leg in baseline.legs) < 0.25
    assert all(leg.driven == leg.alone and leg.led_m == 0 for leg in baseline.legs)
    assert all(leg.departed_s >= leg.due_s for leg in baseline.legs)
    assert all(leg.distance_m > 0 and leg.travel_s > 0 for leg in baseline.legs)
    assert (baseline.teleports, baseline.collisions, baseline.emergency_stops) == (0, 0, 0)
    (cycle, *_) = baseline.cycles
    assert cycle.vehicles > 0
    assert cycle.planned_platooned_m == 0


def test_every_lever_saves_energy(results: tuple[ArmResult, ...]) -> None:
    """With advice and priority the same town's deliveries need less for a kilometre."""
    baseline, every, _ = results

    def per_km(result: ArmResult) -> float:
        energy = sum(leg.driven.total_kwh for leg in result.legs)
        return 1000 * energy / sum(leg.distance_m for leg in result.legs)

    assert per_km(every) < 0.95 * per_km(baseline)
    assert (every.teleports, every.collisions, every.emergency_stops) == (0, 0, 0)


def test_an_arm_that_cannot_be_is_refused(tmp_path: Path) -> None:
    """Routes by history without a history, hours that are none, a route file of another net."""
    with pytest.raises(ValueError, match="needs a history"):
        ArmSpec("troy", (tmp_path / "r",), (), 1, Policy("C", frozenset({"routes"})))
    with pytest.raises(ValueError, match="multiple of 300"):
        ArmSpec("troy", (tmp_path / "r",), (), 1, Policy("B"), begin_s=100.0)
    routes = tmp_path / "r.rou.xml"
    routes.write_text(
        '<routes><vehicle id="a" depart="0"><route edges="elsewhere"/></vehicle></routes>'
    )
    with pytest.raises(InputError, match="elsewhere"):
        run_arm(ArmSpec("troy", (routes,), (), 1, Policy("B"), end_s=60.0))


def _check_ledger(database: Path, result: ArmResult) -> None:
    """What the plans were booked with is near what was driven."""
    with open_reader(f"sqlite:///{database}") as reader:
        (whole,) = reader.energy_sums(0, 2**62, by="all")
        cycles = reader.cycles(limit=99)
    # Idle ones are stored too.
    planned_s = {record.time_s for record in result.cycles}
    assert planned_s <= {1e-9 * report.started_ns for report in cycles}
    driven_m = sum(leg.distance_m for leg in result.legs)
    assert whole.distance_m == pytest.approx(driven_m, rel=0.1)
    assert whole.plan_kwh == pytest.approx(sum(leg.alone.total_kwh for leg in result.legs), rel=0.4)
    assert whole.baseline_kwh > 0
    assert whole.platooned_m == 0


@pytest.mark.nightly
def test_vans_stand_for_their_breaks_and_have_a_ledger(tmp_path: Path) -> None:
    """Five minutes to begin within five, of each van: on its tour, at a stop, or at its depot."""
    scenario = load_scenario("troy")
    earliest_s, latest_s, length_s = BEGIN_S + 600.0, BEGIN_S + 900.0, 300.0
    fleet = tmp_path / "fleet.toml"
    shipped = (scenario.net.parent / "fleet.toml").read_text(encoding="utf-8")
    window = f"earliest_s = {earliest_s}\nlatest_s = {latest_s}\n"
    fleet.write_text(f"{shipped}\n[[breaks]]\nduration_s = {length_s}\n{window}")
    end_s = BEGIN_S + 2400.0
    background = prepare(scenario, 1, tmp_path)
    result = run_arm(
        ArmSpec(
            "troy",
            background.files,
            background.rsus,
            1,
            Policy("B"),
            fleet=fleet,
            begin_s=BEGIN_S,
            end_s=end_s,
            database=tmp_path / "day" / "B-1.db",
        )
    )
    _check_ledger(tmp_path / "day" / "B-1.db", result)
    on_tour = 0
    for vehicle in {leg.vehicle for leg in result.legs}:
        legs = [leg for leg in result.legs if leg.vehicle == vehicle]
        stands = [(BEGIN_S, legs[0].departed_s, False), (legs[-1].arrived_s, end_s, False)]
        stands += [(a.arrived_s, b.departed_s, b.leg > 0) for a, b in pairwise(legs)]
        longest = [
            (min(to_s, latest_s + length_s) - max(from_s, earliest_s), is_on_tour)
            for from_s, to_s, is_on_tour in stands
        ]
        stood_s, is_on_tour = max(longest)
        assert stood_s >= length_s - 1.0, vehicle
        on_tour += is_on_tour
    assert on_tour > 0
    assert (result.served_again, result.collisions) == (0, 0)
