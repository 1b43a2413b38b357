"""The vehicle shapes of StreetDrive: saloon, hatch, SUV, van, truck, lorry, bus, motorcycle."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import Colour, Mesh
from slipstream_lab.simulation.streetdrive.vehicles.cars import build_car
from slipstream_lab.simulation.streetdrive.vehicles.heavy import build_bus, build_truck
from slipstream_lab.simulation.streetdrive.vehicles.motorcycle import build_motorcycle

CLASSES = ("car", "truck", "bus", "motorcycle")
"""Detector classes in the order of their numbers."""

CLASS_OF_SHAPE = {
    "saloon": "car",
    "hatch": "car",
    "suv": "car",
    "van": "car",
    "truck": "truck",
    "lorry": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
}

PAINTS: tuple[Colour, ...] = (
    (235, 235, 235),
    (205, 205, 205),
    (150, 150, 150),
    (95, 95, 95),
    (48, 46, 45),
    (30, 28, 28),
    (38, 30, 165),
    (30, 24, 120),
    (150, 85, 35),
    (105, 60, 30),
    (190, 130, 70),
    (75, 95, 50),
    (60, 130, 190),
    (175, 190, 200),
)


_CAR_SIZES: dict[str, tuple[float, float, float]] = {
    "saloon": (4.65, 1.83, 1.45),
    "hatch": (4.10, 1.79, 1.49),
    "suv": (4.60, 1.90, 1.70),
    "van": (5.00, 1.96, 2.00),
}


def build_vehicle(shape: str, rng: np.random.Generator, paints: Sequence[Colour] = PAINTS) -> Mesh:
    """One vehicle of a shape (a key of CLASS_OF_SHAPE) with drawn size and paint. Raises KeyError:
    the shape is unknown.
    """
    jitter = rng.uniform(-12, 12, 3)
    chosen = np.clip(np.asarray(paints[int(rng.integers(len(paints)))]) + jitter, 12, 248)
    paint: Colour = (float(chosen[0]), float(chosen[1]), float(chosen[2]))
    cargo_base = np.clip(
        np.asarray(paints[int(rng.integers(len(paints)))]) * 0.4 + 140 * rng.uniform(0.7, 1.1),
        12,
        248,
    )
    cargo: Colour = (float(cargo_base[0]), float(cargo_base[1]), float(cargo_base[2]))
    if shape in _CAR_SIZES:
        length, width, height = _CAR_SIZES[shape]
        s = rng.uniform(0.95, 1.05, 3)
        return build_car(shape, length * s[0], width * s[1], height * s[2], paint, rng)
    makers: dict[str, Callable[[], Mesh]] = {
        "truck": lambda: build_truck("truck", paint, cargo, rng),
        "lorry": lambda: build_truck("lorry", paint, cargo, rng),
        "bus": lambda: build_bus(paint, rng),
        "motorcycle": lambda: build_motorcycle(paint, rng),
    }
    return makers[shape]()
