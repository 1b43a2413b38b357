"""What is between the scene and the sensor: rain and snow in the air, drops, dirt and glare."""

from __future__ import annotations

import cv2
import numpy as np

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.conditions import Conditions
from slipstream_lab.simulation.streetdrive.rendering.light import Light
from slipstream_lab.simulation.streetdrive.rendering.painter import Image

_SPARE = 256
_SHUTTER_S = 1 / 100


class Lens:
    """One camera's front glass and the air before it; `gather` is called once a frame."""

    def __init__(
        self, conditions: Conditions, camera: PinholeCamera, light: Light, rng: np.random.Generator
    ) -> None:
        self._rng = rng
        self._size = (camera.height_px, camera.width_px)
        shutter = conditions.exposure_s or _SHUTTER_S
        bright = 0.35 if conditions.night else 1.0
        self._layers: list[Image] = []
        if conditions.rain_mm_h > 0:
            self._layers += _streaks(conditions.rain_mm_h, camera, shutter, bright, rng)
        if conditions.snow_mm_h > 0:
            self._layers += _flakes(conditions.snow_mm_h, camera, shutter, bright, rng)
        self._drops = _draw_drops(conditions.rain_mm_h, self._size, rng)
        self._dirt = _draw_dirt(conditions.dirt, self._size, light, rng)
        self._glare = _glare(camera, light) if conditions.low_sun else None

    def gather(self, image: Image) -> Image:
        """The picture (h, w, 3) behind the glass; the one given is not changed."""
        result = image
        height, width = self._size
        falling: Image | None = None
        for layer in self._layers:
            top, left = (int(v) for v in self._rng.integers(0, _SPARE, 2))
            part = layer[top : top + height, left : left + width]
            falling = part if falling is None else _as_image(cv2.add(falling, part))
        if falling is not None:
            result = _over(result, falling)
        if self._glare is not None:
            result = _as_image(cv2.add(result, self._glare))
        if self._drops:
            result = self._refracted(result)
        if self._dirt is not None:
            keep, add = self._dirt
            result = _as_image(cv2.add(cv2.multiply(result, keep, scale=1 / 255), add))
        return result

    def _refracted(self, image: Image) -> Image:
        """Drops show the scene upside down, small and out of focus."""
        small = cv2.GaussianBlur(
            cv2.resize(image, (160, 90), interpolation=cv2.INTER_AREA), (0, 0), 2
        )
        result = image.copy()
        for left, top, mask in self._drops:
            high, wide = mask.shape[:2]
            u, v = (left + wide / 2) / self._size[1] * 160, (top + high / 2) / self._size[0] * 90
            x, y = int(np.clip(u - 20, 0, 120)), int(np.clip(v - 20, 0, 50))
            inside = cv2.resize(small[y : y + 40, x : x + 40][::-1, ::-1], (wide, high))
            region = result[top : top + high, left : left + wide]
            region[:] = (region * (1 - mask) + inside * mask).astype(np.uint8)
        return result


def _as_image(values: object) -> Image:
    return np.asarray(values, dtype=np.uint8)


def _over(image: Image, layer: Image) -> Image:
    """Whiten the picture by a layer (h, w) of 0..255."""
    rest = cv2.bitwise_not(image)
    return _as_image(cv2.add(image, cv2.multiply(rest, cv2.merge([layer] * 3), scale=1 / 255)))


def _streaks(
    rate: float, camera: PinholeCamera, shutter: float, bright: float, rng: np.random.Generator
) -> list[Image]:
    """Two layers of rain streaks, near and far.

    Drops fall at 4 to 9 m/s; a streak is as long as its drop falls while the shutter is open and
    as wide as the drop, faint because the drop covers each pixel only for part of that time.
    """
    layers = []
    slant = float(rng.normal(0, 0.12))
    for near, far, count in ((1.2, 5.0, 12.0), (5.0, 20.0, 45.0)):
        layer = np.zeros((camera.height_px + _SPARE, camera.width_px + _SPARE), dtype=np.uint8)
        for _ in range(int(count * rate**0.7 * 1.6)):
            metre = camera.focal_px / float(rng.uniform(near, far))
            fall, wide = rng.uniform(4, 9) * shutter * metre, rng.uniform(1, 3) * 1e-3 * metre
            tone = 200 * bright * min(1.0, wide) * rng.uniform(0.25, 0.7)
            u, v = rng.uniform(0, layer.shape[1]), rng.uniform(0, layer.shape[0])
            lean = fall * (slant + rng.normal(0, 0.03))
            ends = np.rint(np.array([[u, v], [u + lean, v + fall]]) * 16).astype(np.int32)
            thick = max(1, round(wide))
            cv2.line(layer, ends[0].tolist(), ends[1].tolist(), (tone,), thick, cv2.LINE_AA, 4)
        layers.append(_as_image(cv2.GaussianBlur(layer, (0, 0), 0.8 if near > 4 else 1.6)))
    return layers


