from __future__ import annotations

import pytest

from slipstream.config import check
from slipstream.energy.consumption import PAPER_CAR
from slipstream.errors import InputError
from slipstream.vehicle_types import PRESETS, RoutingProfile, VehicleType


def test_the_default_is_the_papers_car() -> None:
    """Exactly, so that figures of fleets without types stay what they are."""
    assert VehicleType().profile == RoutingProfile(PAPER_CAR)
    assert PRESETS["paper_car"] == VehicleType()
    assert VehicleType().battery_kwh is None
    assert VehicleType().profile.drafting == "paper"


def test_presets_have_measured_drag_laws() -> None:
    """A type of its own may take another one."""
    assert PRESETS["van"].profile.drafting == "van"
    assert PRESETS["truck_40t"].profile.drafting == "truck"
    box = check({"preset": "van", "drafting": "paper"}, VehicleType, "fleet.toml")
    assert box.profile.drafting == "paper"


def test_a_type_begins_with_its_preset() -> None:
    """What is given replaces the preset's value; read back from its own data it is the same."""
    high = check({"preset": "van", "height_m": 3.1}, VehicleType, "fleet.toml")
    assert high.height_m == 3.1
    assert high.mass_kg == PRESETS["van"].mass_kg
    assert check(high.model_dump(), VehicleType, "again") == high
    assert hash(high) == hash(high.model_copy())


def test_energies_count_the_load_and_roads_the_permitted_mass() -> None:
    """A truck costs energy by what it carries; a bridge bears what it might carry."""
    truck = PRESETS["truck_40t"]
    assert truck.profile.physics.mass_kg == truck.mass_kg + truck.load_kg
    assert truck.profile.gross_mass_kg == 40000.0
    assert truck.payload_kg == 22000.0


@pytest.mark.parametrize(
    ("data", "key"),
    [
        ({"preset": "lorry"}, "preset"),
        ({"mass_kg": -1}, "mass_kg"),
        ({"mass_kg": float("nan")}, "mass_kg"),
        ({"powertrain_efficiency": 1.2}, "powertrain_efficiency"),
        ({"recuperation_efficiency": 2}, "recuperation_efficiency"),
        ({"vehicle_class": "tram"}, "vehicle_class"),
        ({"drafting": "cyclist"}, "drafting"),
        ({"battery_reserve": 1.0}, "battery_reserve"),
        ({"weight": 3}, "weight"),
        ({"preset": "van", "load_kg": 2000}, "gross_mass_kg"),
    ],
)
def test_bad_values_are_one_line(data: dict[str, object], key: str) -> None:
    """Which names the key."""
    with pytest.raises(InputError) as error:
        check(data, VehicleType, "fleet.toml")
    assert key in str(error.value)
    assert "\n" not in str(error.value)
