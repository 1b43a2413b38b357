"""Buildings, trees, lamp posts and their shadows beside the road, painted once per scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.ground import Grid, Palette
from slipstream_lab.simulation.streetdrive.rendering.light import Light
from slipstream_lab.simulation.streetdrive.rendering.mesh import Colour, Floats
from slipstream_lab.simulation.streetdrive.rendering.painter import Image, fill
from slipstream_lab.simulation.streetdrive.traffic import Road

_NEAREST_M = 2.0
_TREE_LINE_M = 900.0

RoadsideObject = tuple[float, str, float]
"""What stands beside the road: x in metres, "building", "tree" or "lamp", y in metres."""


@dataclass(frozen=True)
class Density:
    """Mean counts of things on each side of the road."""

    buildings: float = 6.0
    trees: float = 10.0
    lamp_posts: float = 6.0


def _polygon(
    image: Image,
    camera: PinholeCamera,
    light: Light,
    corners: Floats,
    normal: Floats,
    colour: Colour,
) -> None:
    """Draw one lit planar polygon (n, 3), skipped where it reaches behind the camera."""
    pixels, depth = camera.project(corners)
    if float(depth.min()) < _NEAREST_M:
        return
    lit = np.asarray(colour, dtype=np.float64)[None, :] * light.lambert(normal[None, :])
    distance = np.array([float(np.linalg.norm(corners.mean(axis=0) - camera.position_m))])
    fill(image, pixels, [float(c) for c in np.clip(light.through_haze(lit, distance)[0], 0, 255)])


def _building(
    image: Image,
    camera: PinholeCamera,
    light: Light,
    rng: np.random.Generator,
    colour: Colour,
    x: float,
    y: float,
) -> None:
    """A block with rows of windows on the two walls that the camera can see."""
    depth_m, wide, high = rng.uniform(9, 26), rng.uniform(9, 20), rng.uniform(5, 20)
    sign = 1.0 if y > 0 else -1.0
    near_y, far_y = y, y + sign * wide
    x0, x1 = x, x + depth_m
    walls = [
        (np.array([x0, near_y]), np.array([x0, far_y]), np.array([-1.0, 0.0, 0.0])),
        (np.array([x0, near_y]), np.array([x1, near_y]), np.array([0.0, -sign, 0.0])),
    ]
    floors = max(1, int(high // 3.1))
    window: Colour = (72.0, 66.0, 60.0)
    for a, b, normal in walls:

        def at(s: float, z: float, a: Floats = a, b: Floats = b) -> list[float]:
            return [*(a + s * (b - a)), z]

        wall = np.array([at(0, 0), at(1, 0), at(1, high), at(0, high)])
        _polygon(image, camera, light, wall, normal, colour)
        columns = max(2, int(np.linalg.norm(b - a) // 3.0))
        for floor in range(floors):
            z0, z1 = 3.1 * floor + 1.0, 3.1 * floor + 2.5
            for column in range(columns):
                s0, s1 = (column + 0.25) / columns, (column + 0.75) / columns
                pane = np.array([at(s0, z0), at(s1, z0), at(s1, z1), at(s0, z1)])
                _polygon(image, camera, light, pane, normal, window)
    if high < camera.height_m:
        roof = np.array(
            [[x0, near_y, high], [x0, far_y, high], [x1, far_y, high], [x1, near_y, high]]
        )
        _polygon(image, camera, light, roof, np.array([0.0, 0.0, 1.0]), (105, 108, 115))


def _tree(
    image: Image,
    camera: PinholeCamera,
    light: Light,
    rng: np.random.Generator,
    colour: Colour,
    x: float,
    y: float,
) -> None:
    """A trunk and a crown of leaf clusters, lit from the sun's side."""
    height, radius = rng.uniform(4.5, 10.0), rng.uniform(1.4, 3.2)
    foot, depth = camera.project(np.array([[x, y, 0.0], [x, y, height - radius]]))
    if float(depth.min()) < 8.0:
        return
    scale = camera.focal_px / float(depth[0])
    trunk = max(1.0, 0.28 * scale)
    stem = np.array(
        [
            [foot[0, 0] - trunk / 2, foot[0, 1]],
            [foot[0, 0] + trunk / 2, foot[0, 1]],
            [foot[1, 0] + trunk / 3, foot[1, 1]],
            [foot[1, 0] - trunk / 3, foot[1, 1]],
        ]
    )
    bark = light.through_haze(np.array([[48.0, 58.0, 70.0]]), depth[:1])[0]
    fill(image, stem, bark if light.fog_m < math.inf else (48.0, 58.0, 70.0))
    offsets = rng.normal(size=(90, 3))
    offsets /= np.linalg.norm(offsets, axis=1)[:, None]
    normals = offsets.copy()
    offsets *= (radius * rng.uniform(0.35, 1.0, 90) ** 0.5)[:, None]
    centres = np.array([x, y, height - radius]) + offsets
    pixels, depths = camera.project(centres)
    order = np.argsort(-depths)
    tones = np.asarray(colour) * light.lambert(normals) * rng.uniform(0.75, 1.2, (90, 1))
    tones *= 0.62 + 0.38 * (offsets[:, 2:] / radius + 1) / 2
    tones = np.clip(light.through_haze(tones, depths), 0, 255)
    size = radius * 0.26 * scale
    for i in order:
        centre = (round(float(pixels[i, 0]) * 16), round(float(pixels[i, 1]) * 16))
        b, g, r = tones[i]
        cv2.circle(image, centre, max(8, round(size * 16)), (b, g, r), -1, cv2.LINE_AA, 4)