def _flakes(
    rate: float, camera: PinholeCamera, shutter: float, bright: float, rng: np.random.Generator
) -> list[Image]:
    """Two layers of snowflakes, near ones large and out of focus; they fall at 1 to 2 m/s."""
    layers = []
    slant = float(rng.normal(0, 0.6))
    for near, far, count, blur in ((1.5, 6.0, 120.0, 2.5), (6.0, 30.0, 2500.0, 0.8)):
        layer = np.zeros((camera.height_px + _SPARE, camera.width_px + _SPARE), dtype=np.uint8)
        for _ in range(int(count * rate**0.7)):
            metre = camera.focal_px / float(rng.uniform(near, far))
            fall, wide = rng.uniform(1, 2) * shutter * metre, rng.uniform(4, 15) * 1e-3 * metre
            tone = 255 * (0.5 + 0.5 * bright) * rng.uniform(0.5, 0.95) * min(1.0, wide / 1.5)
            u, v = rng.uniform(0, layer.shape[1]), rng.uniform(0, layer.shape[0])
            ends = np.rint(np.array([[u, v], [u + slant * fall, v + fall]]) * 16).astype(np.int32)
            thick = max(1, round(wide))
            cv2.line(layer, ends[0].tolist(), ends[1].tolist(), (tone,), thick, cv2.LINE_AA, 4)
        layers.append(_as_image(cv2.GaussianBlur(layer, (0, 0), blur)))
    return layers


def _draw_drops(
    rate: float, size: tuple[int, int], rng: np.random.Generator
) -> list[tuple[int, int, np.ndarray[tuple[int, ...], np.dtype[np.float32]]]]:
    """Drops on the glass as (left, top, mask (h, w, 1) of 0..1)."""
    drops = []
    for _ in range(int(rng.poisson(min(1.2 * rate**0.8, 45.0))) if rate > 0 else 0):
        wide = int(np.clip(rng.lognormal(3.1, 0.5), 8, 90))
        high = int(wide * rng.uniform(0.9, 1.5))
        left, top = (
            int(rng.integers(0, max(1, whole - n)))
            for whole, n in ((size[1], wide), (size[0], high))
        )
        mask = np.zeros((high, wide), dtype=np.float32)
        axes = (int(wide * 0.36), int(high * 0.36))
        cv2.ellipse(
            mask, (wide // 2, high // 2), axes, float(rng.uniform(-20, 20)), 0, 360, (1.0,), -1
        )
        mask = cv2.GaussianBlur(mask, (0, 0), max(1.0, wide * 0.07)) * np.float32(
            rng.uniform(0.5, 0.9)
        )
        drops.append((left, top, np.asarray(mask[..., None], dtype=np.float32)))
    return drops


def _draw_dirt(
    share: float, size: tuple[int, int], light: Light, rng: np.random.Generator
) -> tuple[Image, Image] | None:
    """What dirt lets through and what it adds: it is far out of focus, and lit from outside."""
    if share == 0:
        return None
    coarse = np.zeros((size[0] // 4, size[1] // 4), dtype=np.float32)
    for _ in range(int(rng.poisson(6 + 60 * share))):
        centre = (int(rng.integers(0, coarse.shape[1])), int(rng.integers(0, coarse.shape[0])))
        axes = (int(rng.uniform(2, 22)), int(rng.uniform(2, 14)))
        turn = float(rng.uniform(0, 180))
        blob = np.zeros_like(coarse)
        cv2.ellipse(blob, centre, axes, turn, 0, 360, (float(rng.uniform(0.2, 0.9)),), -1)
        coarse = np.maximum(coarse, cv2.GaussianBlur(blob, (0, 0), rng.uniform(1.5, 5)))
    film = cv2.GaussianBlur(rng.standard_normal(coarse.shape).astype(np.float32), (0, 0), 25)
    film = np.clip(film / max(float(film.std()), 1e-6) * 0.06 + 0.12, 0, 0.4)
    opaque = cv2.resize(np.clip(coarse * 0.75 + film, 0, 0.85) * min(1.0, 0.4 + share), size[::-1])
    level = 0.75 * (light.sun_strength * max(light.sun[2], 0.0) + light.ambient)
    tone = np.clip(np.array([70.0, 85.0, 95.0]) * level, 0, 255)
    keep = np.repeat(np.rint(255 * (1 - opaque))[..., None], 3, axis=2)
    return _as_image(keep), _as_image(np.rint(opaque[..., None] * tone))


def _glare(camera: PinholeCamera, light: Light) -> Image | None:
    """Veiling glare of the sun in or near the picture, and the sun itself."""
    sun = camera.rotation @ np.asarray(light.sun)
    if sun[2] < 0.25:
        return None
    place = sun[:2] / sun[2] * camera.focal_px + np.array([camera.width_px, camera.height_px]) / 2
    u = np.arange(0, camera.width_px, 4, dtype=np.float32)[None, :]
    v = np.arange(0, camera.height_px, 4, dtype=np.float32)[:, None]
    away = np.hypot(u - np.float32(place[0]), v - np.float32(place[1])) / camera.focal_px
    # Light scatters in the lens about as 1 / angle² (Vos 1984), with a core that saturates.
    level = 9.0 / (away + 0.16) ** 1.6 + 255 * np.exp(-((away / 0.05) ** 2))
    whole = cv2.resize(level.astype(np.float32), (camera.width_px, camera.height_px))
    tone = np.clip(np.asarray(light.tint, dtype=np.float32), 0.6, 1.1)
    return _as_image(np.clip(whole[..., None] * tone, 0, 255))
