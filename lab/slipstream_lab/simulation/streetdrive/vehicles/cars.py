"""Cars as lofted bodies with a glazed cabin: saloon, hatch, SUV and van."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import (
    Colour,
    Corner,
    Material,
    Mesh,
    MeshBuilder,
)
from slipstream_lab.simulation.streetdrive.vehicles.colours import (
    DARK,
    GLASS,
    HEADLAMP,
    PLATE,
    TAIL,
)


def _ends(b: MeshBuilder, front: list[Corner], rear: list[Corner], part: int = 0) -> None:
    """Lamps, grille and plates on a front and a rear panel (corners: left low, right low, …)."""
    for u in ((0.02, 0.24), (0.76, 0.98)):
        b.decal(front, u, (0.58, 0.9), HEADLAMP, (1, 0, 0), material=Material.LAMP, part=part)
        b.decal(rear, u, (0.5, 0.88), TAIL, (-1, 0, 0), material=Material.LAMP, part=part)
    b.decal(front, (0.28, 0.72), (0.45, 0.85), DARK, (1, 0, 0), part=part)
    b.decal(front, (0.1, 0.9), (0.05, 0.22), DARK, (1, 0, 0), part=part)
    b.decal(front, (0.39, 0.61), (0.26, 0.4), PLATE, (1, 0, 0), part=part, minor=True)
    b.decal(rear, (0.38, 0.62), (0.52, 0.72), PLATE, (-1, 0, 0), part=part, minor=True)
    b.decal(rear, (0.06, 0.94), (0.04, 0.2), DARK, (-1, 0, 0), part=part)


def _greenhouse(
    b: MeshBuilder,
    colour: Colour,
    base: tuple[float, float],
    roof: tuple[float, float],
    half: float,
    z: tuple[float, float],
    *,
    panes: Sequence[tuple[float, float]],
    tumblehome: float = 0.80,
) -> None:
    """Cabin with glass: base and roof give front and rear x; panes are u ranges on the sides."""
    (bf, br), (rf, rr), (z0, z1) = base, roof, z
    top = half * tumblehome
    edge = z1 - 0.05
    front: list[Corner] = [(bf, half, z0), (bf, -half, z0), (rf, -top, edge), (rf, top, edge)]
    rear: list[Corner] = [(br, half, z0), (br, -half, z0), (rr, -top, edge), (rr, top, edge)]
    b.face(front, colour, (1, 0, 0.5), layer=6)
    b.face(rear, colour, (-1, 0, 0.5), layer=6)
    b.decal(front, (0.05, 0.95), (0.04, 0.93), GLASS, (1, 0, 0.5), material=Material.GLASS, layer=7)
    b.decal(rear, (0.08, 0.92), (0.12, 0.9), GLASS, (-1, 0, 0.5), material=Material.GLASS, layer=7)
    for s in (1.0, -1.0):
        side: list[Corner] = [
            (bf, s * half, z0),
            (br, s * half, z0),
            (rr, s * top, edge),
            (rf, s * top, edge),
        ]
        b.face(side, colour, (0, s, 0.2), layer=6)
        for pane in panes:
            b.decal(side, pane, (0.08, 0.88), GLASS, (0, s, 0.2), material=Material.GLASS, layer=7)
    inset, cap = 0.1, top - 0.09
    ring: list[Corner] = [(rf, top, edge), (rf, -top, edge), (rr, -top, edge), (rr, top, edge)]
    lid: list[Corner] = [
        (rf - inset, cap, z1),
        (rf - inset, -cap, z1),
        (rr + inset, -cap, z1),
        (rr + inset, cap, z1),
    ]
    outs: list[Corner] = [(1, 0, 1), (0, -1, 1), (-1, 0, 1), (0, 1, 1)]
    for i, out in enumerate(outs):
        j = (i + 1) % 4
        b.face([ring[i], ring[j], lid[j], lid[i]], colour, out, layer=8)
    b.face(lid, colour, (0, 0, 1), layer=9)


def build_car(
    shape: str, length: float, width: float, height: float, paint: Colour, rng: np.random.Generator
) -> Mesh:
    """A saloon, hatch, SUV or van of the given length, width and height in metres."""
    b = MeshBuilder()
    half = width / 2
    belt = {"saloon": 0.64, "hatch": 0.63, "suv": 0.62, "van": 0.60}[shape] * height
    nose = {"saloon": 0.80, "hatch": 0.84, "suv": 0.90, "van": 0.86}[shape] * belt
    tail = {"saloon": 0.97, "hatch": 1.0, "suv": 1.0, "van": 1.0}[shape] * belt
    base, roof = {
        "saloon": ((0.25, -0.37), (0.06, -0.21)),
        "hatch": ((0.27, -0.475), (0.09, -0.35)),
        "suv": ((0.26, -0.48), (0.11, -0.40)),
        "van": ((0.37, -0.49), (0.22, -0.465)),
    }[shape]
    clear = 0.28 if shape == "suv" else 0.2
    cowl = base[0] + 0.01
    stations = [
        (0.500, 0.80, clear + 0.08, nose * 0.80),
        (0.470, 0.92, clear, nose * 0.95),
        (0.380, 0.985, clear, nose * 1.02),
        (cowl, 1.0, clear, belt * 0.98),
        (-0.05, 1.0, clear, belt),
        (-0.36, 0.99, clear, belt * 1.01),
        (-0.465, 0.93, clear + 0.02, tail),
        (-0.500, 0.83, clear + 0.12, tail * 0.86),
    ]
    b.loft([(x * length, w * half, lo, hi) for x, w, lo, hi in stations], paint)
    fx, rx = 0.5 * length + 0.004, -0.5 * length - 0.004
    fh, rh = 0.78 * half, 0.81 * half
    f_low, f_high = clear + 0.08, nose * 0.80
    r_low, r_high = clear + 0.12, tail * 0.86
    _ends(
        b,
        [(fx, fh, f_low), (fx, -fh, f_low), (fx, -fh, f_high), (fx, fh, f_high)],
        [(rx, rh, r_low), (rx, -rh, r_low), (rx, -rh, r_high), (rx, rh, r_high)],
    )
    radius = 0.36 if shape == "suv" else 0.32
    for x in (0.31, -0.29):
        b.wheel(x * length, half * 1.0, radius, layer=1)
    if shape == "van" and rng.random() < 0.6:
        panes: list[tuple[float, float]] = [(0.05, 0.24)]
    elif shape == "saloon":
        panes = [(0.13, 0.46), (0.50, 0.84)]
    else:
        panes = [(0.10, 0.38), (0.42, 0.68), (0.72, 0.93)]
    _greenhouse(
        b,
        paint,
        (base[0] * length, base[1] * length),
        (roof[0] * length, roof[1] * length),
        half * 0.93,
        (belt * 0.97, height),
        panes=panes,
        tumblehome=0.88 if shape == "van" else 0.80,
    )
    for s in (1.0, -1.0):
        y = (s * half * 0.97, s * (half + 0.16))
        b.box(
            (cowl * length - 0.25, cowl * length - 0.1),
            (min(y), max(y)),
            (belt * 0.96, belt * 1.1),
            paint,
            layer=5,
            minor=True,
        )
    return b.build(shape, length, width)
