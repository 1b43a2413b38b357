"""Shades the sky and the road plane of a still scene, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.light import Light
from slipstream_lab.simulation.streetdrive.rendering.mesh import Colour
from slipstream_lab.simulation.streetdrive.traffic import Road

Grid = NDArray[np.float32]
_TILE = 512
_FAR_M = 1800.0


@dataclass(frozen=True)
class Palette:
    """Surface colours (BGR, 0..255) of the still scene."""

    asphalt: Colour = (112.0, 110.0, 109.0)
    verge: Colour = (52.0, 108.0, 92.0)
    pavement: Colour = (158.0, 164.0, 168.0)
    marking: Colour = (225.0, 228.0, 228.0)
    buildings: tuple[Colour, ...] = ((150, 165, 185), (120, 130, 165), (175, 180, 180))
    foliage: Colour = (40.0, 86.0, 62.0)


@lru_cache(maxsize=4)
def noise_tile(seed: int) -> Grid:
    """A tileable field of smooth noise with mean 0 and deviation 1, shape (512, 512)."""
    rng = np.random.default_rng(seed)
    raw = rng.standard_normal((_TILE, _TILE)).astype(np.float32)
    padded = np.pad(raw, 16, mode="wrap")
    smooth = cv2.GaussianBlur(padded, (0, 0), 1.6)[16:-16, 16:-16]
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


def noise(tile: Grid, x: Grid, y: Grid, grain_x: float, grain_y: float) -> Grid:
    """Noise over coordinates x, y (metres), with features some grain metres across."""
    map_x, map_y = x * np.float32(3.0 / grain_x), y * np.float32(3.0 / grain_y)
    field = cv2.remap(tile, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(field, dtype=np.float32)


def band(value: Grid, low: float, high: float, footprint: Grid) -> Grid:
    """Coverage (0..1) of low < value < high by a pixel of the given width."""
    inside = np.minimum(value - low, high - value) / np.maximum(footprint, 1e-4) + 0.5
    wide = np.minimum((high - low) / np.maximum(footprint, 1e-4), 1.0)
    return np.asarray(np.clip(inside, 0.0, 1.0) * np.clip(wide, 0.0, 1.0), dtype=np.float32)


def blend(image: Grid, colour: Colour | Grid, cover: Grid) -> Grid:
    """Lay a colour, or a picture of colours, over a picture in place where cover > 0."""
    tone = np.asarray(colour, dtype=np.float32)
    where = np.flatnonzero(cover > 0)
    flat = image.reshape(-1, 3)
    chosen = tone if tone.ndim == 1 else tone.reshape(-1, 3)[where]
    below = flat[where]
    flat[where] = below + (chosen - below) * cover.reshape(-1)[where, None]
    return image


def shade_sky(camera: PinholeCamera, light: Light, rng: np.random.Generator) -> Grid:
    """Sky gradient with clouds over the whole picture, float BGR (h, w, 3)."""
    height, width = camera.height_px, camera.width_px
    horizon = camera.height_px / 2 - camera.focal_px * np.tan(camera.pitch_rad)
    v = np.arange(height, dtype=np.float32)
    up = np.clip((horizon - v) / camera.focal_px * 3.0, 0.0, 1.0)[:, None, None]
    sky = np.asarray(light.sky_horizon) * (1 - up) + np.asarray(light.sky_zenith) * up
    image = np.repeat(sky.astype(np.float32), width, axis=1)
    tile = noise_tile(int(rng.integers(1 << 30)))
    grid_u, grid_v = np.meshgrid(np.arange(width, dtype=np.float32), v)
    field = sum(noise(tile, grid_u, grid_v, 420.0 / k, 90.0 / k) / k for k in (1.0, 2.0, 4.0))
    cover = np.clip(np.asarray(field, dtype=np.float32) * 0.3 + light.clouds - 0.5, 0.0, 0.8)
    return blend(image, (238.0, 236.0, 234.0), cover.astype(np.float32))


@dataclass(frozen=True)
class GroundView:
    """What each pixel (h, w) shows of the road plane.

    `across` and `along` are the pixel's widths on the ground in metres, across and along the line
    of sight; `rough` and `fine` are noise of two grain sizes, `fade` how much fine detail is left.
    """

    x: Grid
    y: Grid
    hits: NDArray[np.bool_]
    reach: Grid
    across: Grid
    along: Grid
    fade: Grid
    rough: Grid
    fine: Grid
    tile: Grid


def view_ground(camera: PinholeCamera, rng: np.random.Generator) -> GroundView:
    """The road plane under each pixel, with drawn noise."""
    x, y, hits = ground_grid(camera)
    reach = np.sqrt(x * x + (y - camera.lateral_m) ** 2 + camera.height_m**2)
    across = (reach / camera.focal_px).astype(np.float32)
    along = (reach * reach / (camera.focal_px * camera.height_m)).astype(np.float32)
    tile = noise_tile(int(rng.integers(1 << 30)))
    fade = np.clip(1.0 / (1.0 + along * 2.0), 0.0, 1.0)
    rough = noise(tile, x, y, 9.0, 6.0)
    fine = (noise(tile, x, y, 0.7, 0.5) + noise(tile, x, y, 0.2, 0.16)) * fade
    return GroundView(x, y, hits, reach, across, along, fade, rough, fine, tile)


def verge(view: GroundView, palette: Palette) -> Grid:
    """Grass everywhere, float BGR (h, w, 3)."""
    image = np.empty((*view.x.shape, 3), dtype=np.float32)
    image[:] = np.asarray(palette.verge, dtype=np.float32)
    swell = noise(view.tile, view.x, view.y, 40.0, 25.0)
    image *= (1.0 + 0.07 * view.rough + 0.12 * view.fine + 0.06 * swell)[..., None]
    return image


def worn_asphalt(view: GroundView) -> Grid:
    """How much lighter or darker than its colour old asphalt is, (h, w), 0 on average."""
    streaks = noise(view.tile, view.x, view.y, 30.0, 1.4)
    return np.asarray(0.03 * view.rough + 0.045 * view.fine + 0.03 * streaks)


def patches(view: GroundView) -> Grid:
    """Where asphalt was mended, (h, w), 0 or 1."""
    field = noise(view.tile, view.x * 0.9 + 77, view.y, 26.0, 5.0)
    return (field > 1.9).astype(np.float32)


def worn_paint(view: GroundView) -> Grid:
    """Share of a marking that is still there, (h, w)."""
    return np.clip(0.82 + 0.12 * view.fine + 0.08 * view.rough, 0.35, 1.0)


def lit(image: Grid, view: GroundView, light: Light) -> Grid:
    """A picture of the road plane in the light and behind the haze; changes it in place."""
    up = light.lambert(np.array([[0.0, 0.0, 1.0]]))[0].astype(np.float32)
    image *= up
    clear = light.clearness(view.reach).astype(np.float32)[..., None]
    image = image * clear + np.asarray(light.sky_horizon, dtype=np.float32) * (1 - clear)
    return np.asarray(image, dtype=np.float32)


def paint_ground(view: GroundView, road: Road, palette: Palette) -> Grid:
    """The straight road's plane, not lit yet, float BGR (h, w, 3)."""
    x, y, across, along = view.x, view.y, view.across, view.along
    image = verge(view, palette)

    left, right = road.left_edge_m, road.right_edge_m
    if road.pavement_m > 0:
        for low, high in ((left, left + road.pavement_m), (right - road.pavement_m, right)):
            tone = (
                np.asarray(palette.pavement, dtype=np.float32) * (1.0 + 0.05 * view.fine)[..., None]
            )
            joints = band(np.mod(x, 2.0), 0.0, 0.05, along)
            image = blend(image, tone * (1 - 0.25 * joints)[..., None], band(y, low, high, across))
    for low, high in ((left, left + 0.22), (right - 0.22, right)):
        kerb = np.asarray(palette.pavement, dtype=np.float32) * np.float32(1.12)
        image = blend(image, kerb, band(y, low, high, across))

    asphalt = np.asarray(palette.asphalt, dtype=np.float32)
    wear = worn_asphalt(view)
    for lane in road.lanes:
        for wheel in (-0.85, 0.85):
            offset = np.abs(y - np.float32(lane.y_m + wheel)) * np.float32(2.0)
            wear = wear - np.float32(0.06) * np.clip(1 - offset, 0, 1)
    wear = wear - 0.10 * patches(view) * view.fade
    image = blend(image, asphalt * (1.0 + wear)[..., None], band(y, right, left, across))

    worn = worn_paint(view)
    for cover in _markings(road, x, y, across, along):
        image = blend(image, palette.marking, np.asarray(cover * worn, dtype=np.float32))
    return image


