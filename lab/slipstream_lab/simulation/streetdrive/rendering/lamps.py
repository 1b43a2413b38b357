"""Lamps of vehicles and streets at night: beams on the road, glow in the lens, wet reflections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from slipstream_lab.simulation.streetdrive.rendering.camera import Floats, PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.conditions import Conditions
from slipstream_lab.simulation.streetdrive.rendering.ground import Grid, GroundView
from slipstream_lab.simulation.streetdrive.rendering.light import LAMP_HEIGHT_M, Light
from slipstream_lab.simulation.streetdrive.rendering.mesh import Colour, Material, Mesh
from slipstream_lab.simulation.streetdrive.rendering.painter import Image, PlacedMesh
from slipstream_lab.simulation.streetdrive.rendering.weathered import lamp_field

_COARSE = 4
_BEAM_M, _BEAM_HALF_M, _CELLS_PER_M = 45.0, 8.0, 3
HEAD: Colour = (215.0, 238.0, 255.0)
TAIL: Colour = (20.0, 25.0, 255.0)


STREET_LAMPS: tuple[Colour, ...] = (
    (60.0, 150.0, 255.0),
    (225.0, 240.0, 255.0),
    (150.0, 205.0, 255.0),
)
"""Sodium, cool and warm light-emitting diodes, BGR."""


@lru_cache(maxsize=1)
def _beam() -> Grid:
    """Light of a pair of low beams on the road ahead, peak 1; rows run across, columns ahead."""
    x = (np.arange(round(_BEAM_M * _CELLS_PER_M)) + 0.5) / _CELLS_PER_M
    y = (np.arange(round(2 * _BEAM_HALF_M * _CELLS_PER_M)) + 0.5) / _CELLS_PER_M - _BEAM_HALF_M
    ahead = x / 8 * np.exp(1 - x / 8) * np.clip((_BEAM_M - x) / 10, 0, 1)
    spread = 0.5 + 0.09 * x
    lobes = sum(np.exp(-0.5 * ((y[:, None] - s) / spread) ** 2) for s in (-0.6, 0.6))
    field = np.asarray(ahead * lobes, dtype=np.float32)
    return np.asarray(field / field.max(), dtype=np.float32)


def light_road(
    image: Image, surface: Image, camera: PinholeCamera, vehicles: Sequence[PlacedMesh]
) -> None:
    """Add the vehicles' low beams to the road; changes the picture in place. `surface`: the same
    view without vehicles in even light of factor 1.
    """
    height, width = image.shape[:2]
    size = width // _COARSE, height // _COARSE
    field = np.zeros((size[1], size[0]), dtype=np.float32)
    shrink = np.diag([1 / _COARSE, 1 / _COARSE, 1.0])
    beam = _beam()
    for vehicle in vehicles:
        start = vehicle.mesh.length_m / 2
        local = np.array([[0, 0, 0], [_BEAM_M, 0, 0], [0, 1, 0]]) + np.array([start, 0, 0])
        origin, end, left = vehicle.to_world(local)[:, :2]
        axis, side = (end - origin) / _BEAM_M, left - origin
        place = np.eye(3)
        place[:2, 0], place[:2, 1] = axis / _CELLS_PER_M, side / _CELLS_PER_M
        place[:2, 2] = origin - side * _BEAM_HALF_M
        matrix = shrink @ camera.ground_homography @ place
        warped = cv2.warpPerspective(beam, matrix, size, flags=cv2.INTER_LINEAR)
        field += np.asarray(warped, dtype=np.float32)
    # What lies behind the camera would appear above the horizon.
    horizon = camera.height_px / 2 - camera.focal_px * np.tan(camera.pitch_rad)
    field[: max(0, round(float(horizon) / _COARSE) + 1)] = 0
    # Eyes and sensors saturate: beams that overlap do not add up for ever.
    level = (1 - np.exp(-1.1 * field)) * 0.62 * 255
    gain = cv2.resize(level.astype(np.uint8), (width, height))
    rows = np.flatnonzero(gain.max(axis=1))
    if not rows.size:
        return
    part = np.s_[int(rows[0]) : int(rows[-1]) + 1]
    tinted = cv2.merge([cv2.convertScaleAbs(gain[part], alpha=t / 255) for t in HEAD])
    light = cv2.multiply(surface[part], tinted, scale=1 / 255)
    image[part] = cv2.add(image[part], light)


@lru_cache(maxsize=64)
def _sprite(width: int, height: int) -> Grid:
    """A glow, 1 in the middle and 0 at its rim: a bright core in a wide halo."""
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    r2 = x * x + y * y
    glow = 0.8 * np.exp(-r2 * 18) + 0.22 * np.exp(-r2 * 3.5)
    glow -= glow[height // 2, 0]
    return np.asarray(np.clip(glow / glow.max(), 0, 1), dtype=np.float32)


def add_glow(
    image: Image, centre: Floats, radius: tuple[float, float], colour: Floats, strength: float
) -> None:
    """Add a glow to the picture in place; radius is (across, down) in pixels."""
    # Sizes in steps of a fifth, so that few sprites are made.
    steps = [max(2, round(1.2 ** round(np.log(max(r, 1.7)) / np.log(1.2)))) for r in radius]
    sprite = _sprite(2 * steps[0] + 1, 2 * steps[1] + 1)
    left, top = round(float(centre[0])) - steps[0], round(float(centre[1])) - steps[1]
    x1, y1 = max(left, 0), max(top, 0)
    x2 = min(left + sprite.shape[1], image.shape[1])
    y2 = min(top + sprite.shape[0], image.shape[0])
    if x1 >= x2 or y1 >= y2:
        return
    part = sprite[y1 - top : y2 - top, x1 - left : x2 - left, None] * (colour * strength)
    image[y1:y2, x1:x2] = cv2.add(image[y1:y2, x1:x2], np.clip(part, 0, 255).astype(np.uint8))


def _lamps(mesh: Mesh) -> tuple[Floats, Floats, Floats]:
    """Centres (n, 3), normals (n, 3) and whether each lamp is red (n,)."""
    faces = np.flatnonzero(mesh.materials == Material.LAMP)
    colours = mesh.colours[faces]
    red = (colours[:, 2] > 1.6 * colours[:, 0]).astype(np.float64)
    return mesh.corners[faces, :4].mean(axis=1), mesh.normals[faces], red


def paint_lamps(
    image: Image, camera: PinholeCamera, vehicle: PlacedMesh, conditions: Conditions
) -> None:
    """The glow of a vehicle's lamps that face the camera, and their streaks on a wet road."""
    night, wetness = conditions.night, conditions.wetness
    centres, normals, red = _lamps(vehicle.mesh)
    if not len(centres):
        return
    world = vehicle.to_world(centres)
    sight = camera.position_m - world
    distance = np.linalg.norm(sight, axis=1)
    facing = (sight * vehicle.directed(normals)).sum(axis=1) / distance
    pixels, depth = camera.project(world)
    mirrored, _ = camera.project(world * np.array([1.0, 1.0, -1.0]))
    for i in np.flatnonzero((facing > 0.12) & (depth > 3)):
        metre = camera.focal_px / float(distance[i])
        clear = math.exp(-float(distance[i]) * conditions.extinction_per_m)
        power = (0.5 + 0.5 * float(facing[i])) * (1.0 if night else 0.55) * clear
        colour = np.array(TAIL if red[i] else HEAD)
        size = (0.35 if red[i] else 0.9) * metre + (2.0 if red[i] else 6.0)
        add_glow(image, pixels[i], (size, size), colour, power * (0.9 if red[i] else 1.25))
        if wetness > 0:
            long = float(mirrored[i, 1] - pixels[i, 1])
            strength = wetness * power * (0.4 if night else 0.16)
            add_glow(image, mirrored[i], (0.6 * size, 0.8 * long + 2), colour, strength)


