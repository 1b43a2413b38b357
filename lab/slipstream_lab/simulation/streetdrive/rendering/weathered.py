"""The road plane under rain, snow, street lamps and a low sun, pixel by pixel."""

from __future__ import annotations

import cv2
import numpy as np

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.ground import Grid, GroundView, blend, noise
from slipstream_lab.simulation.streetdrive.rendering.light import Light
from slipstream_lab.simulation.streetdrive.traffic import Road


def on_carriageway(view: GroundView, road: Road) -> Grid:
    """1 where a pixel shows the carriageway, else 0."""
    inside = (view.y > road.right_edge_m) & (view.y < road.left_edge_m)
    return np.asarray(inside, dtype=np.float32)


def wet(image: Grid, view: GroundView, road: Road, wetness: float) -> Grid:
    """Water in the pores darkens surfaces, asphalt most."""
    image *= (1 - wetness * (0.12 + 0.28 * on_carriageway(view, road)))[..., None]
    return image


def snowed(image: Grid, view: GroundView, road: Road, cover: float) -> Grid:
    """Snow on verges and pavements, and on the carriageway but for the wheels' tracks. `cover`:
    share of the carriageway that is covered, 0..1.
    """
    tracks = np.ones_like(view.y)
    for lane in road.lanes:
        for wheel in (-0.8, 0.8):
            away = np.abs(view.y - np.float32(lane.y_m + wheel))
            tracks = np.minimum(tracks, np.clip((away - 0.2) * 3, 0.05, 1.0))
    swell = noise(view.tile, view.x, view.y, 14.0, 3.0) * 0.12
    thick = np.clip(tracks * (0.35 + cover) + swell + 0.06 * view.fine + cover - 0.75, 0, 0.95)
    inside = on_carriageway(view, road)
    amount = np.asarray(inside * thick + (1 - inside) * np.clip(0.85 + 0.2 * swell, 0, 0.97))
    tone = np.full(image.shape, (236.0, 228.0, 222.0), dtype=np.float32)
    tone *= (0.92 + 0.03 * view.fine + 0.03 * view.rough)[..., None]
    return blend(image, tone, amount.astype(np.float32))


def sky_mirror(
    image: Grid, view: GroundView, camera: PinholeCamera, light: Light, road: Road, wetness: float
) -> Grid:
    """The sky in a wet road: Schlick's reflectance of water by angle, more in puddles."""
    cosine = np.clip(camera.height_m / np.maximum(view.reach, 1e-3), 0, 1)
    fresnel = 0.02 + 0.98 * (1 - cosine) ** 5
    puddles = np.clip(0.55 + 0.3 * noise(view.tile, view.x * 0.8 + 31, view.y, 16.0, 2.5), 0.15, 1)
    share = wetness * 0.8 * fresnel * puddles * (0.1 + 0.9 * on_carriageway(view, road))
    share = np.asarray(share * view.hits, dtype=np.float32)
    return blend(image, light.sky_horizon, share)


def sun_mirror(
    image: Grid, view: GroundView, camera: PinholeCamera, light: Light, road: Road
) -> Grid:
    """The glitter of a low sun on worn asphalt towards the camera (Phong's lobe); in place."""
    sun = light.sun
    ray_x = view.x / view.reach
    ray_y = (view.y - camera.lateral_m) / view.reach
    ray_z = camera.height_m / view.reach
    lobe = np.clip(ray_x * sun[0] + ray_y * sun[1] + ray_z * sun[2], 0, 1) ** 14
    gain = lobe * 180 * light.sun_strength * sun[2] * (0.15 + 0.85 * on_carriageway(view, road))
    gain = np.asarray(gain * view.hits, dtype=np.float32)
    image += gain[..., None] * np.asarray(light.tint, dtype=np.float32)
    return image


def lamp_field(view: GroundView, light: Light) -> Grid:
    """The street lamps' light on each pixel's ground (h, w), computed at a quarter of the width."""
    level = light.lamp_level(view.x[::4, ::4], view.y[::4, ::4]).astype(np.float32)
    whole = cv2.resize(level, (view.x.shape[1], view.x.shape[0]))
    return np.asarray(whole * view.hits, dtype=np.float32)
