"""Paints vehicle meshes and their shadows into a picture, farthest first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.light import Light
from slipstream_lab.simulation.streetdrive.rendering.mesh import Floats, Material, Mesh

Image = NDArray[np.uint8]
FIXED_BITS = 4
_FIXED = 1 << FIXED_BITS
_NEAREST_M = 1.0
_FINE_DETAIL_PX = 26.0


@dataclass(frozen=True)
class PlacedMesh:
    """A mesh on the road: ground centre in metres and heading along x (+1 away, -1 towards).

    `turn_rad` turns it from there to the left, on roads that are not straight. The speed blurs it
    where the exposure takes time.
    """

    mesh: Mesh
    x_m: float
    y_m: float
    heading: int
    turn_rad: float = 0.0
    speed_mps: float = 0.0

    def turned(self, vectors: Floats) -> Floats:
        """Vectors (..., 2 or 3) turned about the vertical by `turn_rad`."""
        if self.turn_rad == 0.0:
            return vectors
        cos, sin = math.cos(self.turn_rad), math.sin(self.turn_rad)
        turned = np.array(vectors)
        turned[..., 0] = cos * vectors[..., 0] - sin * vectors[..., 1]
        turned[..., 1] = sin * vectors[..., 0] + cos * vectors[..., 1]
        return turned

    def directed(self, vectors: Floats) -> Floats:
        """Vectors (..., 3) in the vehicle's axes as world directions."""
        return self.turned(vectors * np.array([self.heading, self.heading, 1.0]))

    def to_world(self, points: Floats) -> Floats:
        """Points (..., 3) in the vehicle's axes as world coordinates."""
        return np.asarray(self.directed(points) + np.array([self.x_m, self.y_m, 0.0]))


@dataclass(frozen=True)
class Seen:
    """Where one vehicle lies in the picture.

    `box_px` is x1, y1, x2, y2, the tight projected box clipped to the picture; `full_box_px` is
    the box before clipping. `visible_fraction` is the share of the silhouette's area that is
    inside the picture and not covered by nearer things.
    """

    box_px: tuple[float, float, float, float]
    full_box_px: tuple[float, float, float, float]
    visible_fraction: float


def fixed(pixels: Floats) -> NDArray[np.int32]:
    """Pixels in OpenCV's fixed-point form with 4 fractional bits."""
    return np.asarray(np.rint(np.clip(pixels, -20000, 20000) * _FIXED), dtype=np.int32)


def fill(image: Image, pixels: Floats, colour: Sequence[float], smooth: bool = True) -> None:
    """Fill a convex polygon given in (sub)pixels (n, 2)."""
    line = cv2.LINE_AA if smooth else cv2.LINE_8
    cv2.fillConvexPoly(image, fixed(pixels), tuple(colour), line, FIXED_BITS)


def outline_px(camera: PinholeCamera, vehicle: PlacedMesh) -> tuple[Floats, float]:
    """Projected outline points (n, 2) in front of the camera, and their share of all points."""
    pixels, depth = camera.project(vehicle.to_world(vehicle.mesh.outline))
    ahead = depth >= _NEAREST_M
    return pixels[ahead], float(ahead.mean())


def full_box(pixels: Floats) -> tuple[float, float, float, float]:
    """Tight box x1, y1, x2, y2 of pixels (n, 2)."""
    (x1, y1), (x2, y2) = pixels.min(axis=0), pixels.max(axis=0)
    return (float(x1), float(y1), float(x2), float(y2))


