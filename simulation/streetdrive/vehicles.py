"""The vehicle shapes of StreetDrive: saloon, hatch, SUV, van, truck, lorry, bus, motorcycle."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from simulation.streetdrive.mesh import Colour, Corner, Material, Mesh, MeshBuilder

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

_GLASS: Colour = (46.0, 42.0, 38.0)
_DARK: Colour = (30.0, 30.0, 30.0)
_HEADLAMP: Colour = (235.0, 240.0, 245.0)
_TAIL: Colour = (35.0, 25.0, 190.0)
_PLATE: Colour = (215.0, 220.0, 225.0)


def _ends(b: MeshBuilder, front: list[Corner], rear: list[Corner], part: int = 0) -> None:
    """Lamps, grille and plates on a front and a rear panel (corners: left low, right low, …)."""
    for u in ((0.02, 0.24), (0.76, 0.98)):
        b.decal(front, u, (0.58, 0.9), _HEADLAMP, (1, 0, 0), material=Material.LAMP, part=part)
        b.decal(rear, u, (0.5, 0.88), _TAIL, (-1, 0, 0), material=Material.LAMP, part=part)
    b.decal(front, (0.28, 0.72), (0.45, 0.85), _DARK, (1, 0, 0), part=part)
    b.decal(front, (0.1, 0.9), (0.05, 0.22), _DARK, (1, 0, 0), part=part)
    b.decal(front, (0.39, 0.61), (0.26, 0.4), _PLATE, (1, 0, 0), part=part, minor=True)
    b.decal(rear, (0.38, 0.62), (0.52, 0.72), _PLATE, (-1, 0, 0), part=part, minor=True)
    b.decal(rear, (0.06, 0.94), (0.04, 0.2), _DARK, (-1, 0, 0), part=part)


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
    b.decal(
        front, (0.05, 0.95), (0.04, 0.93), _GLASS, (1, 0, 0.5), material=Material.GLASS, layer=7
    )
    b.decal(rear, (0.08, 0.92), (0.12, 0.9), _GLASS, (-1, 0, 0.5), material=Material.GLASS, layer=7)
    for s in (1.0, -1.0):
        side: list[Corner] = [
            (bf, s * half, z0),
            (br, s * half, z0),
            (rr, s * top, edge),
            (rf, s * top, edge),
        ]
        b.face(side, colour, (0, s, 0.2), layer=6)
        for pane in panes:
            b.decal(side, pane, (0.08, 0.88), _GLASS, (0, s, 0.2), material=Material.GLASS, layer=7)
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


def _car(
    shape: str, length: float, width: float, height: float, paint: Colour, rng: np.random.Generator
) -> Mesh:
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
    b.face(screen, _GLASS, (1, 0, 0.3), material=Material.GLASS, part=part, layer=5)
    front: list[Corner] = [
        (x1 + 0.01, half * 0.92, 0.4),
        (x1 + 0.01, -half * 0.92, 0.4),
        (x1 + 0.01, -half * 0.92, top * 0.42),
        (x1 + 0.01, half * 0.92, top * 0.42),
    ]
    for u in ((0.03, 0.2), (0.8, 0.97)):
        b.decal(front, u, (0.15, 0.45), _HEADLAMP, (1, 0, 0), material=Material.LAMP, part=part)
    b.decal(front, (0.22, 0.78), (0.2, 0.85), _DARK, (1, 0, 0), part=part)
    for s in (1.0, -1.0):
        y = s * (half + 0.01)
        side: list[Corner] = [
            (x1 - 0.35, y, top * 0.5),
            (x1 - length * 0.75, y, top * 0.5),
            (x1 - length * 0.75, y, top * 0.85),
            (x1 - 0.45, y, top * 0.85),
        ]
        b.face(side, _GLASS, (0, s, 0), material=Material.GLASS, part=part, layer=5)
        arm = (s * half, s * (half + 0.22))
        b.box(
            (x1 - 0.2, x1 - 0.05),
            (min(arm), max(arm)),
            (top * 0.5, top * 0.74),
            _DARK,
            part=part,
            layer=6,
            minor=True,
        )


def _truck(shape: str, paint: Colour, cargo: Colour, rng: np.random.Generator) -> Mesh:
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
            b.decal(side, (0.0, 1.0), (0.0, 0.05), _DARK, (0, s, 0), part=2)
        door: list[Corner] = [
            (tail - 0.01, half, low),
            (tail - 0.01, -half, low),
            (tail - 0.01, -half, box_top),
            (tail - 0.01, half, box_top),
        ]
        b.decal(door, (0.485, 0.515), (0.04, 0.97), _DARK, (-1, 0, 0), part=2, minor=True)
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
        b.decal(bumper, u, (0.3, 0.75), _TAIL, (-1, 0, 0), material=Material.LAMP, part=2, layer=4)
    return b.build(shape, float(length), float(width))


def _bus(paint: Colour, rng: np.random.Generator) -> Mesh:
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
    b.face(screen, _GLASS, (1, 0, 0), material=Material.GLASS, layer=5)
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
        b.decal(front, u, (0.2, 0.6), _HEADLAMP, (1, 0, 0), material=Material.LAMP)
        b.decal(rear, u, (0.1, 0.32), _TAIL, (-1, 0, 0), material=Material.LAMP)
    b.decal(rear, (0.1, 0.9), (0.55, 0.92), _GLASS, (-1, 0, 0), material=Material.GLASS)
    b.decal(rear, (0.2, 0.8), (0.12, 0.4), _DARK, (-1, 0, 0))
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
            b.decal(side, u, (0.0, 1.0), _GLASS, (0, s, 0), material=Material.GLASS)
        arm = (s * half, s * (half + 0.25))
        b.box((nose - 0.1, nose + 0.1), (min(arm), max(arm)), (1.7, 2.3), _DARK, layer=6)
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


def _motorcycle(paint: Colour, rng: np.random.Generator) -> Mesh:
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
    b.box((0.26 * length, 0.31 * length), (-width / 2, width / 2), (1.0, 1.06), _DARK, layer=4)
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
    b.face(visor, _GLASS, (1, 0, 0), material=Material.GLASS, layer=9, minor=True)
    lamp: list[Corner] = [
        (0.41 * length, 0.09, 0.72),
        (0.41 * length, -0.09, 0.72),
        (0.40 * length, -0.09, 0.9),
        (0.40 * length, 0.09, 0.9),
    ]
    b.face(lamp, _HEADLAMP, (1, 0, 0), material=Material.LAMP, layer=4)
    tail: list[Corner] = [
        (-0.47 * length, 0.07, 0.72),
        (-0.47 * length, -0.07, 0.72),
        (-0.47 * length, -0.07, 0.84),
        (-0.47 * length, 0.07, 0.84),
    ]
    b.face(tail, _TAIL, (-1, 0, 0), material=Material.LAMP, layer=4)
    return b.build("motorcycle", float(length), float(width))


_CAR_SIZES: dict[str, tuple[float, float, float]] = {
    "saloon": (4.65, 1.83, 1.45),
    "hatch": (4.10, 1.79, 1.49),
    "suv": (4.60, 1.90, 1.70),
    "van": (5.00, 1.96, 2.00),
}


def build_vehicle(shape: str, rng: np.random.Generator, paints: Sequence[Colour] = PAINTS) -> Mesh:
    """One vehicle of a shape (a key of CLASS_OF_SHAPE) with drawn size and paint.

    Raises:
        KeyError: the shape is unknown.
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
        return _car(shape, length * s[0], width * s[1], height * s[2], paint, rng)
    makers: dict[str, Callable[[], Mesh]] = {
        "truck": lambda: _truck("truck", paint, cargo, rng),
        "lorry": lambda: _truck("lorry", paint, cargo, rng),
        "bus": lambda: _bus(paint, rng),
        "motorcycle": lambda: _motorcycle(paint, rng),
    }
    return makers[shape]()
