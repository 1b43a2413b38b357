"""The day's course: energy and platooned distance by time, for the paper's two figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg

Array = npt.NDArray[np.float64]

BIN_S: Final = 300.0
HOUR_S: Final = 3600.0


@dataclass(frozen=True)
class Course:
    """One arm of one seed over its time; arrays of shape (bins,), each for a bin that ends at its
    time.
    """

    ends_s: Array
    energy_kwh: Array
    platooned_km: Array


def day_course(result: ArmResult, bin_s: float) -> Course:
    """Energy and platooned distance by time, those of a leg spread evenly over its time on the
    road; what a leg needs after the last bin counts in the last one.
    """
    first = np.floor(result.begin_s / bin_s) + 1
    last = np.ceil(result.end_s / bin_s)
    ends = np.arange(first, last + 1) * bin_s
    ends[-1] = result.end_s
    return Course(
        ends,
        _spread(result.legs, ends, lambda leg: leg.driven.total_kwh),
        _spread(result.legs, ends, lambda leg: (leg.led_m + leg.followed_m) / 1000),
    )


def _spread(legs: Sequence[DrivenLeg], ends_s: Array, value: Callable[[DrivenLeg], float]) -> Array:
    """Values of legs in bins, by the share of the leg's time that lies in each."""
    done = np.zeros(len(ends_s))
    for leg in legs:
        lasted = max(leg.arrived_s - leg.departed_s, 1e-9)
        share = np.clip((ends_s - leg.departed_s) / lasted, 0.0, 1.0)
        share[-1] = 1.0
        done += value(leg) * share
    return np.diff(done, prepend=0.0)