def shade(
    camera: PinholeCamera, light: Light, vehicle: PlacedMesh, faces: NDArray[np.int64]
) -> Floats:
    """Colours (n, 3) of chosen faces as the camera sees them."""
    mesh = vehicle.mesh
    shading = mesh.normals if mesh.shading is None else mesh.shading
    normals = vehicle.directed(shading[faces])
    base = mesh.colours[faces]
    material = mesh.materials[faces]
    lit = base * (light.lambert(normals) + light.lamplight(normals, vehicle.x_m, vehicle.y_m))

    centre = vehicle.to_world(mesh.corners[faces, 0])
    view = camera.position_m - centre
    distance = np.linalg.norm(view, axis=1)
    view /= distance[:, None]
    facing = np.clip((view * normals).sum(axis=1), 0.0, 1.0)
    # Schlick's approximation of Fresnel reflectance; the mirrored ray picks a sky colour by height.
    mirrored = 2 * facing[:, None] * normals - view
    fresnel = (1.0 - facing) ** 5
    up = np.clip(mirrored[:, 2], 0.0, 1.0)[:, None]
    sky = np.asarray(light.sky_horizon) * (1 - up) + np.asarray(light.sky_zenith) * up
    sky = np.where(mirrored[:, 2:] < 0, np.array([70.0, 72.0, 70.0]), sky)
    glass = material == Material.GLASS
    paint = material == Material.PAINT
    reflect = np.where(glass, 0.22 + 0.7 * fresnel, np.where(paint, 0.05 + 0.35 * fresnel, 0.0))
    lit = lit * (1 - reflect[:, None]) + sky * reflect[:, None]
    glint = np.clip((mirrored * np.asarray(light.sun)).sum(axis=1), 0.0, 1.0) ** 24
    shine = np.where(glass | paint, 150.0 * glint * light.sun_strength, 0.0)
    lit = lit + shine[:, None]
    lit = np.where((material == Material.LAMP)[:, None], np.maximum(lit, base * 0.85), lit)
    return np.clip(light.through_haze(lit, distance), 0, 255)


def paint_vehicle(image: Image, camera: PinholeCamera, light: Light, vehicle: PlacedMesh) -> None:
    """Draw one vehicle's visible faces: parts far to near, then layers, then depth."""
    mesh = vehicle.mesh
    towards = _turned_to(camera, vehicle)
    middle = vehicle.to_world(mesh.middle)
    distance = float((middle - camera.position_m) @ camera.rotation[2])
    if mesh.height_m * camera.focal_px / max(distance, 1.0) < _FINE_DETAIL_PX:
        towards &= ~mesh.minor
    faces = np.flatnonzero(towards)
    pixels, depth = camera.project(vehicle.to_world(mesh.corners[faces]))
    ahead = depth.min(axis=1) >= _NEAREST_M
    if not ahead.all():
        faces, pixels, depth = faces[ahead], pixels[ahead], depth[ahead]
    if not len(faces):
        return
    face_depth = depth.mean(axis=1)
    parts = mesh.parts[faces]
    # Part 0 is the chassis and lies under the others.
    part_depth = np.zeros(len(faces))
    for part in np.unique(parts):
        chosen = parts == part
        part_depth[chosen] = 1e9 if part == 0 else face_depth[chosen].mean()
    order = np.lexsort((-face_depth, mesh.layers[faces], -part_depth))
    colours = shade(camera, light, vehicle, faces)
    points = fixed(pixels)
    sizes = mesh.sizes[faces].tolist()
    tones = colours.tolist()
    for i in order.tolist():
        cv2.fillConvexPoly(image, points[i, : sizes[i]], tones[i], cv2.LINE_AA, FIXED_BITS)


def _turned_to(camera: PinholeCamera, vehicle: PlacedMesh) -> NDArray[np.bool_]:
    """Which faces show their front to the camera."""
    mesh = vehicle.mesh
    sight = camera.position_m - vehicle.to_world(mesh.corners[:, 0])
    towards = (sight * vehicle.directed(mesh.normals)).sum(axis=1) > 0
    return np.asarray(towards, dtype=np.bool_)


