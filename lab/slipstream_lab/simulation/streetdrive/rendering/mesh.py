"""Polygon meshes of vehicles: parts, layers and decals, without any drawing.

A vehicle's own axes: x forward, y left, z up, origin on the ground under its centre, metres.
A face belongs to a part (parts are painted from far to near) and to a layer (within a part,
layers are painted in order, so that a decal lies on the panel that it decorates).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Corner = tuple[float, float, float]
Colour = tuple[float, float, float]


class Material(IntEnum):
    """How a face answers to light."""

    PAINT = 0
    MATT = 1
    GLASS = 2
    LAMP = 3


@dataclass(frozen=True)
class Mesh:
    """Faces of one vehicle, packed for vectorised projection.

    `corners` is (faces, 12, 3): shorter faces repeat their last corner. `sizes` is (faces,).
    """

    kind: str
    length_m: float
    width_m: float
    height_m: float
    corners: Floats
    sizes: NDArray[np.int64]
    normals: Floats
    colours: Floats
    materials: NDArray[np.int64]
    parts: NDArray[np.int64]
    layers: NDArray[np.int64]
    minor: NDArray[np.bool_]
    outline: Floats
    shading: Floats | None = None
    """Normals that light falls on where they differ from the faces' own, as on curved panels."""

    @cached_property
    def middle(self) -> Floats:
        """Mean of all faces' corners, (3,)."""
        return np.asarray(self.corners.reshape(-1, 3).mean(axis=0))

    @cached_property
    def has_lamps(self) -> bool:
        """Whether it is a vehicle with lamps."""
        return bool((self.materials == Material.LAMP).any())

    def resized(self, length_m: float, width_m: float) -> Mesh:
        """The same vehicle stretched to a length and a width; its height stays."""
        scale = np.array([length_m / self.length_m, width_m / self.width_m, 1.0])
        normals = self.normals / scale
        return replace(
            self,
            length_m=length_m,
            width_m=width_m,
            corners=self.corners * scale,
            normals=normals / np.linalg.norm(normals, axis=1)[:, None],
            outline=self.outline * scale,
        )


