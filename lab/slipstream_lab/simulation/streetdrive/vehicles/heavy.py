"""Trucks, lorries and buses."""

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


def _boxy_cab(
    b: MeshBuilder, x0: float, x1: float, half: float, top: float, paint: Colour, part: int
) -> None:
    """A forward-control cab between x0 and x1 with a raked windscreen."""
    length = x1 - x0
    stations = [
        (x1, half * 0.94, 0.35, top * 0.42),
        (x1 - 0.02, half, 0.35, top * 0.45),
        (x1 - 0.28, half, 0.35, top * 0.95),
        (x1 - 0.5, half, 0.35, top),
        (x0, half, 0.35, top),
    ]
    b.loft(stations, paint, part=part, sill=1.0, shoulder=0.97, waist=0.4)
    screen: list[Corner] = [
        (x1, half * 0.9, top * 0.47),
        (x1, -half * 0.9, top * 0.47),
        (x1 - 0.26, -half * 0.9, top * 0.92),
        (x1 - 0.26, half * 0.9, top * 0.92),
    ]
    b.face(screen, GLASS, (1, 0, 0.3), material=Material.GLASS, part=part, layer=5)
    front: list[Corner] = [
        (x1 + 0.01, half * 0.92, 0.4),
        (x1 + 0.01, -half * 0.92, 0.4),
        (x1 + 0.01, -half * 0.92, top * 0.42),
        (x1 + 0.01, half * 0.92, top * 0.42),
    ]
    for u in ((0.03, 0.2), (0.8, 0.97)):
        b.decal(front, u, (0.15, 0.45), HEADLAMP, (1, 0, 0), material=Material.LAMP, part=part)
    b.decal(front, (0.22, 0.78), (0.2, 0.85), DARK, (1, 0, 0), part=part)
    for s in (1.0, -1.0):
        y = s * (half + 0.01)
        side: list[Corner] = [
            (x1 - 0.35, y, top * 0.5),
            (x1 - length * 0.75, y, top * 0.5),
            (x1 - length * 0.75, y, top * 0.85),
            (x1 - 0.45, y, top * 0.85),
        ]
        b.face(side, GLASS, (0, s, 0), material=Material.GLASS, part=part, layer=5)
        arm = (s * half, s * (half + 0.22))
        b.box(
            (x1 - 0.2, x1 - 0.05),
            (min(arm), max(arm)),
            (top * 0.5, top * 0.74),
            DARK,
            part=part,
            layer=6,
            minor=True,
        )


def build_truck(shape: str, paint: Colour, cargo: Colour, rng: np.random.Generator) -> Mesh:
    """A rigid truck, or an articulated lorry, with a box body or an open bed."""
    b = MeshBuilder()
    articulated = shape == "lorry"
    length = rng.uniform(12.5, 15.5) if articulated else rng.uniform(7.0, 9.5)
    width = rng.uniform(2.4, 2.55)
    half, nose, tail = width / 2, length / 2, -length / 2
    cab_length = rng.uniform(2.0, 2.3)
    cab_top = rng.uniform(2.7, 3.2) if articulated else rng.uniform(2.4, 2.8)
    box_top = rng.uniform(3.3, 3.9) if articulated else rng.uniform(2.8, 3.5)
    gap = 0.7 if articulated else 0.15
    b.box((tail + 0.1, nose - 0.3), (-half * 0.85, half * 0.85), (0.5, 1.0), (52, 50, 50))
    axles = [nose - 1.2, tail + 1.4, tail + 2.6]
    if articulated:
        axles += [nose - cab_length - 1.2, tail + 3.8]
    for x in axles:
        b.wheel(x, half * 0.99, 0.48, layer=2)
    _boxy_cab(b, nose - cab_length, nose, half * 0.97, cab_top, paint, 1)
    front = nose - cab_length - gap
    body = rng.random()
    low = 1.0
    if body < 0.82:
        b.box((tail, front), (-half, half), (low, box_top), cargo, part=2, material=Material.PAINT)
        for s in (1.0, -1.0):
            y = s * (half + 0.01)
            side: list[Corner] = [
                (front, y, low),
                (tail, y, low),
                (tail, y, box_top),
                (front, y, box_top),
            ]
            if rng.random() < 0.5:
                stripe = tuple(float(c) for c in rng.uniform(30, 220, 3))
                v0 = rng.uniform(0.15, 0.6)
                b.decal(side, (0.1, 0.9), (v0, v0 + 0.22), stripe, (0, s, 0), part=2)  # type: ignore[arg-type]
            b.decal(side, (0.0, 1.0), (0.0, 0.05), DARK, (0, s, 0), part=2)
        door: list[Corner] = [
            (tail - 0.01, half, low),
            (tail - 0.01, -half, low),
            (tail - 0.01, -half, box_top),
            (tail - 0.01, half, box_top),
        ]
        b.decal(door, (0.485, 0.515), (0.04, 0.97), DARK, (-1, 0, 0), part=2, minor=True)
    else:
        b.box((tail, front), (-half, half), (low, low + 0.75), cargo, part=2)
        load = tuple(float(c) for c in rng.uniform(60, 130, 3))
        b.box(
            (tail + 0.4, front - 0.4),
            (-half * 0.85, half * 0.85),
            (low + 0.7, low + 1.2),
            load,  # type: ignore[arg-type]
            part=2,
            layer=5,
        )
    bumper: list[Corner] = [
        (tail - 0.02, half, 0.55),
        (tail - 0.02, -half, 0.55),
        (tail - 0.02, -half, 1.0),
        (tail - 0.02, half, 1.0),
    ]
    b.face(bumper, (45, 45, 45), (-1, 0, 0), material=Material.MATT, part=2, layer=3)
    for u in ((0.03, 0.18), (0.82, 0.97)):
        b.decal(bumper, u, (0.3, 0.75), TAIL, (-1, 0, 0), material=Material.LAMP, part=2, layer=4)
    return b.build(shape, float(length), float(width))