def paint_shadow(image: Image, camera: PinholeCamera, light: Light, vehicle: PlacedMesh) -> None:
    """Darken the road under a vehicle and where it hides the sun."""
    mesh = vehicle.mesh
    half_l, half_w = mesh.length_m / 2, mesh.width_m / 2
    sun = np.asarray(light.sun)
    top = mesh.height_m * 0.96
    foot = np.array([[sx * half_l, sy * half_w] for sx, sy in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    body = np.array([vehicle.x_m, vehicle.y_m])
    foot += body
    reach = foot - body
    foot = body + vehicle.turned(reach) if vehicle.turn_rad else foot
    cast = body + vehicle.turned(reach) * 0.86 - sun[:2] / sun[2] * top
    belt = foot - sun[:2] / sun[2] * mesh.height_m * 0.55
    hard = np.concatenate([foot, belt, cast])
    soft = body + vehicle.turned(reach * np.array([1.04, 1.18]))
    for ground, strength in ((hard, light.shadow_strength * 0.82), (soft, 0.62)):
        world = np.column_stack([ground, np.full(len(ground), 0.02)])
        pixels, depth = camera.project(world)
        if float(depth.min()) < _NEAREST_M:
            continue
        clear = float(np.exp(-depth.mean() / light.fog_m))
        _darken(image, pixels, strength * clear)


def _darken(image: Image, pixels: Floats, strength: float) -> None:
    """Multiply the picture by 1 - strength inside the convex hull of pixels, with soft edges."""
    height, width = image.shape[:2]
    x1, y1, x2, y2 = full_box(pixels)
    soft = max(1, min(9, int((y2 - y1) / 8)))
    left, top = max(0, int(x1) - soft), max(0, int(y1) - soft)
    right, bottom = min(width, int(x2) + soft + 2), min(height, int(y2) + soft + 2)
    if right <= left or bottom <= top:
        return
    hull = cv2.convexHull(pixels.astype(np.float32))[:, 0, :].astype(np.float64)
    mask = np.zeros((bottom - top, right - left), dtype=np.uint8)
    level = round(255 * strength)
    fill(mask, hull - np.array([left, top]), (level,), smooth=False)
    mask = cv2.blur(mask, (2 * (soft // 2) + 1, 2 * (soft // 2) + 1))
    keep = cv2.cvtColor(cv2.bitwise_not(mask), cv2.COLOR_GRAY2BGR)
    region = image[top:bottom, left:right]
    cv2.multiply(region, keep, dst=region, scale=1 / 255)


def measure(
    camera: PinholeCamera, vehicles: Sequence[PlacedMesh], occluders: Sequence[Floats] = ()
) -> list[Seen | None]:
    """Boxes and visible fractions; vehicles come sorted far to near, covers lie in front of all.

    A vehicle outside the picture gives None. Where a vehicle reaches behind the camera, the box is
    that of the part in front and the fraction is scaled by that part's share.
    """
    owner = np.zeros((camera.height_px, camera.width_px), dtype=np.uint16)
    hulls: list[tuple[Floats, float] | None] = []
    for number, vehicle in enumerate(vehicles, start=1):
        pixels, ahead = outline_px(camera, vehicle)
        if ahead < 0.05:
            hulls.append(None)
            continue
        hull = cv2.convexHull(pixels.astype(np.float32))[:, 0, :].astype(np.float64)
        hulls.append((hull, ahead))
        fill(owner, hull, (number,), smooth=False)  # type: ignore[arg-type]
    for cover in occluders:
        fill(owner, cover, (65535,), smooth=False)  # type: ignore[arg-type]
    seen: list[Seen | None] = []
    for number, entry in enumerate(hulls, start=1):
        if entry is None:
            seen.append(None)
            continue
        hull, ahead = entry
        whole = full_box(hull)
        x1, x2 = (min(max(value, 0.0), float(camera.width_px)) for value in whole[::2])
        y1, y2 = (min(max(value, 0.0), float(camera.height_px)) for value in whole[1::2])
        if x2 - x1 < 1.0 or y2 - y1 < 1.0:
            seen.append(None)
            continue
        region = owner[int(y1) : int(y2) + 2, int(x1) : int(x2) + 2]
        count = int(np.count_nonzero(region == number))
        # The integer fill also covers the border pixels; compare with the same fill uncovered.
        area = float(cv2.contourArea(hull.astype(np.float32)))
        border = float(cv2.arcLength(hull.astype(np.float32), closed=True)) / 2
        fraction = ahead * min(1.0, count / max(area + border, 1.0))
        seen.append(Seen((x1, y1, x2, y2), whole, fraction))
    return seen