@dataclass
class MeshBuilder:
    """Collects faces; `build` packs them. Faces turn their front to the outside by construction."""

    _faces: list[tuple[list[Corner], Colour, Material, int, int, bool, Corner]] = field(
        default_factory=list
    )

    def face(
        self,
        corners: list[Corner],
        colour: Colour,
        outward: Corner,
        *,
        material: Material = Material.PAINT,
        part: int = 0,
        layer: int = 0,
        minor: bool = False,
    ) -> None:
        """Add a polygon of 3 to 12 corners whose normal points to the side of `outward`."""
        self._faces.append((corners, colour, material, part, layer, minor, outward))

    def loft(
        self,
        stations: list[tuple[float, float, float, float]],
        colour: Colour,
        *,
        part: int = 0,
        layer: int = 0,
        sill: float = 0.93,
        shoulder: float = 0.93,
        waist: float = 0.55,
        material: Material = Material.PAINT,
    ) -> None:
        """A body from stations (x, half width, bottom z, top z) given from the front backwards.

        Each cross-section is widest at `waist` of its height and narrows to `sill` and `shoulder`.
        """
        rings = []
        for x, half, low, high in stations:
            mid = low + waist * (high - low)
            rings.append([(x, half * sill, low), (x, half, mid), (x, half * shoulder, high)])
        for front, back in pairwise(rings):
            for a, b in ((0, 1), (1, 2)):
                quad = [front[a], front[b], back[b], back[a]]
                self.face(quad, colour, (0, 1, 0), part=part, layer=layer, material=material)
                self.face(
                    [_mirror(c) for c in quad],
                    colour,
                    (0, -1, 0),
                    part=part,
                    layer=layer,
                    material=material,
                )
            top = [front[2], _mirror(front[2]), _mirror(back[2]), back[2]]
            self.face(top, colour, (0, 0, 1), part=part, layer=layer, material=material)
        for ring, sign in ((rings[0], 1.0), (rings[-1], -1.0)):
            for a, b in ((0, 1), (1, 2)):
                end = [ring[a], ring[b], _mirror(ring[b]), _mirror(ring[a])]
                self.face(end, colour, (sign, 0, 0), part=part, layer=layer, material=material)

    def box(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        z: tuple[float, float],
        colour: Colour,
        *,
        part: int = 0,
        layer: int = 0,
        material: Material = Material.MATT,
        minor: bool = False,
    ) -> None:
        """An axis-parallel box without a floor."""
        (x0, x1), (y0, y1), (z0, z1) = x, y, z
        style = {"material": material, "part": part, "layer": layer, "minor": minor}
        quads: list[tuple[list[Corner], Corner]] = [
            ([(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)], (1, 0, 0)),
            ([(x0, y0, z0), (x0, y1, z0), (x0, y1, z1), (x0, y0, z1)], (-1, 0, 0)),
            ([(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)], (0, 1, 0)),
            ([(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)], (0, -1, 0)),
            ([(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)], (0, 0, 1)),
        ]
        for quad, outward in quads:
            self.face(quad, colour, outward, **style)  # type: ignore[arg-type]

    def wheel(
        self, x: float, half_width: float, radius: float, *, part: int = 0, layer: int = 2
    ) -> None:
        """A pair of wheels with arch, tyre and rim at one axle."""
        angles = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
        for side in (1.0, -1.0):
            for step, (scale, shade) in enumerate(((1.16, 22.0), (1.0, 38.0), (0.62, 150.0))):
                y = side * (half_width + 0.005 * step)
                centre = radius * (1.08 if step == 0 else 1.0)
                ring = [
                    (
                        float(x + radius * scale * np.cos(t)),
                        y,
                        float(max(centre + radius * scale * np.sin(t), 0.0)),
                    )
                    for t in angles
                ]
                self.face(
                    ring,
                    (shade, shade, shade),
                    (0, side, 0),
                    material=Material.MATT,
                    part=part,
                    layer=layer + step,
                    minor=step == 2,
                )

    def decal(
        self,
        panel: list[Corner],
        u: tuple[float, float],
        v: tuple[float, float],
        colour: Colour,
        outward: Corner,
        *,
        material: Material = Material.MATT,
        part: int = 0,
        layer: int = 4,
        minor: bool = False,
    ) -> None:
        """A patch on a four-cornered panel; u runs from corner 0 to 1, v from corner 0 to 3."""
        p = np.asarray(panel, dtype=np.float64)

        def at(a: float, b: float) -> Corner:
            low, high = p[0] + a * (p[1] - p[0]), p[3] + a * (p[2] - p[3])
            x, y, z = low + b * (high - low)
            return (float(x), float(y), float(z))

        quad = [at(u[0], v[0]), at(u[1], v[0]), at(u[1], v[1]), at(u[0], v[1])]
        self.face(quad, colour, outward, material=material, part=part, layer=layer, minor=minor)

    def build(self, kind: str, length_m: float, width_m: float) -> Mesh:
        """Pack the faces; the height is that of the highest corner."""
        count = len(self._faces)
        corners = np.empty((count, 12, 3))
        sizes = np.empty(count, dtype=np.int64)
        normals = np.empty((count, 3))
        for i, (polygon, _, _, _, _, _, outward) in enumerate(self._faces):
            points = np.asarray(polygon, dtype=np.float64)
            sizes[i] = len(points)
            corners[i, : len(points)] = points
            corners[i, len(points) :] = points[-1]
            normals[i] = _normal(points, np.asarray(outward, dtype=np.float64))
        flat = corners.reshape(-1, 3)
        return Mesh(
            kind=kind,
            length_m=length_m,
            width_m=width_m,
            height_m=float(flat[:, 2].max()),
            corners=corners,
            sizes=sizes,
            normals=normals,
            colours=np.array([f[1] for f in self._faces], dtype=np.float64),
            materials=np.array([f[2] for f in self._faces], dtype=np.int64),
            parts=np.array([f[3] for f in self._faces], dtype=np.int64),
            layers=np.array([f[4] for f in self._faces], dtype=np.int64),
            minor=np.array([f[5] for f in self._faces], dtype=np.bool_),
            outline=np.unique(flat.round(4), axis=0),
        )


def _mirror(corner: Corner) -> Corner:
    return (corner[0], -corner[1], corner[2])


def _normal(points: Floats, outward: Floats) -> Floats:
    """Newell's normal of a polygon, turned to the side of `outward`, unit length."""
    (x, y, z), (u, v, w) = points.T, np.concatenate([points[1:], points[:1]]).T
    # As `np.cross` has it, at a tenth of its cost for so few corners.
    normal = np.column_stack([y * w - z * v, z * u - x * w, x * v - y * u]).sum(axis=0)
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 0 else outward
    return np.asarray(normal if normal @ outward >= 0 else -normal, dtype=np.float64)
