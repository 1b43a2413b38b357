"""One vehicle behind a real agent: it stands, drives by its plan, serves and comes home."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import libsumo
import pytest

from lab.tests.simulation.fleet.road import (
    LENGTHS,
    SERVICE_S,
    Running,
    ns,
    plan,
    running,
    segments,
    write_line,
)
from slipstream.messages import PlanAcknowledgement, VehiclePosition, VehicleProgress
from slipstream_lab.simulation.fleet import world

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A straight road."""
    return write_line(tmp_path_factory.mktemp("line"))


@pytest.fixture
def town(files: tuple[Path, Path]) -> Iterator[Running]:
    """One vehicle on it."""
    with running(files) as found:
        yield found


def test_a_vehicle_without_a_plan_stands(town: Running) -> None:
    """Nothing is on the road, and it says to the dispatcher where it is."""
    for _ in town.steps_for(30.0):
        assert libsumo.vehicle.getIDCount() == 0
    assert (town.world.tours_begun, town.world.on_road, town.world.unfinished) == (0, 0, 0)
    positions = [message for message in town.sent if isinstance(message, VehiclePosition)]
    assert {(told.vehicle, told.segment) for told in positions} == {("van", "a")}


def test_a_vehicle_that_sumo_has_off_the_road_is_not_asked(
    town: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While SUMO teleports it, it has no lane and no speed; then it goes on. The arm is refused."""
    town.exchange.send_plan(plan(segments("ab", 0), depart_s=0.0))
    town.until(lambda: town.world.on_road == 1 and town.exchange.sensed["van"].front_m > 100.0)
    with monkeypatch.context() as patch:
        patch.setattr(world, "_is_placed", lambda sumo: False)
        seen = town.exchange.sensed["van"]
        for _ in town.steps_for(5.0):
            assert town.exchange.sensed["van"] is seen
    town.until(lambda: town.world.tours_finished == 1)
    (leg,) = town.legs
    assert leg.distance_m == pytest.approx(LENGTHS["a"] + LENGTHS["b"], abs=20.0)


def test_a_tour_goes_from_rest_to_rest_and_home(town: Running) -> None:
    """It leaves when the plan says so, drives its path, serves each stop once and comes home."""
    tour = plan(
        [*segments("a", 0), *segments("b", 1), *segments("c", 2)], "one", "two", depart_s=10.0
    )
    town.exchange.send_plan(tour)
    for _ in town.steps_for(10.0):
        assert town.world.unfinished == 0
    town.until(lambda: town.world.tours_finished == 1)
    first, second, home = town.legs
    assert [leg.path for leg in town.legs] == [("a",), ("b",), ("c",)]
    assert [(leg.round, leg.leg) for leg in town.legs] == [(0, 0), (0, 1), (0, 2)]
    assert 10.0 <= first.departed_s <= 11.5
    assert (first.ready_s, first.due_s) == (10.0, 10.0)
    assert second.ready_s == pytest.approx(first.arrived_s + SERVICE_S, abs=1.0)
    assert second.ready_s <= second.departed_s <= second.ready_s + 2.0
    assert town.world.begun_s == {"one": first.arrived_s, "two": second.arrived_s}
    assert (town.world.again, town.world.tours_begun, town.world.unfinished) == ([], 1, 0)
    for leg, (name, length_m) in zip(town.legs, LENGTHS.items(), strict=True):
        # From its own length behind the front, at the segment's begin, to 5 m before its end.
        assert length_m - 12.0 <= leg.distance_m <= length_m, name
        # It is taken off the road some metres before it stands.
        assert leg.arrived_s - leg.departed_s == pytest.approx(leg.free_s, rel=0.1)
        assert leg.travel_s >= leg.arrived_s - leg.departed_s
        assert leg.driven == leg.alone
        assert 0.1 < 1000 * leg.driven.total_kwh / leg.distance_m < 0.4
        assert sum(leg.losses) == pytest.approx(leg.alone.total_kwh, rel=1e-6)
        assert (leg.led_m, leg.followed_m, leg.stops, leg.turbulent_s) == (0, 0, 0, 0)
    acknowledged = [m for m in town.sent if isinstance(m, PlanAcknowledgement)]
    assert [answer.accepted for answer in acknowledged] == [True]
    told = [message for message in town.sent if isinstance(message, VehicleProgress)][-1]
    assert [(visit.stop, visit.status) for visit in told.visits] == [
        ("one", "served"),
        ("two", "served"),
    ]
    assert home.arrived_s == town.session.time_s


def test_two_stops_at_one_junction_are_served_one_after_the_other(town: Running) -> None:
    """Between them lies no road; each takes its own time, and both are told."""
    town.exchange.send_plan(plan([*segments("a", 0), *segments("bc", 2)], "one", "two"))
    town.until(lambda: town.world.tours_finished == 1)
    assert [leg.path for leg in town.legs] == [("a",), ("b", "c")]
    begun = town.world.begun_s
    assert begun["two"] == pytest.approx(begun["one"] + SERVICE_S, abs=2.0)
    assert town.legs[1].ready_s == pytest.approx(begun["two"] + SERVICE_S, abs=2.0)
    assert town.world.again == []


def test_an_order_that_the_world_does_not_know_is_served_as_planned(
    files: tuple[Path, Path],
) -> None:
    """An order of a caller, or of a run before: its stay is that of its plan, but for waiting."""
    tour = plan([*segments("a", 0), *segments("b", 1), *segments("c", 2)], "own", "other")
    *before, other, depot = tour.stops
    longer = {"departure_ns": other.arrival_ns + ns(50.0) - ns(0.0), "wait_s": 20.0}
    stops = (*before, other.model_copy(update=longer), depot)
    with running(files, service_s={"own": SERVICE_S}.get) as town:
        town.exchange.send_plan(tour.model_copy(update={"stops": stops}))
        town.until(lambda: town.world.tours_finished == 1)
        _, second, home = town.legs
        assert home.ready_s == pytest.approx(second.arrived_s + 30.0, abs=1.0)
        told = [message for message in town.sent if isinstance(message, VehicleProgress)][-1]
        assert {(visit.stop, visit.status) for visit in told.visits} == {
            ("own", "served"),
            ("other", "served"),
        }


def test_a_stop_at_the_depots_junction_is_served_before_the_first_road(town: Running) -> None:
    """The tour is counted from the first leg that has a road."""
    town.exchange.send_plan(plan([*segments("a", 1), *segments("b", 2)], "one", "two"))
    town.until(lambda: town.world.tours_finished == 1)
    begun = town.world.begun_s
    assert begun["one"] <= 6.0
    assert [(leg.path, leg.round, leg.leg) for leg in town.legs] == [(("a",), 0, 0), (("b",), 0, 1)]
    assert town.legs[0].departed_s >= begun["one"] + SERVICE_S
    assert (town.world.tours_begun, town.world.again) == (1, [])


def test_a_second_tour_begins_after_the_first(town: Running) -> None:
    """Vehicles take plans when they are home; here that is where the tour ended."""
    town.exchange.send_plan(plan([*segments("a", 0), *segments("b", 1)], "one"))
    town.until(lambda: town.world.tours_finished == 1)
    for _ in town.steps_for(2.0):
        assert town.world.unfinished == 0
    leaves_s = town.session.time_s + 5.0
    town.exchange.send_plan(plan(segments("c"), "two", cycle=2, depart_s=leaves_s))
    town.until(lambda: "two" in town.world.begun_s)
    last = town.legs[-1]
    assert leaves_s <= last.departed_s <= leaves_s + 1.0
    assert (last.path, last.round, last.leg) == (("c",), 1, 0)
    assert town.world.tours_begun == 2


def test_a_refused_plan_moves_nobody(town: Running) -> None:
    """A plan that has lapsed before it came is answered with a reason, and the vehicle stands."""
    late = plan(segments("a", 0) + segments("b", 1), "one").model_copy(
        update={"valid_until_ns": ns(0.0)}
    )
    town.exchange.send_plan(late)
    for _ in town.steps_for(15.0):
        assert town.world.unfinished == 0
    answers = [message for message in town.sent if isinstance(message, PlanAcknowledgement)]
    assert [(answer.accepted, answer.reason) for answer in answers] == [
        (False, "the plan has lapsed")
    ]


def test_a_continued_plan_keeps_the_stop_that_it_drives_to(town: Running) -> None:
    """Later stops change under way; the leg goes on, the order left out is not served."""
    town.exchange.send_plan(
        plan([*segments("a", 0), *segments("b", 1), *segments("c", 2)], "one", "two")
    )
    for _ in town.steps_for(40.0):
        pass
    town.exchange.send_plan(
        plan([*segments("a", 0), *segments("b", 1)], "depot", "one", cycle=2, continues=1)
    )
    town.until(lambda: town.world.tours_finished == 1)
    assert set(town.world.begun_s) == {"one"}
    assert [leg.path for leg in town.legs] == [("a",), ("b",)]


def test_without_advice_a_vehicle_on_the_road_goes_on_by_its_driver(town: Running) -> None:
    """A silent agent: the vehicle drives to its stop at the limit, serves it and stays there."""
    town.exchange.send_plan(plan([*segments("a", 0), *segments("b", 1)], "one"))
    town.until(lambda: town.world.on_road == 1)
    town.exchange.silent.add("van")
    town.until(lambda: "one" in town.world.begun_s)
    for _ in town.steps_for(2 * SERVICE_S):
        assert town.world.unfinished == 0
    town.exchange.silent.clear()
    town.until(lambda: town.world.on_road == 1, limit_s=30.0)


@pytest.mark.parametrize("pace", [0.8, 1.0])
def test_a_fleet_has_its_pace(files: tuple[Path, Path], pace: float) -> None:
    """A slower fleet takes so much longer, on the same plan."""
    with running(files, pace=pace) as town:
        town.exchange.send_plan(plan([*segments("a", 0), *segments("b", 1)], "one"))
        town.until(lambda: bool(town.legs))
        (leg,) = town.legs
    assert leg.arrived_s - leg.departed_s == pytest.approx(leg.free_s / pace, rel=0.1)


@pytest.mark.parametrize(("planned_until_s", "stands_s"), [(0.0, 120.0), (400.0, None)])
def test_a_vehicle_stands_for_its_breaks(
    town: Running, planned_until_s: float, stands_s: float | None
) -> None:
    """Two in a row, whole although it comes late, and until the planned time where it is early;
    that time counts as planned, not as lost.
    """
    tour = plan([*segments("a", 0), *segments("bc", 3)], "one", "van break 1", "van break 2")
    first, second = (
        stop.model_copy(
            update={
                "is_hub": True,
                "break_s": 60.0,
                "wait_s": 60.0,
                "departure_ns": ns(planned_until_s) + n * 60 * 10**9,
            }
        )
        for n, stop in enumerate(tour.stops[2:4])
    )
    stops = (*tour.stops[:2], first, second, tour.stops[4])
    town.exchange.send_plan(tour.model_copy(update={"stops": stops}))
    town.until(lambda: town.world.tours_finished == 1)
    there, home = town.legs
    assert [leg.path for leg in town.legs] == [("a",), ("b", "c")]
    served_s = there.arrived_s + SERVICE_S
    until_s = planned_until_s + 60.0 if stands_s is None else served_s + stands_s
    assert until_s - 1.0 <= home.departed_s <= until_s + 3.0
    assert home.due_s == pytest.approx(until_s, abs=1.0)
    assert town.world.begun_s == {"one": there.arrived_s}
    assert town.world.again == []
    told = [message for message in town.sent if isinstance(message, VehicleProgress)][-1]
    assert [(visit.stop, visit.status) for visit in told.visits] == [("one", "served")]
