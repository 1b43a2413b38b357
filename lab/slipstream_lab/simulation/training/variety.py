"""Vehicles and surroundings drawn far beyond StreetDrive's own (domain randomisation).

What a detector learns on them is not the renderer's few bodies and colours (Tobin et al., IROS
2017; Tremblay et al., CVPRW 2018).
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from slipstream_lab.simulation.streetdrive.rendering import Colour, Image, Material, Mesh, Palette

Floats = NDArray[np.float64]
_LARGE = (Material.PAINT, Material.GLASS)


def any_paint(rng: np.random.Generator) -> Colour:
    """A paint of any hue; greys, white and black are as frequent as on roads."""
    if rng.random() < 0.6:
        tone = float(rng.uniform(15, 245))
        b, g, r = np.clip(tone + rng.normal(0, 6, 3), 5, 250)
    else:
        hsv = np.array([[[rng.uniform(0, 180), rng.uniform(60, 240), rng.uniform(40, 240)]]])
        b, g, r = cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2BGR)[0, 0]
    return (float(b), float(g), float(r))


def any_palette(rng: np.random.Generator) -> Palette:
    """Surfaces of any tone: asphalt to concrete, grass to sand."""

    def tone(low: float, high: float, spread: float) -> Colour:
        b, g, r = np.clip(rng.uniform(low, high) + rng.normal(0, spread, 3), 10, 245)
        return (float(b), float(g), float(r))

    b, g, r = rng.uniform((20, 70, 40), (110, 140, 150))
    verge: Colour = (float(b), float(g), float(r))
    leaf = rng.uniform(0.45, 1.0)
    return Palette(
        asphalt=tone(55, 170, 5),
        verge=verge if rng.random() < 0.75 else tone(80, 190, 14),
        pavement=tone(90, 200, 8),
        marking=tone(170, 240, 6),
        buildings=tuple(tone(70, 220, 18) for _ in range(3)),
        foliage=(verge[0] * leaf, verge[1] * leaf, verge[2] * leaf),
    )


def varied_mesh(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """The vehicle with another body, curved panels, other glass, lamps and wheels, and stickers."""
    mesh = _stickered(mesh, rng)
    mesh = _divided(mesh)
    span = np.array([mesh.length_m, mesh.width_m, mesh.height_m])
    stretch = rng.uniform(0.9, 1.1, 3)
    bends = rng.normal(0, (0.05, 0.035, 0.06, 0.05))

    def bent(points: Floats) -> Floats:
        along, up = points[..., 0] / span[0], points[..., 2] / span[2]
        moved = points.copy()
        moved[..., 0] += bends[0] * span[0] * np.sin(np.pi * np.clip(up, 0, 1))
        moved[..., 1] *= 1 + bends[1] * (2 * up - 1) - abs(bends[2]) * (2 * along) ** 4
        moved[..., 2] *= 1 + bends[3] * np.cos(np.pi * along) * up
        return np.asarray(moved * stretch)

    corners, outline = bent(mesh.corners), bent(mesh.outline)
    panels = np.isin(mesh.materials, _LARGE)
    middle = mesh.corners.mean(axis=1)
    # Normals that turn outwards over the body give flat faces the shading of curved panels.
    bulge = rng.uniform(0.0, 0.5) * (middle - mesh.middle) / (span / 2)
    normals = mesh.normals + np.where(panels[:, None], bulge, 0) + rng.normal(0, 0.03, bulge.shape)
    colours = mesh.colours * rng.uniform(0.93, 1.07, (len(middle), 1))
    for material, low, high in (
        (Material.GLASS, 0.3, 2.6),
        (Material.LAMP, 0.55, 1.05),
        (Material.MATT, 0.5, 1.6),
    ):
        chosen = mesh.materials == material
        colours[chosen] *= rng.uniform(low, high) * rng.uniform(0.92, 1.08, 3)
    return replace(
        mesh,
        length_m=float(np.ptp(outline[:, 0])),
        width_m=mesh.width_m * float(stretch[1]),
        height_m=float(outline[:, 2].max()),
        corners=corners,
        normals=_normals(corners, mesh.normals),
        shading=normals / np.linalg.norm(normals, axis=1)[:, None],
        colours=np.clip(colours, 3, 252),
        outline=outline,
    )


def _normals(corners: Floats, former: Floats) -> Floats:
    """Newell's normals (n, 3) of bent faces, on the same side as before."""
    normals = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    length = np.linalg.norm(normals, axis=1)[:, None]
    normals = np.where(length > 1e-9, normals / np.maximum(length, 1e-9), former)
    return np.asarray(normals * np.where((normals * former).sum(axis=1) < 0, -1, 1)[:, None])