def street_lit(
    light: Light, posts: Sequence[tuple[float, float]], rng: np.random.Generator
) -> Light:
    """The night's light with the lamps on posts at road points; some streets' lamps are off."""
    kind = np.array(STREET_LAMPS[int(rng.integers(len(STREET_LAMPS)))]) / 255
    level = float(rng.uniform(0.6, 1.3))
    if rng.random() < 0.15:
        return light
    b, g, r = (float(c) for c in kind * level)
    heads = tuple((x, y - math.copysign(1.8, y)) for x, y in posts)
    return replace(light, lamps=heads, lamp_colour=(b, g, r))


def at_night(
    even: Image,
    view: GroundView,
    camera: PinholeCamera,
    light: Light,
    wetness: float,
    rng: np.random.Generator,
) -> Image:
    """A picture painted in even light as the sky's rest and the street lamps light it."""
    field = lamp_field(view, light)[..., None] * np.asarray(light.lamp_colour, dtype=np.float32)
    field += light.ambient * np.sqrt(2.0 - np.asarray(light.tint, dtype=np.float32))
    # Pixels above the horizon show the sky, which is painted dark already, or what rises into it.
    field[~view.hits] = np.maximum(light.ambient, 0.25)
    image: Image = np.clip(even * field, 0, 255).astype(np.uint8)
    colour = np.asarray(light.lamp_colour) / max(max(light.lamp_colour), 1e-6) * 255
    for x, y in light.lamps:
        world = np.array([[x, y, LAMP_HEIGHT_M], [x, y, -LAMP_HEIGHT_M]])
        (head, mirrored), depth = camera.project(world)
        if float(depth.min()) < 6:
            continue
        size = 0.9 * camera.focal_px / float(depth[0]) + 4
        add_glow(image, head, (size, size), colour, 1.2)
        if wetness > 0:
            long = 0.35 * float(mirrored[1] - head[1])
            add_glow(image, mirrored, (0.8 * size, long), colour, 0.35 * wetness)
    _far_lights(image, camera, rng)
    return image


def _far_lights(image: Image, camera: PinholeCamera, rng: np.random.Generator) -> None:
    """Windows and lamps of the town near the horizon."""
    horizon = camera.height_px / 2 - camera.focal_px * math.tan(camera.pitch_rad)
    for _ in range(int(rng.poisson(25))):
        place = np.array([rng.uniform(0, camera.width_px), horizon + rng.normal(0, 9)])
        tint = np.array(STREET_LAMPS[int(rng.integers(len(STREET_LAMPS)))])
        size = float(rng.uniform(1.5, 4))
        add_glow(image, place, (size, size), tint, float(rng.uniform(0.3, 1.0)))
