"""Brakes of classes and types, and settings that no vehicle has."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, get_args

import pytest

from slipstream.braking import (
    BRAKING,
    GREATEST_MPS2,
    HARDEST_MPS2,
    UNKNOWN_ROAD,
    Braking,
    BrakingClass,
    BrakingData,
    Road,
)
from slipstream.config import check
from slipstream.errors import InputError
from slipstream.vehicle_types import PRESETS, RoutingProfile, VehicleClass, VehicleType

CLASSES: tuple[BrakingClass, ...] = get_args(BrakingClass)
ROADS: tuple[Road, ...] = get_args(Road)
REAL: tuple[BrakingClass, ...] = ("brake_by_wire", "car", "van", "truck")
"""From the best to the worst."""


def test_there_is_every_class() -> None:
    """Read back from its own data it is the same."""
    assert tuple(BRAKING) == CLASSES
    for name, data in BRAKING.items():
        assert check(data.model_dump(), BrakingData, "again") == data
        assert data.preset == name
        assert hash(data) == hash(data.model_copy())


@pytest.mark.parametrize("road", ROADS)
def test_classes_are_in_order(road: Road) -> None:
    """No worse class brakes harder, more surely or sooner than a better one, and none as the ideal
    vehicle does.
    """
    sets = [BRAKING[name].on(road) for name in REAL]
    for better, worse in pairwise(sets):
        assert worse.guaranteed_mps2 <= better.guaranteed_mps2
        assert worse.greatest_mps2 <= better.greatest_mps2
        assert worse.response_s >= better.response_s
        assert worse.error >= better.error
    ideal = BRAKING["ideal"].on(road)
    assert ideal.response_s == ideal.error == ideal.sensing_s == 0.0
    assert ideal.guaranteed_mps2 == ideal.greatest_mps2 == 9.0
    assert all(one.emergency_brake and one.sensing_s == 0.1 for one in sets)


@pytest.mark.parametrize("road", ROADS)
def test_no_class_of_a_road_brakes_harder_than_the_hardest(road: Road) -> None:
    """That is what vehicles reckon with that say nothing."""
    assert max(BRAKING[name].on(road).greatest_mps2 for name in REAL) == HARDEST_MPS2[road]
    assert HARDEST_MPS2[road] < GREATEST_MPS2


@pytest.mark.parametrize("name", REAL)
def test_every_road_is_worse_than_the_one_before(name: BrakingClass) -> None:
    """Dry, wet, snow."""
    dry, wet, snow = (BRAKING[name].on(road) for road in ("dry", "wet", "snow"))
    assert dry.guaranteed_mps2 > wet.guaranteed_mps2 > snow.guaranteed_mps2
    assert dry.greatest_mps2 > wet.greatest_mps2 > snow.greatest_mps2


def test_brakes_on_a_road() -> None:
    """All values of the type, with the decelerations of that road."""
    data = BrakingData.model_validate(
        {
            "guaranteed_mps2": {"dry": 6.0, "wet": 4.0, "snow": 1.0},
            "greatest_mps2": {"dry": 9.0, "wet": 7.0, "snow": 3.0},
            "dead_s": 0.11,
            "lag_s": 0.12,
            "tolerance": 0.13,
            "error": 0.14,
            "sensing_s": 0.15,
            "emergency_brake": False,
        }
    )
    rest = 0.11, 0.12, 0.13, 0.14, 0.15, False
    assert data.on("dry") == Braking(6.0, 9.0, *rest)
    assert data.on("wet") == Braking(4.0, 7.0, *rest)
    assert data.on("snow") == Braking(1.0, 3.0, *rest)


def test_what_is_not_given_is_the_classs() -> None:
    """And without a class the worst one's."""
    slow = check({"preset": "car", "dead_s": 0.3}, BrakingData, "fleet.toml")
    assert slow == BRAKING["car"].model_copy(update={"dead_s": 0.3})
    assert check({}, BrakingData, "fleet.toml") == BRAKING["truck"]


