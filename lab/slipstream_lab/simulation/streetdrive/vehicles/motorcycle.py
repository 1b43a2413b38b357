"""A motorcycle with its rider."""

from __future__ import annotations

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import (
    Colour,
    Corner,
    Material,
    Mesh,
    MeshBuilder,
)
from slipstream_lab.simulation.streetdrive.vehicles.colours import DARK, GLASS, HEADLAMP, TAIL


def build_motorcycle(paint: Colour, rng: np.random.Generator) -> Mesh:
    """A motorcycle with its rider."""
    b = MeshBuilder()
    length, width = rng.uniform(2.0, 2.3), rng.uniform(0.75, 0.9)
    jacket: Colour = tuple(
        float(c) for c in rng.choice([(35, 35, 38), (70, 50, 40), (40, 45, 130)])
    )  # type: ignore[assignment]
    helmet: Colour = tuple(
        float(c) for c in rng.choice([(225, 225, 225), (30, 30, 30), (40, 40, 190)])
    )  # type: ignore[assignment]
    for x in (0.35 * length, -0.35 * length):
        b.wheel(x, 0.06, 0.31, layer=0)
        b.box((x - 0.3, x + 0.3), (-0.06, 0.06), (0.03, 0.55), (35, 35, 35), layer=0)
    b.loft(
        [
            (0.40 * length, 0.10, 0.55, 0.95),
            (0.22 * length, 0.20, 0.40, 1.08),
            (0.00, 0.22, 0.35, 0.98),
            (-0.25 * length, 0.18, 0.45, 0.85),
            (-0.46 * length, 0.08, 0.65, 0.88),
        ],
        paint,
        layer=3,
    )
    b.box((0.26 * length, 0.31 * length), (-width / 2, width / 2), (1.0, 1.06), DARK, layer=4)
    for s in (1.0, -1.0):
        leg = (s * 0.16, s * 0.34)
        b.box((-0.15, 0.3), (min(leg), max(leg)), (0.42, 0.9), (45, 40, 40), layer=5)
        arm = (s * 0.22, s * 0.38)
        b.box((0.05, 0.5), (min(arm), max(arm)), (1.02, 1.2), jacket, layer=6)
    b.loft(
        [
            (0.16, 0.19, 0.85, 1.38),
            (0.0, 0.25, 0.82, 1.42),
            (-0.22, 0.21, 0.82, 1.36),
        ],
        jacket,
        layer=7,
        material=Material.MATT,
    )
    b.loft(
        [(0.22, 0.09, 1.42, 1.62), (0.12, 0.14, 1.38, 1.68), (-0.08, 0.12, 1.4, 1.66)],
        helmet,
        layer=8,
    )
    visor: list[Corner] = [
        (0.23, 0.09, 1.46),
        (0.23, -0.09, 1.46),
        (0.2, -0.09, 1.58),
        (0.2, 0.09, 1.58),
    ]
    b.face(visor, GLASS, (1, 0, 0), material=Material.GLASS, layer=9, minor=True)
    lamp: list[Corner] = [
        (0.41 * length, 0.09, 0.72),
        (0.41 * length, -0.09, 0.72),
        (0.40 * length, -0.09, 0.9),
        (0.40 * length, 0.09, 0.9),
    ]
    b.face(lamp, HEADLAMP, (1, 0, 0), material=Material.LAMP, layer=4)
    tail: list[Corner] = [
        (-0.47 * length, 0.07, 0.72),
        (-0.47 * length, -0.07, 0.72),
        (-0.47 * length, -0.07, 0.84),
        (-0.47 * length, 0.07, 0.84),
    ]
    b.face(tail, TAIL, (-1, 0, 0), material=Material.LAMP, layer=4)
    return b.build("motorcycle", float(length), float(width))