def _lamp_post(image: Image, camera: PinholeCamera, light: Light, x: float, y: float) -> None:
    sign = -1.0 if y > 0 else 1.0
    ends = np.array([[x, y, 0.0], [x, y, 9.0], [x, y + sign * 1.8, 9.3]])
    pixels, depth = camera.project(ends)
    if float(depth.min()) < 6.0:
        return
    thick = max(1, round(0.16 * camera.focal_px / float(depth[0])))
    tone = light.through_haze(np.array([[105.0, 108.0, 108.0]]), depth[:1])[0]
    points = np.rint(pixels * 16).astype(np.int32)
    cv2.polylines(image, [points], False, tuple(float(c) for c in tone), thick, cv2.LINE_AA, 4)


def paint_tree_line(
    image: Image, camera: PinholeCamera, light: Light, rng: np.random.Generator
) -> None:
    """A far, hazy silhouette along the horizon."""
    u = np.arange(0, camera.width_px + 8, 4, dtype=np.float64)
    horizon = camera.height_px / 2 - camera.focal_px * np.tan(camera.pitch_rad)
    for rise, haze in ((14.0, 0.45), (8.0, 0.65)):
        steps = np.cumsum(rng.normal(size=len(u)))
        bumps = cv2.GaussianBlur(steps.astype(np.float32)[None, :], (0, 0), 2.0)[0]
        bumps = (bumps - bumps.min()) / max(float(np.ptp(bumps)), 1e-6)
        top = horizon - rise * (0.4 + bumps + 0.15 * rng.random(len(u)))
        edge = np.column_stack([u, top])
        base = np.array([[camera.width_px + 8, horizon + 4], [0, horizon + 4]])
        haze *= math.exp(-_TREE_LINE_M / light.fog_m)
        tone = np.array([70.0, 85.0, 72.0]) * haze + np.asarray(light.sky_horizon) * (1 - haze)
        points = np.rint(np.concatenate([edge, base])).astype(np.int32)
        cv2.fillPoly(image, [points], tuple(float(c) for c in np.clip(tone, 0, 255)))


