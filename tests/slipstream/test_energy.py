"""Physics of traction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.energy import (
    ETA_FOLLOWER,
    PAPER_CAR,
    VehicleParameters,
    drag_saving_kwh,
    steady_energy_kwh,
    trace_energy,
    wheel_power_w,
)


def test_steady_power_is_what_the_formula_gives_by_hand() -> None:
    """At 13.9 m/s the paper's car needs 2.95 kW against rolling and 1.18 kW against drag."""
    assert PAPER_CAR.rolling_force_n * 13.9 == pytest.approx(2945, abs=1)
    assert PAPER_CAR.drag_force_n(13.9) * 13.9 == pytest.approx(1184, abs=1)
    assert float(wheel_power_w(13.9, 0.0)) == pytest.approx(4130, abs=2)


def test_braking_costs_nothing_and_gives_nothing_back() -> None:
    """Negative wheel power counts as zero."""
    assert float(wheel_power_w(20.0, -3.0)) == 0.0


def test_a_stop_from_13_4_mps_costs_51_wh_to_drive_off_from() -> None:
    """Driving off to 13.4 m/s costs the kinetic energy over the powertrain's efficiency."""
    speed = np.linspace(0.0, 13.4, 201)
    energy = trace_energy(speed, 0.05)
    assert energy.acceleration_kwh * 1e3 == pytest.approx(51.0, abs=0.1)


@given(
    st.lists(st.floats(0.0, 40.0), min_size=2, max_size=60),
    st.sampled_from([0.1, 0.5, 1.0]),
    st.floats(0.0, 0.3),
)
def test_the_parts_of_the_energy_add_up(speeds: list[float], step_s: float, eta: float) -> None:
    """Rolling, drag and acceleration sum to the total, which is the integral of wheel power."""
    energy = trace_energy(speeds, step_s, eta)
    v = np.array(speeds)
    power = wheel_power_w((v[1:] + v[:-1]) / 2, np.diff(v) / step_s, eta)
    assert energy.total_kwh == pytest.approx(power.sum() * step_s / 3.6e6 / 0.88, abs=1e-12)
    assert energy.rolling_kwh + energy.drag_kwh + energy.acceleration_kwh == pytest.approx(
        energy.total_kwh, abs=1e-12
    )
    assert energy.total_kwh >= 0


@given(st.floats(1.0, 40.0), st.floats(1.0, 5000.0), st.floats(0.0, 0.5))
def test_a_steady_drive_costs_the_same_by_trace_and_by_formula(
    speed: float, distance: float, eta: float
) -> None:
    """c_ij equals the integral at constant speed, and drafting saves exactly s_{e,k,l}."""
    step = distance / speed / 10
    trace = trace_energy(np.full(11, speed), step, eta)
    alone = steady_energy_kwh(distance, speed)
    assert trace.total_kwh == pytest.approx(steady_energy_kwh(distance, speed, eta), rel=1e-9)
    assert alone - trace.total_kwh == pytest.approx(
        drag_saving_kwh(distance, speed, eta), rel=1e-6, abs=1e-12
    )


def test_a_follower_saves_5_7_percent_at_city_speed_and_13_on_a_motorway() -> None:
    """The drafting shares that the literature's 20 % of drag comes to."""
    for speed, share in ((13.9, 0.057), (30.0, 0.130)):
        saved = drag_saving_kwh(1000.0, speed, ETA_FOLLOWER) / steady_energy_kwh(1000.0, speed)
        assert saved == pytest.approx(share, abs=0.001)


@pytest.mark.parametrize("field", ["mass_kg", "drag_coefficient", "powertrain_efficiency"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_vehicles_are_refused(field: str, value: float) -> None:
    """Vehicle data must be positive and finite."""
    with pytest.raises(ValueError, match=field):
        VehicleParameters(**{field: value})
