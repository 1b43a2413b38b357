"""When meeting pays, and the path that two vehicles share."""

import math
from collections.abc import Callable

import pytest

from slipstream.energy.consumption import (
    PAPER_CAR,
    VehicleParameters,
    drag_saving_kwh,
    steady_energy_kwh,
)
from slipstream.messages import PlannedCrossing, PlatoonControl
from tests.vehicle_agent.platooning.world import planned
from vehicle_agent.leg import Leg
from vehicle_agent.platooning.rendezvous import MARGIN_KWH, best_rendezvous, manoeuvre_kwh
from vehicle_agent.platooning.shared_path import find_shared_path, spacing_m

LENGTHS = {"a": 1000.0, "b": 500.0, "c": 300.0, "d": 200.0}


def leg(names: str = "abcd", crossing_m: float = 0.0) -> Leg:
    """Segments of one letter, with junctions of a length between."""
    crossing = PlannedCrossing(length_m=crossing_m, speed_mps=10.0, yields=False)
    return Leg(
        1,
        0,
        tuple(planned(n, LENGTHS[n]).model_copy(update={"crossing": crossing}) for n in names),
    )


def front(
    path: str, front_m: float, *, crossing: bool = False, speed: float = 0.0
) -> PlatoonControl:
    """A vehicle somewhere on a path."""
    return PlatoonControl(
        vehicle="front",
        sequence=0,
        time_ns=0,
        path=tuple(path),
        crossing=crossing,
        lane=0,
        front_m=front_m,
        length_m=4.6,
        speed_mps=speed,
        acceleration_mps2=0.0,
        announced_mps=speed,
        desired_mps=30.0,
        mode="alone",
        ahead=None,
        leader="front",
        joined_by=None,
        tail_m=4.6,
    )


def test_the_shared_path_goes_from_the_rear_one_to_where_they_part() -> None:
    """Segments and distances, by hand; who is behind, elsewhere or too far shares none."""
    shared = find_shared_path(leg(), 0, 900.0, front("bce", 100.0), 0.0)
    assert shared is not None
    assert shared.spacing_m == pytest.approx(200.0)
    assert shared.parts == (("a", 100.0), ("b", 600.0), ("c", 900.0))
    assert shared.meets == 1
    assert find_shared_path(leg(), 1, 1100.0, front("abcd", 900.0), 0.0) is None
    assert find_shared_path(leg(), 0, 900.0, front("ab", 899.0), 0.0) is None
    assert find_shared_path(leg(), 0, 900.0, front("ef", 10.0), 0.0) is None
    assert find_shared_path(leg(), 0, 0.0, front("cd", 1e9), 0.0) is None
    assert find_shared_path(leg(), 0, 0.0, front("cd", 1e308, speed=1e308), 2.0) is None


def test_junctions_and_the_age_of_a_message_count() -> None:
    """A front one has driven on since it told where it is; junctions have a length."""
    crossings = leg(crossing_m=20.0)
    shared = find_shared_path(crossings, 0, 900.0, front("bc", 100.0, speed=20.0), 0.5)
    assert shared is not None
    assert shared.spacing_m == pytest.approx(100.0 + 20.0 + 100.0 + 10.0)
    inside = spacing_m(crossings, 0, 900.0, front("ab", 8.0, crossing=True), 0.0)
    assert inside == pytest.approx(108.0)
    # The rear one is 19 m into the junction, the front one, by its old message, just beyond it.
    assert spacing_m(crossings, 0, 1025.0, front("bc", 0.0), 0.0) == 0.0
    assert spacing_m(crossings, 1, 1025.0, front("bc", 0.0), 0.0) == math.inf


def test_open_gates_count_from_here_and_beyond() -> None:
    """A run ends at the first closed gate; later open segments count for a meeting alone."""
    shared = find_shared_path(leg(), 0, 900.0, front("abcd", 950.0), 0.0)
    assert shared is not None
    assert shared.open_distance_m(lambda s: s != "c") == pytest.approx(600.0)
    assert shared.open_distance_m(lambda s: s != "a") == 0.0
    assert shared.open_beyond_m(0.0, lambda s: s != "b") == pytest.approx(600.0)
    assert shared.open_beyond_m(350.0, lambda s: s != "c") == pytest.approx(450.0)
    assert shared.open_beyond_m(5000.0, lambda s: True) == 0.0


