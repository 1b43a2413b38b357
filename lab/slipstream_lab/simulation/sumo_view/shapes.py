"""From SUMO's vehicle classes to StreetDrive's vehicle shapes, in SUMO's length and width."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import Mesh
from slipstream_lab.simulation.streetdrive.vehicles import build_vehicle

_CARS: Final = {"saloon": 0.34, "hatch": 0.28, "suv": 0.24, "van": 0.14}
_SHAPES_OF: Final[dict[str, dict[str, float]]] = {
    **dict.fromkeys(
        (
            "passenger",
            "private",
            "evehicle",
            "hov",
            "vip",
            "authority",
            "custom1",
            "custom2",
            "ignoring",
        ),
        _CARS,
    ),
    "taxi": {"saloon": 0.7, "van": 0.3},
    "army": {"truck": 1.0},
    "delivery": {"van": 1.0},
    "emergency": {"van": 1.0},
    "truck": {"truck": 1.0},
    "trailer": {"lorry": 1.0},
    "bus": {"bus": 1.0},
    "coach": {"bus": 1.0},
    "motorcycle": {"motorcycle": 1.0},
    "moped": {"motorcycle": 1.0},
}
_TYPICAL_M: Final = {"saloon": 4.65, "hatch": 4.1, "suv": 4.6, "van": 5.0}
"""Lengths of the car shapes: one that need not be stretched by over a fifth is taken."""


@dataclass(frozen=True)
class Kind:
    """What SUMO says of a vehicle that never changes."""

    vclass: str
    length_m: float
    width_m: float


def is_known(vclass: str) -> bool:
    """Whether there is a shape for a SUMO vehicle class."""
    return vclass in _SHAPES_OF


def mesh_of(kind: Kind, rng: np.random.Generator) -> Mesh:
    """A vehicle of a class in SUMO's length and width, with drawn shape and paint. Raises
    KeyError: there is no shape for the class.
    """
    shares = _SHAPES_OF[kind.vclass]
    fitting = {
        shape: share
        for shape, share in shares.items()
        if shape not in _TYPICAL_M or 0.83 < kind.length_m / _TYPICAL_M[shape] < 1.2
    } or ({"van": 1.0} if kind.length_m > 5.0 else {"hatch": 1.0})
    weights = np.array(list(fitting.values()))
    shape = list(fitting)[int(rng.choice(len(fitting), p=weights / weights.sum()))]
    return build_vehicle(shape, rng).resized(kind.length_m, kind.width_m)
