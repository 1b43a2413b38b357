"""Vehicles blurred by their motion, and mirrored in a wet road."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.light import Light
from slipstream_lab.simulation.streetdrive.rendering.mesh import Floats
from slipstream_lab.simulation.streetdrive.rendering.painter import (
    FIXED_BITS,
    Image,
    PlacedMesh,
    fill,
    fixed,
    full_box,
    outline_px,
    paint_vehicle,
)


def paint_moving(
    image: Image, camera: PinholeCamera, light: Light, vehicle: PlacedMesh, exposure_s: float
) -> None:
    """Draw one vehicle, blurred along the way that it drives while the frame gathers light."""
    ahead = vehicle.directed(np.array([[1.0, 0.0, 0.0]]))[0] * vehicle.speed_mps * exposure_s
    here = np.array([vehicle.x_m, vehicle.y_m, vehicle.mesh.height_m / 2])
    ends, depth = camera.project(np.array([here - ahead / 2, here + ahead / 2]))
    way = ends[1] - ends[0]
    if float(depth.min()) < 3.0 or float(np.hypot(*way)) < 1.0:
        paint_vehicle(image, camera, light, vehicle)
        return
    way *= min(1.0, 60.0 / float(np.hypot(*way)))
    pixels, _ = outline_px(camera, vehicle)
    hull = cv2.convexHull(pixels.astype(np.float32))[:, 0, :].astype(np.float64)
    margin = math.ceil(float(np.abs(way).max()) / 2) + 2
    (left, top), (right, bottom) = hull.min(axis=0) - margin, hull.max(axis=0) + margin
    rows = slice(max(0, int(top)), min(image.shape[0], int(bottom) + 1))
    columns = slice(max(0, int(left)), min(image.shape[1], int(right) + 1))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return
    below = image[rows, columns].copy()
    paint_vehicle(image, camera, light, vehicle)
    cover = np.zeros(below.shape[:2], dtype=np.uint8)
    fill(cover, hull - np.array([columns.start, rows.start]), (255,))
    share = cover.astype(np.float32)[..., None] / 255
    kernel = _line_kernel(way)
    inked = cv2.filter2D(image[rows, columns] * share, -1, kernel)
    alpha = cv2.filter2D(share[..., 0], -1, kernel)[..., None]
    mixed = below * (1 - alpha) + inked
    image[rows, columns] = np.clip(mixed, 0, 255).astype(np.uint8)


def _line_kernel(way: Floats) -> NDArray[np.float32]:
    """Averaging along a line of pixels (across, down) through the middle."""
    half = math.ceil(float(np.abs(way).max()) / 2)
    kernel = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
    middle = np.array([half, half])
    a, b = (fixed(middle + s * way / 2).tolist() for s in (-1, 1))
    cv2.line(kernel, a, b, (1.0,), 1, cv2.LINE_8, FIXED_BITS)
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def paint_mirrored(image: Image, camera: PinholeCamera, vehicle: PlacedMesh, share: float) -> None:
    """Mirror a painted vehicle in the wet road below it, faintly and drawn out; in place."""
    pixels, ahead = outline_px(camera, vehicle)
    if ahead < 1:
        return
    x1, y1, x2, y2 = full_box(pixels)
    deep = int(min(0.8 * (y2 - y1), image.shape[0] - y2))
    left, right = max(0, int(x1)), min(image.shape[1], int(x2) + 1)
    top = max(0, int(y2) - deep)
    if deep < 3 or right - left < 3 or int(y2) - top < 3:
        return
    flipped = cv2.blur(image[top : int(y2), left:right][::-1], (3, 9)).astype(np.float32)
    fade = np.linspace(share, 0.0, len(flipped), dtype=np.float32)[:, None, None]
    sides = np.minimum(np.arange(right - left), np.arange(right - left)[::-1])
    fade = fade * np.clip(sides / 4, 0, 1).astype(np.float32)[None, :, None]
    region = image[int(y2) : int(y2) + len(flipped), left:right]
    flipped, fade = flipped[: len(region)], fade[: len(region)]
    region[:] = (region * (1 - fade) + flipped * fade).astype(np.uint8)