def test_small_changes_of_speed_cost_nothing_to_first_order() -> None:
    """At the price of time at which v is best, a change by x costs 3 x² of the drag."""
    v, closing_s = 30.0, 60.0
    drag_kwh = PAPER_CAR.electrical_kwh(PAPER_CAR.drag_force_n(v) * v * closing_s)
    for a, b in ((0.05, 0.0), (0.0, 0.05), (0.02, 0.04)):
        price_kw = 2 * PAPER_CAR.electrical_kwh(PAPER_CAR.drag_force_n(v) * v) * 3600
        whole = 0.0
        for change in (a, -b):
            way_m = (1 + change) * v * closing_s
            whole += steady_energy_kwh(way_m, (1 + change) * v) - steady_energy_kwh(way_m, v)
            whole += price_kw * (closing_s - way_m / v) / 3600
        assert manoeuvre_kwh(a, b, v, closing_s, PAPER_CAR) == pytest.approx(whole, rel=1e-9)
        assert whole == pytest.approx(3 * (a**2 + b**2) * drag_kwh, rel=0.05)


def test_a_meeting_is_worth_what_is_left_to_share() -> None:
    """It pays on a long common way and not on one that ends before the gap is closed."""

    def left(way_m: float) -> Callable[[float], float]:
        return lambda begin_m: max(0.0, way_m - begin_m)

    def best(distance_m: float, shared_m: float, max_speedup: float = 0.0) -> float:
        found = best_rendezvous(
            *(distance_m, 30.0, left(shared_m), 0.25), max_speedup=max_speedup, vehicle=PAPER_CAR
        )
        return 0.0 if found is None else found.gain_kwh

    found = best_rendezvous(200.0, 30.0, left(8000.0), 0.25, max_speedup=0.05, vehicle=PAPER_CAR)
    assert found is not None
    assert found.way_m == pytest.approx((1 + found.speedup) * 30.0 * found.closing_s)
    assert found.closing_s * (found.speedup + found.slowdown) * 30.0 == pytest.approx(200.0)
    saved = drag_saving_kwh(8000.0 - found.way_m, 30.0, 0.25)
    cost = manoeuvre_kwh(found.speedup, found.slowdown, 30.0, found.closing_s, PAPER_CAR)
    assert MARGIN_KWH < found.gain_kwh == pytest.approx(saved - cost)
    assert best(200.0, 1200.0) == 0.0
    assert best(800.0, 90000.0) > 0.0
    assert best(1400.0, 90000.0) == 0.0
    assert best(1400.0, 90000.0, max_speedup=0.1) > 0.0
    assert best(200.0, 8000.0) < best(200.0, 8000.0, max_speedup=0.05)


def test_a_vehicle_at_the_limit_asks_to_be_waited_for() -> None:
    """It never speeds up by itself then; below the limit it may, by a tenth at most."""
    for max_speedup, largest in ((0.0, 0.0), (0.03, 0.03), (5.0, 0.1)):
        found = best_rendezvous(
            800.0, 30.0, lambda way_m: 9e4 - way_m, 0.25, max_speedup=max_speedup, vehicle=PAPER_CAR
        )
        assert found is not None
        assert found.speedup <= largest
        assert found.slowdown > 0.0


def test_a_vehicle_with_more_drag_joins_for_less_way() -> None:
    """Its own physics decides."""
    van = VehicleParameters(frontal_area_m2=6.0, drag_coefficient=0.4)

    def gain(vehicle: VehicleParameters) -> float:
        found = best_rendezvous(
            *(200.0, 25.0, lambda way_m: max(0.0, 4000.0 - way_m), 0.2),
            max_speedup=0.0,
            vehicle=vehicle,
        )
        return 0.0 if found is None else found.gain_kwh

    assert gain(van) > 2 * gain(PAPER_CAR) > 0.0