def ground_grid(camera: PinholeCamera) -> tuple[Grid, Grid, NDArray[np.bool_]]:
    """Road coordinates x and y of each pixel's centre, and which pixels show the road plane."""
    inverse = np.linalg.inv(camera.ground_homography).astype(np.float32)
    u = np.arange(camera.width_px, dtype=np.float32) + np.float32(0.5)
    v = np.arange(camera.height_px, dtype=np.float32)[:, None] + np.float32(0.5)
    ray_x, ray_y, weight = (row[0] * u + (row[1] * v + row[2]) for row in inverse)
    hits = weight > 1e-6
    weight = np.where(hits, weight, np.float32(1.0))
    x = np.clip(ray_x / weight, -200, _FAR_M)
    y = np.clip(ray_y / weight, -_FAR_M, _FAR_M)
    return np.asarray(x), np.asarray(y), hits


def _markings(road: Road, x: Grid, y: Grid, across: Grid, along: Grid) -> list[Grid]:
    """Coverage grids of the painted lines: edges, the double centre line, dashes between lanes."""
    inner = road.median_m / 2
    covers = [
        band(
            y,
            road.left_edge_m - road.shoulder_m - 0.07,
            road.left_edge_m - road.shoulder_m + 0.07,
            across,
        ),
        band(
            y,
            road.right_edge_m + road.shoulder_m - 0.07,
            road.right_edge_m + road.shoulder_m + 0.07,
            across,
        ),
        band(y, inner - 0.12, inner + 0.02, across),
        band(y, -inner - 0.02, -inner + 0.12, across),
    ]
    dash = band(np.mod(x, 9.0), 0.0, 3.0, along)
    for count, sign in ((road.incoming_lanes, 1.0), (road.outgoing_lanes, -1.0)):
        for i in range(1, count):
            centre = sign * (inner + i * road.lane_width_m)
            covers.append(band(y, centre - 0.07, centre + 0.07, across) * dash)
    return covers