def _divided(mesh: Mesh, along: int = 4, across: int = 2) -> Mesh:
    """Four-cornered panels cut into pieces, each of which is shaded by itself."""
    panels = np.flatnonzero((mesh.sizes == 4) & np.isin(mesh.materials, _LARGE) & ~mesh.minor)
    rest = np.setdiff1d(np.arange(len(mesh.sizes)), panels)
    quad = mesh.corners[panels, :4]
    pieces = []
    for i in range(along):
        for j in range(across):
            a0, a1, b0, b1 = i / along, (i + 1) / along, j / across, (j + 1) / across
            pieces.append(
                np.stack(
                    [_inside(quad, a, b) for a, b in ((a0, b0), (a1, b0), (a1, b1), (a0, b1))],
                    axis=1,
                )
            )
    cut = np.concatenate(pieces)
    corners = np.concatenate([cut, np.repeat(cut[:, 3:4], 8, axis=1)], axis=1)
    order = np.concatenate([rest, np.tile(panels, along * across)])
    return replace(
        mesh,
        corners=np.concatenate([mesh.corners[rest], corners]),
        **{
            name: getattr(mesh, name)[order]
            for name in ("sizes", "normals", "colours", "materials", "parts", "layers", "minor")
        },
    )


def _inside(quad: Floats, a: float, b: float) -> Floats:
    low = quad[:, 0] + a * (quad[:, 1] - quad[:, 0])
    high = quad[:, 3] + a * (quad[:, 2] - quad[:, 3])
    return np.asarray(low + b * (high - low))


def _stickered(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Patches of any colour on the sides and the top: lettering, stripes, roof loads, plates."""
    count = int(rng.poisson(0.8)) if mesh.kind != "motorcycle" else 0
    if count == 0:
        return mesh
    half = np.array([mesh.length_m, mesh.width_m]) / 2
    corners = np.zeros((count, 12, 3))
    normals = np.zeros((count, 3))
    for i in range(count):
        x0 = rng.uniform(-0.8, 0.4) * half[0]
        x1 = x0 + rng.uniform(0.1, 0.5) * half[0]
        z0 = mesh.height_m * rng.uniform(0.25, 0.45)
        z1 = z0 + mesh.height_m * rng.uniform(0.03, 0.15)
        y = float(rng.choice([-1.0, 1.0])) * (half[1] + 0.01)
        corners[i, :4] = [(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)]
        corners[i, 4:] = corners[i, 3]
        normals[i, 1] = np.sign(y)
    top = int(mesh.parts.max())
    return replace(
        mesh,
        corners=np.concatenate([mesh.corners, corners]),
        sizes=np.concatenate([mesh.sizes, np.full(count, 4)]),
        normals=np.concatenate([mesh.normals, normals]),
        colours=np.concatenate([mesh.colours, rng.uniform(10, 245, (count, 3))]),
        materials=np.concatenate([mesh.materials, np.full(count, Material.MATT)]),
        parts=np.concatenate([mesh.parts, np.full(count, top)]),
        layers=np.concatenate([mesh.layers, np.full(count, 5)]),
        minor=np.concatenate([mesh.minor, np.zeros(count, dtype=np.bool_)]),
    )


def uneven_light(image: Image, rng: np.random.Generator) -> Image:
    """Patches of light and shade of any size and colour over the whole picture."""
    height, width = image.shape[:2]
    cells = int(rng.choice([3, 8, 24, 60]))
    coarse = rng.standard_normal((cells, cells * width // height, 1)).astype(np.float32)
    coarse = coarse + 0.25 * rng.standard_normal((*coarse.shape[:2], 3)).astype(np.float32)
    gain = 1 + rng.uniform(0.03, 0.16) * cv2.resize(
        coarse, (width, height), interpolation=cv2.INTER_CUBIC
    )
    return np.asarray(np.clip(image * np.clip(gain, 0.4, 1.6), 0, 255), dtype=np.uint8)