def _ground_shadow(
    image: Grid, camera: PinholeCamera, light: Light, centre: Floats, radius: float, height: float
) -> None:
    """The mottled shadow that a tree's crown throws on the ground."""
    away = -np.asarray(light.sun[:2]) / light.sun[2]
    angles = np.linspace(0, 2 * np.pi, 18, endpoint=False)
    disc = np.column_stack([np.cos(angles), np.sin(angles)]) * radius
    ground = centre + away * height + disc
    pixels, depth = camera.project(np.column_stack([ground, np.zeros(18)]))
    if float(depth.min()) < _NEAREST_M:
        return
    mask = np.zeros(image.shape[:2], dtype=np.uint8)
    fill(mask, cv2.convexHull(pixels.astype(np.float32))[:, 0, :].astype(np.float64), (255,))
    x, y, w, h = cv2.boundingRect(mask)
    if w == 0:
        return
    part = cv2.GaussianBlur(mask[y : y + h, x : x + w], (0, 0), 2.0).astype(np.float32) / 255
    image[y : y + h, x : x + w] *= (1 - 0.75 * light.shadow_strength * part)[..., None]


def paint_tree_shadow(
    image: Grid, camera: PinholeCamera, light: Light, rng: np.random.Generator, foot_m: Floats
) -> None:
    """The shadow of a tree at a road point (2,); changes the picture in place."""
    height = rng.uniform(3, 7)
    for _ in range(6):
        wobble = rng.normal(scale=0.9, size=2)
        _ground_shadow(image, camera, light, foot_m + wobble, rng.uniform(0.7, 1.8), height)


def paint_tree_shadows(
    image: Grid,
    camera: PinholeCamera,
    light: Light,
    road: Road,
    rng: np.random.Generator,
    count: int,
) -> None:
    """Shadows of roadside trees that may fall across the lanes; changes the picture in place."""
    for _ in range(count):
        side = rng.choice([-1.0, 1.0])
        edge = road.left_edge_m if side > 0 else -road.right_edge_m
        centre = np.array([rng.uniform(12, 110), side * (edge + rng.uniform(3, 8))])
        paint_tree_shadow(image, camera, light, rng, centre)


def paint_scenery(
    image: Image,
    camera: PinholeCamera,
    light: Light,
    road: Road,
    palette: Palette,
    rng: np.random.Generator,
    density: Density,
) -> list[RoadsideObject]:
    """Everything upright beside the road, from far to near; changes the picture in place.

    Nothing stands between the camera and the carriageway. Returns what was painted.
    """
    paint_tree_line(image, camera, light, rng)
    left = max(road.left_edge_m + road.pavement_m, camera.lateral_m) + 1.0
    right = min(road.right_edge_m - road.pavement_m, camera.lateral_m) - 1.0
    things: list[RoadsideObject] = []
    for edge, sign in ((left, 1.0), (right, -1.0)):
        things += [
            (x, "building", edge + sign * rng.uniform(6, 22))
            for x in _spread(rng, density.buildings, 45, 420)
        ]
        things += [
            (x, "tree", edge + sign * rng.uniform(2.5, 9))
            for x in _spread(rng, density.trees, 25, 380)
        ]
        if density.lamp_posts > 0:
            spacing = 240 / density.lamp_posts
            posts = np.arange(rng.uniform(20, 45), 280, spacing)
            things += [(float(x), "lamp", edge - sign * 0.4) for x in posts]
    paint_objects(image, camera, light, palette, rng, things)
    return things


def paint_objects(
    image: Image,
    camera: PinholeCamera,
    light: Light,
    palette: Palette,
    rng: np.random.Generator,
    things: Sequence[RoadsideObject],
) -> None:
    """Upright things, from far to near; changes the picture in place."""
    for x, kind, y in sorted(things, reverse=True):
        if kind == "building":
            choice = palette.buildings[int(rng.integers(len(palette.buildings)))]
            _building(image, camera, light, rng, choice, x, y)
        elif kind == "tree":
            b, g, r = palette.foliage
            j = rng.uniform(0.8, 1.2, 3)
            _tree(image, camera, light, rng, (b * j[0], g * j[1], r * j[2]), x, y)
        else:
            _lamp_post(image, camera, light, x, y)


def _spread(rng: np.random.Generator, mean: float, low: float, high: float) -> Floats:
    return np.asarray(rng.uniform(low, high, int(rng.poisson(mean))), dtype=np.float64)
