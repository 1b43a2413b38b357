"""RSUs in a simulation: where they stand, what they see, and which errors their reports have."""

from slipstream_lab.simulation.scenarios.perception.observer import Observation, Observer
from slipstream_lab.simulation.scenarios.perception.reporter import (
    Reporter,
    fit_errors,
    measured_errors,
    write_errors,
)
from slipstream_lab.simulation.scenarios.perception.rsus import place_rsus

__all__ = [
    "Observation",
    "Observer",
    "Reporter",
    "fit_errors",
    "measured_errors",
    "place_rsus",
    "write_errors",
]