@pytest.mark.parametrize("vehicle_class", get_args(VehicleClass))
def test_a_type_without_brakes_has_those_of_the_worst_of_its_class(
    vehicle_class: VehicleClass,
) -> None:
    """A car's for cars, a van's for those that may be one, else a truck's."""
    expected: BrakingClass = "truck"
    if vehicle_class in ("passenger", "taxi", "evehicle"):
        expected = "car"
    elif vehicle_class in ("authority", "emergency", "delivery"):
        expected = "van"
    assert VehicleType(vehicle_class=vehicle_class).brakes == BRAKING[expected]


def test_plans_count_on_a_wet_road() -> None:
    """Nobody tells the planner how the roads are. No type is ideal unless its table says so."""
    assert UNKNOWN_ROAD == "wet"
    assert RoutingProfile().braking == PRESETS["paper_car"].profile.braking
    assert PRESETS["paper_car"].profile.braking == BRAKING["car"].on("wet")
    assert PRESETS["van"].profile.braking == BRAKING["van"].on("wet")
    assert PRESETS["truck_40t"].profile.braking == BRAKING["truck"].on("wet")
    paper = check({"braking": {"preset": "ideal"}}, VehicleType, "fleet.toml")
    assert paper.profile.braking == BRAKING["ideal"].on("wet")
    assert hash(paper.profile) == hash(paper.model_copy().profile)
    assert hash(paper) == hash(paper.model_copy())


BAD: list[tuple[dict[str, Any], str, str]] = [
    ({"preset": "tram"}, "preset", "give one of them"),
    ({"preset": ["car"]}, "preset", "give one of them"),
    ({"greatest_mps2": {"dry": 11.1, "wet": 8, "snow": 4}}, "greatest_mps2.dry", "11 or less"),
    ({"guaranteed_mps2": {"dry": 5, "wet": 0, "snow": 1}}, "guaranteed_mps2.wet", "more than 0"),
    ({"guaranteed_mps2": {"dry": 5, "wet": -3, "snow": 1}}, "guaranteed_mps2.wet", "more than 0"),
    ({"guaranteed_mps2": {"dry": 5, "wet": 4}}, "guaranteed_mps2.snow", "add it"),
    ({"guaranteed_mps2": {"dry": 5, "wet": 4, "snow": 1, "ice": 1}}, "ice", "remove it"),
    ({"guaranteed_mps2": {"dry": 7.6, "wet": 3, "snow": 1}}, "guaranteed_mps2.dry", "7.5"),
    ({"guaranteed_mps2": {"dry": 5, "wet": 3, "snow": 3.6}}, "guaranteed_mps2.snow", "3.5"),
    ({"dead_s": -0.01}, "dead_s", "0 or more"),
    ({"lag_s": 2.1}, "lag_s", "2 or less"),
    ({"lag_s": float("nan")}, "lag_s", "give a number"),
    ({"tolerance": 0.6}, "tolerance", "0.5 or less"),
    ({"error": -0.1}, "error", "0 or more"),
    ({"sensing_s": "soon"}, "sensing_s", "give a number"),
    ({"emergency_brake": 3}, "emergency_brake", "true or false"),
    ({"brake": 1}, "brake", "remove it"),
]


@pytest.mark.parametrize(("data", "key", "mend"), BAD)
def test_bad_brakes_are_one_line(data: dict[str, Any], key: str, mend: str) -> None:
    """Which names file, key and mend."""
    with pytest.raises(InputError) as error:
        check({"braking": data}, VehicleType, "fleet.toml")
    line = str(error.value)
    assert line.startswith("fleet.toml: braking")
    assert key in line
    assert mend in line
    assert "\n" not in line


def test_equal_decelerations_are_taken() -> None:
    """Guaranteed may be as much as there is, and that as much as tyres hold."""
    most = {"dry": 11, "wet": 6.5, "snow": 3.5}
    taken = check({"guaranteed_mps2": most, "greatest_mps2": most}, BrakingData, "fleet.toml")
    assert taken.on("dry").guaranteed_mps2 == taken.on("dry").greatest_mps2 == 11.0
