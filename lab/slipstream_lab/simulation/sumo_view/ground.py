"""Shades the road plane around an RSU: carriageways that may bend, junctions, pavements, lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from slipstream_lab.simulation.streetdrive.rendering import (
    Grid,
    GroundView,
    Palette,
    PinholeCamera,
    band,
    blend,
    patches,
    verge,
    worn_asphalt,
    worn_paint,
)
from slipstream_lab.simulation.sumo_view.lanes import Carriageway, LaneRoads
from slipstream_lab.simulation.sumo_view.polylines import Floats, distances
from slipstream_lab.simulation.sumo_view.pose import CameraSite

SHOULDER_M = 0.5
PAVEMENT_M = 2.5
_REACH_M = 400.0
_MARGIN_M = 5.0
_NEAR_M = 1.0
_FINER = 4


@dataclass(frozen=True)
class _Strip:
    """A carriageway's own coordinates under the pixels around it.

    `pixels` are flat indices (k,); `along` and `right` the distances in metres from the beginning
    and to the right of the left border; `along_px` and `right_px` the pixel's widths that way.
    """

    way: Carriageway
    pixels: NDArray[np.int64]
    along: Grid
    right: Grid
    along_px: Grid
    right_px: Grid
    length_m: float

    def cover(self, left_m: float, right_m: float, from_m: float = 0.0, to_m: float = 0.0) -> Grid:
        """Coverage (k,) of a strip between two distances to the right; `to_m` is before the end."""
        across = band(self.right, left_m, right_m, self.right_px)
        return np.asarray(across * self.lengthwise(from_m, self.length_m - to_m))

    def lengthwise(self, from_m: float, to_m: float) -> Grid:
        """Coverage (k,) of a stretch, open to a pixel's width so that strips join."""
        return band(self.along, from_m - 0.05, to_m + 0.05, np.minimum(self.along_px, 1.0))


def _strip(way: Carriageway, site: CameraSite, view: GroundView) -> _Strip | None:
    line = site.to_local(way.left)
    reach = way.width_m + SHOULDER_M + max(PAVEMENT_M, way.walk_m) + _MARGIN_M
    (x1, y1), (x2, y2) = line.min(axis=0) - reach, line.max(axis=0) + reach
    near = view.hits & (view.x > x1) & (view.x < x2) & (view.y > y1) & (view.y < y2)
    pixels = np.flatnonzero(near & (view.reach < _REACH_M))
    if not len(pixels):
        return None
    x, y = view.x.reshape(-1)[pixels], view.y.reshape(-1)[pixels]
    best = np.full(len(pixels), np.inf, dtype=np.float32)
    along, right = np.zeros_like(best), np.full_like(best, 1e6)
    bearing = np.zeros_like(best)
    starts = distances(line)
    last = len(line) - 2
    for i, (a, b) in enumerate(pairwise(line)):
        length = float(np.linalg.norm(b - a))
        tx, ty = (np.float32(v) for v in (b - a) / length)
        low, high = np.minimum(a, b) - reach, np.maximum(a, b) + reach
        some = np.flatnonzero((x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]))
        dx, dy = x[some] - np.float32(a[0]), y[some] - np.float32(a[1])
        t, r = dx * tx + dy * ty, dx * ty - dy * tx
        # The first and the last piece go on straight, so that ends are cut square.
        free = np.clip(t, -1e6 if i == 0 else 0.0, 1e6 if i == last else length)
        gap = np.hypot(t - free, r)
        closer = gap < best[some]
        chosen = some[closer]
        best[chosen], right[chosen] = gap[closer], r[closer]
        along[chosen] = free[closer] + np.float32(starts[i])
        bearing[chosen] = np.float32(np.arctan2(ty, tx))
    # How a pixel's footprint, long along the line of sight, lies to the strip.
    slant = np.arctan2(y, x) - bearing
    wide, deep = view.across.reshape(-1)[pixels], view.along.reshape(-1)[pixels]
    cos, sin = np.abs(np.cos(slant)), np.abs(np.sin(slant))
    return _Strip(
        way,
        pixels,
        along,
        right,
        np.hypot(deep * cos, wide * sin),
        np.hypot(wide * cos, deep * sin),
        float(starts[-1]),
    )


def _outline_cover(camera: PinholeCamera, outlines: Sequence[Floats], margin_m: float) -> Grid:
    """Share of each pixel (h, w) that outlines (n, 2) on the road plane and a margin cover."""
    height, width = camera.height_px, camera.width_px
    canvas = np.zeros((height * _FINER, width * _FINER), dtype=np.uint8)
    for outline in outlines:
        away = outline - outline.mean(axis=0)
        wider = outline + away / np.linalg.norm(away, axis=1)[:, None] * margin_m
        points = np.column_stack([wider, np.zeros(len(wider))])
        _, depth = camera.project(points)
        inside = _in_front(points, depth)
        if len(inside) >= 3:
            pixels, _ = camera.project(inside)
            finer = np.rint(np.clip(pixels, -20000, 20000) * _FINER - 0.5).astype(np.int32)
            cv2.fillPoly(canvas, [finer], (255,))
    small = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.float32) / np.float32(255)


