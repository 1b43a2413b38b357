"""From metres to viser's scene: scale, strips and bodies, batches of them, the camera's place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
import viser

from dashboard.scene import geometry
from dashboard.scene.geometry import Array
from dashboard.scene.shapes import Shape
from dashboard.view.labels import Rgb
from slipstream.roads import RoadNetwork

Colours = npt.NDArray[np.integer[Any]] | Rgb

FOV_RAD: Final = 0.7
TILT_RAD: Final = 0.9
"""Angle of the view above the ground where the whole map is shown."""
_SCENE_WIDTH: Final = 10.0
_MARGIN: Final = 1.06
"""Room around the map where all of it is shown, as a factor of its size."""


class Canvas:
    """The scale of the scene.

    One factor turns m into scene units, so that any network is about ten units wide. North is y,
    up is z. Widths and heights are given in a unit that follows the network, since a road of 7 m
    would be no pixel wide in a city.

    Attributes:
        network: the network that the scale is made for.
        unit_m: the unit, m: a share of the network's extent, smaller where its typical segment is
            short.
        unit: the same in scene units.
        centre_m: middle of the network, m.
        size_m: its extent to the east and to the north, m.

    Args:
        network: the road network.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self.network = network
        x_min, y_min, x_max, y_max = network.bounds_m()
        extent = max(x_max - x_min, y_max - y_min, 1.0)
        self.centre_m = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2])
        self.size_m = (x_max - x_min, y_max - y_min)
        self.scale = _SCENE_WIDTH / extent
        lengths = sorted(segment.length_m for segment in network.segments.values())
        self.unit_m = min(extent / 100, max(lengths[len(lengths) // 2] / 12, extent / 350))
        self.unit = self.unit_m * self.scale

    def offset_line(self, segment: str, units: float) -> Array:
        """The line of a segment, offset by a number of units to the side that is driven on;
        (N, 2), m.
        """
        shape = geometry.drop_repeated_points(self.network.segments[segment].shape)
        side = -1 if self.network.left_hand else 1
        return geometry.offset(shape, side * units * self.unit_m)

    def positions(self, places_m: Array, height: float) -> npt.NDArray[np.float32]:
        """Places in m, (N, 2), at a height in units, as positions in the scene, (N, 3)."""
        flat = (np.asarray(places_m, dtype=np.float64).reshape(-1, 2) - self.centre_m) * self.scale
        return np.column_stack((flat, np.full(len(flat), height * self.unit))).astype(np.float32)

    def places_m(self, positions: Array) -> Array:
        """Positions on the ground of the scene, (N, 2 or 3), as places in m, (N, 2)."""
        places: Array = positions[:, :2] / self.scale + self.centre_m
        return places

    def strips(
        self, strokes_m: Array, rgb: Colours, units: float | Array, height: float | Array
    ) -> Instances:
        """Strokes as flat strips of the shape `QUAD`.

        Args:
            strokes_m: start and end of each, (N, 2, 2), m.
            rgb: colours in sRGB, (N, 3) or (3,).
            units: width of all, or of each, (N,).
            height: above the ground, in units, of all or of each, (N,).
        """
        steps = np.diff(strokes_m, axis=1)[:, 0]
        scales = np.ones((len(steps), 3), dtype=np.float32)
        scales[:, 0] = np.hypot(*steps.T) * self.scale
        scales[:, 1] = np.asarray(units) * self.unit
        positions = self.positions(strokes_m[:, 0], 0.0)
        positions[:, 2] = np.asarray(height) * self.unit
        turns = facing(np.arctan2(steps[:, 1], steps[:, 0]))
        return Instances(positions, turns, scales, linear(rgb, len(steps)))

    def bodies(
        self, places_m: Array, headings: Array, rgb: Colours, units: float, height: float = 0.0
    ) -> Instances:
        """One shape at many places.

        Args:
            places_m: (N, 2).
            headings: angle of each from the east, anticlockwise, rad, (N,).
            rgb: colours in sRGB, (N, 3) or (3,).
            units: size of all: what is 1 long in the shape.
            height: above the ground, in units.
        """
        positions = self.positions(places_m, height)
        scales = np.full((len(positions), 3), units * self.unit, dtype=np.float32)
        return Instances(positions, facing(headings), scales, linear(rgb, len(positions)))

    def area(
        self,
        scene: viser.SceneApi,
        name: str,
        places_m: Array,
        faces: npt.NDArray[np.int64],
        rgb: Rgb,
        height: float = 0.0,
    ) -> None:
        """Draw flat triangles of corners, (N, 2) in m; replaces a node of the same name."""
        scene.add_mesh_simple(
            name,
            self.positions(places_m, height),
            faces.astype(np.uint32),
            color=rgb,
            material="toon3",
            cast_shadow=False,
            receive_shadow=False,
        )

    def fit(self, width_px: int, height_px: int, tilt: float = TILT_RAD) -> tuple[Array, Array]:
        """Camera position and the point it looks at, for the network to fill a browser's canvas."""
        half = np.array(self.size_m) * self.scale / 2 * _MARGIN + 2 * self.unit
        return fit_box(half, width_px / max(height_px, 1), tilt)


def fit_box(half: Array, aspect: float, tilt: float) -> tuple[Array, Array]:
    """Camera position and look-at for a box on the ground, ±half (2,) about the origin."""
    # Looking straight down would leave the up direction undefined.
    tilt = min(tilt, math.pi / 2 - 1e-3)
    away = np.array([0.0, -math.cos(tilt), math.sin(tilt)])
    up = np.array([0.0, math.sin(tilt), math.cos(tilt)])
    corners = np.array([(x, y, 0.0) for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    tan_y = math.tan(FOV_RAD / 2)
    tan_x = tan_y * max(aspect, 0.1)
    look_at = np.zeros(3)
    for _ in range(8):
        # A corner is seen if its offset on each axis is within its depth's share.
        seen = corners - look_at
        near = seen @ away
        distance = float(
            np.max(near + np.maximum(np.abs(seen[:, 0]) / tan_x, np.abs(seen @ up) / tan_y))
        )
        # The far edge is seen smaller than the near one: the middle of the picture moves.
        heights = (seen @ up) / (distance - near)
        middle = (float(heights.max()) + float(heights.min())) / 2
        look_at = look_at + np.array([0.0, middle * distance / math.sin(tilt), 0.0])
    return look_at + away * distance, look_at


@dataclass(frozen=True)
class Instances:
    """Where a shape stands, how often.

    Attributes:
        positions: in the scene, (N, 3).
        turns: quaternions (w, x, y, z), (N, 4).
        scales: along the shape's axes, (N, 3).
        rgb: colours in linear light, (N, 3), as viser takes those of a batch.
    """

    positions: npt.NDArray[np.float32]
    turns: npt.NDArray[np.float32]
    scales: npt.NDArray[np.float32]
    rgb: npt.NDArray[np.uint8]


class Batch:
    """One node of a scene that draws a shape many times; sends only the arrays that changed."""

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        shape: Shape,
        material: Literal["standard", "toon3"] = "standard",
        opacity: float | None = None,
    ) -> None:
        self._material: Final = material
        self._opacity: Final = opacity
        self._scene = scene
        self._name = name
        self._shape = shape
        self._node: viser.BatchedMeshHandle | None = None
        self._shown: Instances | None = None

    def show(self, new: Instances) -> None:
        """Draw these in place of those before."""
        old, self._shown = self._shown, new
        if self._node is None or old is None or len(old.positions) != len(new.positions):
            self._redraw(new)
            return
        for prop, before, now in (
            ("batched_positions", old.positions, new.positions),
            ("batched_wxyzs", old.turns, new.turns),
            ("batched_scales", old.scales, new.scales),
            ("batched_colors", old.rgb, new.rgb),
        ):
            if not np.array_equal(before, now):
                setattr(self._node, prop, now)

    def clear(self) -> None:
        """Draw nothing."""
        if self._node is not None:
            self._node.remove()
            self._node = None

    def _redraw(self, new: Instances) -> None:
        if not len(new.positions):
            self.clear()
            return
        self._node = self._scene.add_batched_meshes_simple(
            self._name,
            self._shape.vertices,
            self._shape.faces,
            new.turns,
            new.positions,
            batched_scales=new.scales,
            batched_colors=new.rgb,
            # The shapes are simple; viser would search for simpler ones in each browser.
            lod="off",
            opacity=self._opacity,
            material=self._material,
            cast_shadow=False,
            receive_shadow=False,
        )


def facing(headings: Array) -> npt.NDArray[np.float32]:
    """Quaternions (w, x, y, z), (N, 4), of turns about the vertical, rad."""
    turns = np.zeros((len(headings), 4), dtype=np.float32)
    turns[:, 0], turns[:, 3] = np.cos(headings / 2), np.sin(headings / 2)
    return turns


def linear(rgb: Colours, count: int) -> npt.NDArray[np.uint8]:
    """Colours in sRGB, (3,) or (N, 3), in linear light, (N, 3)."""
    share = np.broadcast_to(np.asarray(rgb), (count, 3)) / 255
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    rounded: npt.NDArray[np.uint8] = np.round(light * 255).astype(np.uint8)
    return rounded