def build_bus(paint: Colour, rng: np.random.Generator) -> Mesh:
    """A city bus."""
    b = MeshBuilder()
    length, width = rng.uniform(10.5, 12.5), 2.55
    half, nose, tail, top = width / 2, length / 2, -length / 2, rng.uniform(2.95, 3.3)
    b.loft(
        [
            (nose, half * 0.95, 0.35, top * 0.8),
            (nose - 0.12, half, 0.3, top * 0.97),
            (nose - 0.5, half, 0.3, top),
            (tail + 0.4, half, 0.3, top),
            (tail, half * 0.97, 0.35, top * 0.95),
        ],
        paint,
        sill=1.0,
        shoulder=0.95,
        waist=0.86,
    )
    screen: list[Corner] = [
        (nose + 0.01, half * 0.9, 1.15),
        (nose + 0.01, -half * 0.9, 1.15),
        (nose - 0.02, -half * 0.88, top * 0.8),
        (nose - 0.02, half * 0.88, top * 0.8),
    ]
    b.face(screen, GLASS, (1, 0, 0), material=Material.GLASS, layer=5)
    sign: list[Corner] = [
        (nose - 0.03, half * 0.8, top * 0.82),
        (nose - 0.03, -half * 0.8, top * 0.82),
        (nose - 0.11, -half * 0.8, top * 0.94),
        (nose - 0.11, half * 0.8, top * 0.94),
    ]
    b.face(sign, (25, 120, 190), (1, 0, 0), material=Material.MATT, layer=5)
    front: list[Corner] = [
        (nose + 0.01, half * 0.92, 0.4),
        (nose + 0.01, -half * 0.92, 0.4),
        (nose + 0.01, -half * 0.92, 1.1),
        (nose + 0.01, half * 0.92, 1.1),
    ]
    rear: list[Corner] = [
        (tail - 0.01, half * 0.92, 0.45),
        (tail - 0.01, -half * 0.92, 0.45),
        (tail - 0.01, -half * 0.92, 2.6),
        (tail - 0.01, half * 0.92, 2.6),
    ]
    for u in ((0.03, 0.2), (0.8, 0.97)):
        b.decal(front, u, (0.2, 0.6), HEADLAMP, (1, 0, 0), material=Material.LAMP)
        b.decal(rear, u, (0.1, 0.32), TAIL, (-1, 0, 0), material=Material.LAMP)
    b.decal(rear, (0.1, 0.9), (0.55, 0.92), GLASS, (-1, 0, 0), material=Material.GLASS)
    b.decal(rear, (0.2, 0.8), (0.12, 0.4), DARK, (-1, 0, 0))
    panes = int(length // 1.5)
    for s in (1.0, -1.0):
        y = s * (half + 0.01)
        side: list[Corner] = [
            (nose - 0.3, y, 1.2),
            (tail + 0.3, y, 1.2),
            (tail + 0.3, y * 0.985, top * 0.83),
            (nose - 0.3, y * 0.985, top * 0.83),
        ]
        for i in range(panes):
            u = ((i + 0.06) / panes, (i + 0.94) / panes)
            b.decal(side, u, (0.0, 1.0), GLASS, (0, s, 0), material=Material.GLASS)
        arm = (s * half, s * (half + 0.25))
        b.box((nose - 0.1, nose + 0.1), (min(arm), max(arm)), (1.7, 2.3), DARK, layer=6)
    b.box(
        (-length * 0.3, length * 0.1),
        (-half * 0.7, half * 0.7),
        (top, top + 0.22),
        (200, 200, 200),
        layer=7,
    )
    for x in (nose - 2.6, tail + 2.9):
        b.wheel(x, half, 0.48, layer=2)
    return b.build("bus", float(length), width)
