"""QUEST's energy model beside the paper's."""

from __future__ import annotations

import numpy as np
import pytest

from slipstream.energy import (
    ETA_FOLLOWER,
    PAPER_CAR,
    VehicleParameters,
    drag_saving_kwh,
    steady_energy_kwh,
)
from slipstream.quest import quest_drag_n, quest_energy_kwh

TRUCK = VehicleParameters(mass_kg=20_000.0, drag_coefficient=0.6, frontal_area_m2=9.0)


def test_alone_it_is_the_drag_of_the_papers_model() -> None:
    """Without shelter only drag is left: the steady energy less rolling resistance."""
    rolling = PAPER_CAR.electrical_kwh(PAPER_CAR.rolling_force_n * 1000.0)
    assert float(quest_energy_kwh(1000.0, 25.0)) == pytest.approx(
        steady_energy_kwh(1000.0, 25.0) - rolling, rel=1e-12
    )


def test_the_formula_by_hand() -> None:
    """c_s V² [1 − f (C_b − c_s)] for a car behind a truck, speeds in an array."""
    own, truck, shelter = 0.5 * 1.225 * 0.72, 0.5 * 1.225 * 5.4, 0.1
    speeds = np.array([10.0, 25.0])
    wanted = own * speeds**2 * (1 - shelter * (truck - own))
    assert quest_drag_n(speeds, PAPER_CAR, TRUCK, shelter) == pytest.approx(wanted, rel=1e-12)


def test_equal_vehicles_save_nothing_by_it() -> None:
    """Where the paper's own model gives a follower 20 % of its drag."""
    alone = float(quest_energy_kwh(1000.0, 25.0))
    assert float(quest_energy_kwh(1000.0, 25.0, shelter_mpkg=0.3)) == alone
    assert drag_saving_kwh(1000.0, 25.0, ETA_FOLLOWER) == pytest.approx(0.2 * alone, rel=1e-12)


@pytest.mark.parametrize("shelter", [-0.1, float("nan"), float("inf"), 0.36])
def test_a_shelter_that_pulls_is_refused(shelter: float) -> None:
    """f must leave the follower some drag."""
    with pytest.raises(ValueError, match="shelter_mpkg"):
        quest_drag_n(20.0, PAPER_CAR, TRUCK, shelter)
