from __future__ import annotations

import numpy as np
import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.roads.costs import expected_traction_n, held_cost_kwh
from dispatcher_daemon.traffic.snapshot import SegmentTraffic
from slipstream.energy.consumption import (
    PAPER_CAR,
    steady_energy_kwh,
)
from slipstream.vehicle_types import RoutingProfile


@pytest.mark.parametrize(("mean", "std"), [(300.0, 900.0), (-500.0, 700.0), (50.0, 1.0)])
def test_expected_traction_is_the_mean_of_the_positive_part(mean: float, std: float) -> None:
    """The closed form agrees with numerical integration of max(0, X) over the normal density."""
    x = np.linspace(mean - 10 * std, mean + 10 * std, 400_001)
    density = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi))
    assert expected_traction_n(mean, std) == pytest.approx(
        np.trapezoid(np.maximum(0, x) * density, x), rel=1e-6
    )


def test_calm_traffic_costs_the_papers_steady_energy(demo: RoutingProblem) -> None:
    """Unless turbulence was measured, c_ij is the paper's formula at the planning speed."""
    segment = demo.network.segments["avenue_west"]
    steady = steady_energy_kwh(segment.length_m, 15.0)
    for y_e in (1, None):
        traffic = SegmentTraffic(
            "avenue_west",
            15.0,
            y_e=y_e,
            measured_speed_mps=15.0,
            mean_acceleration_mps2=0.3,
            acceleration_variance_m2ps4=0.4,
        )
        assert held_cost_kwh(segment, traffic, RoutingProfile()) == steady


def test_turbulent_traffic_costs_more_and_its_mean_acceleration_is_bounded(
    demo: RoutingProblem,
) -> None:
    """Stop-and-go raises the cost; a camera's mean acceleration cannot hold over two kilometres."""
    segment = demo.network.segments["avenue_west"]

    def cost(mean_acceleration: float, variance: float) -> float:
        traffic = SegmentTraffic(
            "avenue_west",
            10.0,
            y_e=0,
            measured_speed_mps=10.0,
            mean_acceleration_mps2=mean_acceleration,
            acceleration_variance_m2ps4=variance,
        )
        return held_cost_kwh(segment, traffic, RoutingProfile())

    steady = steady_energy_kwh(segment.length_m, 10.0)
    assert cost(0.0, 1.0) > 1.5 * steady
    bound = segment.speed_limit_mps**2 / (2 * segment.length_m)
    assert cost(1.0, 0.0) == pytest.approx(
        steady_energy_kwh(segment.length_m, 10.0, mean_acceleration_mps2=bound)
    )
    assert cost(-5.0, 0.0) > 0
    assert PAPER_CAR.rolling_force_n > 0