def _in_front(points: Floats, depth: Floats) -> Floats:
    """The part (m, 3) of a polygon (n, 3) that lies before the camera."""
    kept: list[Floats] = []
    for i in range(len(points)):
        j = (i + 1) % len(points)
        if depth[i] >= _NEAR_M:
            kept.append(points[i])
        if (depth[i] >= _NEAR_M) != (depth[j] >= _NEAR_M):
            share = (_NEAR_M - depth[i]) / (depth[j] - depth[i])
            kept.append(points[i] + share * (points[j] - points[i]))
    return np.array(kept).reshape(-1, 3)


def _pave(image: Grid, strip: _Strip, view: GroundView, palette: Palette) -> None:
    """A pavement beside the shoulder at the kerb."""
    wide = strip.way.walk_m or PAVEMENT_M
    cover = strip.cover(*strip.way.beside_kerb(SHOULDER_M, SHOULDER_M + wide))
    joints = band(np.mod(strip.along, 2.0), 0.0, 0.05, strip.along_px)
    tone = (1.0 + 0.05 * view.fine.reshape(-1)[strip.pixels]) * (1 - 0.25 * joints)
    _blend_pixels(
        image, strip.pixels, np.asarray(palette.pavement, np.float32) * tone[:, None], cover
    )


def _blend_pixels(image: Grid, pixels: NDArray[np.int64], colours: Grid, cover: Grid) -> None:
    flat = image.reshape(-1, 3)
    below = flat[pixels]
    flat[pixels] = below + (colours - below) * cover[:, None]


def _markings(strip: _Strip) -> Grid:
    """Coverage (k,) of a carriageway's painted lines: borders, dashes, the line to stop at."""
    width = strip.way.width_m
    cover = np.maximum(strip.cover(0.08, 0.22), strip.cover(width - 0.07, width + 0.07))
    dashes = band(np.mod(strip.along, 9.0), 0.0, 3.0, strip.along_px)
    inner = np.cumsum(strip.way.widths_m)[:-1]
    for line in inner:
        dashed = strip.cover(float(line) - 0.07, float(line) + 0.07) * dashes
        cover = np.maximum(cover, dashed)
    if strip.way.stop_line and strip.length_m > 10.0:
        across = band(strip.right, 0.1, width - 0.1, strip.right_px)
        end = strip.length_m
        cover = np.maximum(cover, across * band(strip.along, end - 1.0, end - 0.6, strip.along_px))
    return np.asarray(cover, dtype=np.float32)


def paint_roads(
    view: GroundView, camera: PinholeCamera, roads: LaneRoads, site: CameraSite, palette: Palette
) -> Grid:
    """The unlit road plane, float BGR (h, w, 3): grass, pavements, asphalt, markings."""
    image = verge(view, palette)
    strips = [s for s in (_strip(way, site, view) for way in roads.carriageways) if s is not None]
    outlines = [site.to_local(outline) for outline in roads.junctions]
    near = view.hits & (view.reach < _REACH_M)
    slabs = np.asarray(palette.pavement, dtype=np.float32) * (1.0 + 0.05 * view.fine)[..., None]
    corners = _outline_cover(camera, outlines, SHOULDER_M + PAVEMENT_M) * near
    image = blend(image, slabs, corners)
    for strip in strips:
        _pave(image, strip, view, palette)

    asphalt = _outline_cover(camera, outlines, SHOULDER_M) * near
    wear = worn_asphalt(view) - 0.10 * patches(view) * view.fade
    flat_asphalt, flat_wear = asphalt.reshape(-1), wear.reshape(-1)
    for strip in strips:
        cover = strip.cover(-SHOULDER_M, strip.way.width_m + SHOULDER_M)
        flat_asphalt[strip.pixels] = np.maximum(flat_asphalt[strip.pixels], cover)
        on = strip.lengthwise(0.0, strip.length_m)
        edge = 0.0
        for lane_m in strip.way.widths_m:
            for wheel in (-0.85, 0.85):
                offset = np.abs(strip.right - np.float32(edge + lane_m / 2 + wheel)) * 2
                track = np.float32(0.06) * np.clip(1 - offset, 0, 1) * on
                flat_wear[strip.pixels] -= track
            edge += lane_m
    tone = np.asarray(palette.asphalt, dtype=np.float32) * (1.0 + wear)[..., None]
    image = blend(image, np.asarray(tone, dtype=np.float32), asphalt)

    worn = worn_paint(view).reshape(-1)
    paint = np.asarray(palette.marking, dtype=np.float32)
    for strip in strips:
        cover = _markings(strip) * worn[strip.pixels]
        _blend_pixels(image, strip.pixels, np.broadcast_to(paint, (len(strip.pixels), 3)), cover)
    return image
