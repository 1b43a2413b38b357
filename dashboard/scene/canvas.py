"""Draws lines, points and labels given in metres as nodes of viser's scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
import viser

from dashboard.scene import geometry
from dashboard.scene.geometry import Array
from dashboard.view import Rgb
from slipstream.roads import RoadNetwork

Anchor = Literal["top-center", "bottom-center"]
Colours = Rgb | npt.NDArray[np.uint8]

FOV_RAD: Final = 0.7
_SCENE_WIDTH: Final = 10.0
_TOP_PX: Final = 190
"""Height of the panel above the map, and of the one below it, in px."""
_BOTTOM_PX: Final = 270


class Canvas:
    """Draws in metres on a viser scene.

    One factor turns m into scene units, so that any network is about ten units wide.

    Attributes:
        scene: the viser scene.
        network: the network that the scale is made for.
        unit_m: unit of widths and distances on the map, m; a share of the network's extent, but
            small beside its typical segment.
        centre_m: middle of the network, m.

    Args:
        scene: the viser scene to draw on.
        network: the road network.
    """

    def __init__(self, scene: viser.SceneApi, network: RoadNetwork) -> None:
        self.scene = scene
        self.network = network
        x_min, y_min, x_max, y_max = network.bounds_m()
        extent = max(x_max - x_min, y_max - y_min, 1.0)
        self.centre_m = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2])
        self._size_m = (x_max - x_min, y_max - y_min)
        self._scale = _SCENE_WIDTH / extent
        lengths = sorted(segment.length_m for segment in network.segments.values())
        self.unit_m = min(extent / 100, lengths[len(lengths) // 2] / 12)

    def offset_line(self, segment: str, units: float) -> Array:
        """The line of a segment, offset to its right by a number of units; (N, 2), m."""
        shape = geometry.drop_repeated_points(self.network.segments[segment].shape)
        return geometry.offset(shape, units * self.unit_m)

    def lines(
        self,
        name: str,
        strokes_m: Array,
        colours: Colours,
        units: float,
        height: float | Array,
    ) -> viser.LineSegmentsHandle:
        """Draw strokes, (N, 2, 2) in m, of a width in units; replaces a node of the same name.

        Args:
            colours: one for all, or those of the ends of each stroke, (N, 2, 3), made by
                `stroke_colours`.
            height: of all, or of each stroke, (N,), in scene units.
        """
        flat = (strokes_m - self.centre_m) * self._scale
        heights = np.broadcast_to(np.asarray(height).reshape(-1, 1, 1), (*flat.shape[:2], 1))
        points = np.concatenate((flat, heights), axis=2)
        return self.scene.add_line_segments(
            name,
            points.astype(np.float32),
            colours,
            thickness=units * self.unit_m * self._scale,
        )

    def points(
        self,
        name: str,
        places_m: Sequence[tuple[float, float]] | Array,
        colours: Colours,
        units: float,
        shape: Literal["square", "diamond", "circle"],
        height: float = 0.04,
    ) -> viser.PointCloudHandle:
        """Draw a marker at each place, (N, 2) in m; replaces a node of the same name."""
        return self.scene.add_point_cloud(
            name,
            self.positions(np.asarray(places_m, dtype=np.float64), height),
            colours,
            point_size=units * self.unit_m * self._scale,
            point_shape=shape,
            point_shading="flat",
            precision="float32",
        )

    def label(
        self, name: str, text: str, place_m: Array, units_north: float, anchor: Anchor
    ) -> viser.LabelHandle:
        """Draw a label some units north of a place, in m; replaces a node of the same name."""
        return self.scene.add_label(
            name, text, position=self.label_position(place_m, units_north), anchor=anchor
        )

    def label_position(self, place_m: Array, units_north: float) -> npt.NDArray[np.float32]:
        """Position of a label in the scene."""
        moved = np.asarray(place_m) + np.array([0.0, units_north * self.unit_m])
        position: npt.NDArray[np.float32] = self.positions(moved[None, :], 0.06)[0]
        return position

    def positions(self, places_m: Array, height: float) -> npt.NDArray[np.float32]:
        """Places in m, (N, 2), as positions in the scene, (N, 3)."""
        flat = (places_m - self.centre_m) * self._scale
        return np.column_stack((flat, np.full(len(flat), height))).astype(np.float32)

    def fit(self, width_px: int, height_px: int) -> tuple[Array, Array]:
        """Camera position and the point it looks at, for the network to fill a canvas.

        The map goes between the panels above and below it where the canvas is high enough.
        """
        width, height = (side * self._scale for side in self._size_m)
        width_px, height_px = max(width_px, 200), max(height_px, 200)
        roomy = height_px > _TOP_PX + _BOTTOM_PX + 200
        top, bottom = (_TOP_PX, _BOTTOM_PX) if roomy else (0, 0)
        free_px = height_px - top - bottom
        # Room for labels beside the outermost roads.
        seen = max(
            (width * 1.12 + 0.3) * height_px / width_px, (height * 1.25 + 0.3) * height_px / free_px
        )
        distance = seen / 2 / math.tan(FOV_RAD / 2)
        shift = seen * (top - bottom) / 2 / height_px
        look_at = np.array([0.0, shift, 0.0])
        # Looking straight down would leave the up direction undefined.
        return look_at + np.array([0.0, -1e-3 * distance, distance]), look_at


def stroke_colours(rgb: npt.NDArray[np.integer[Any]]) -> npt.NDArray[np.uint8]:
    """Colours of strokes, (N, 3) in sRGB, as `Canvas.lines` takes them: (N, 2, 3).

    viser takes colours of single vertices to be in linear light.
    """
    share = rgb / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.repeat(np.round(linear * 255).astype(np.uint8)[:, None, :], 2, axis=1)
