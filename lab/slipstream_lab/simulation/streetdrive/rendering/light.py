"""Sun, sky and haze of a scene, and the colour that a lit surface shows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
FloatArray = NDArray[np.floating]
Colour = tuple[float, float, float]
"""Blue, green, red, each 0..255."""

LAMP_HEIGHT_M = 9.3


@dataclass(frozen=True)
class Light:
    """One moment's light; `sun` is the unit vector towards the sun in world axes."""

    sun: Colour
    sun_strength: float
    ambient: float
    tint: Colour
    sky_zenith: Colour
    sky_horizon: Colour
    haze_m: float
    clouds: float
    fog_m: float = math.inf
    """Distance over which fog, rain or snow leave 1/e of the light, besides the haze."""
    lamps: tuple[tuple[float, float], ...] = ()
    """Street lamps' places on the road plane, metres."""
    lamp_colour: Colour = (0.0, 0.0, 0.0)
    """Illumination factor (BGR) under a lamp."""

    @property
    def shadow_strength(self) -> float:
        """Share of the light on level ground that a cast shadow takes away, 0..1."""
        direct = self.sun_strength * max(self.sun[2], 0.0)
        return direct / (direct + self.ambient)

    def exposed(self, level: float) -> Light:
        """The same light, exposed so that level ground in the open has this illumination factor."""
        factor = level / (self.sun_strength * max(self.sun[2], 0.0) + self.ambient)
        return replace(self, sun_strength=self.sun_strength * factor, ambient=self.ambient * factor)

    def lambert(self, normals: Floats) -> Floats:
        """Illumination factor (n, 3) in BGR for unit normals (n, 3), Lambert's law plus sky light.

        Level ground in the open has a factor near 1.
        """
        direct = self.sun_strength * np.clip(normals @ np.asarray(self.sun), 0.0, None)
        diffuse = self.ambient * (0.72 + 0.28 * normals[:, 2])
        warm = np.asarray(self.tint)
        return np.asarray(direct[:, None] * warm + diffuse[:, None] * np.sqrt(2.0 - warm))

    def lamp_level(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Illuminance by street lamps on level ground at (x, y), 1 under a single lamp.

        A Lambertian lamp that looks down gives (h² / (h² + r²))² at a distance r from its foot.
        """
        level = np.zeros(np.shape(x_m))
        h2 = LAMP_HEIGHT_M**2
        for x, y in self.lamps:
            level += (h2 / (h2 + (x_m - x) ** 2 + (y_m - y) ** 2)) ** 2
        return np.asarray(level)

    def lamplight(self, normals: Floats, x_m: float, y_m: float) -> Floats:
        """Illumination factor (n, 3) by street lamps of faces near a road point."""
        if not self.lamps:
            return np.zeros((1, 3))
        level = float(self.lamp_level(np.array(x_m), np.array(y_m)))
        # Lamps before and behind a face light its sides at a third of what comes from above.
        share = 0.35 + 0.65 * np.clip(normals[:, 2], 0.0, 1.0)
        return np.asarray(level * share[:, None] * np.asarray(self.lamp_colour))

    def clearness(self, distance_m: FloatArray) -> FloatArray:
        """Share of the light that comes through haze and fog over distances (...)."""
        clear = np.exp(-distance_m / self.haze_m)
        if not math.isinf(self.fog_m):
            clear = clear * np.exp(-distance_m / self.fog_m)
        return np.asarray(clear)

    def through_haze(self, colours: Floats, distance_m: Floats) -> Floats:
        """Colours (n, 3) seen through the haze over distances (n,)."""
        clear = self.clearness(distance_m)[:, None]
        return np.asarray(colours * clear + np.asarray(self.sky_horizon) * (1.0 - clear))


def draw_light(rng: np.random.Generator) -> Light:
    """A random hour and weather: low or high sun, clear to overcast."""
    elevation = math.radians(rng.uniform(18.0, 65.0))
    azimuth = rng.uniform(0.0, 2 * math.pi)
    overcast = float(rng.random() ** 1.6)
    low = 1.0 - (math.degrees(elevation) - 18.0) / 47.0
    sun = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    exposure = rng.uniform(0.85, 1.12)
    direct = (1.0 - 0.93 * overcast) * rng.uniform(0.85, 1.05) * exposure
    ambient = (0.46 + 0.56 * overcast) * rng.uniform(0.9, 1.1) * exposure
    warmth = low * (1 - overcast) * rng.uniform(0.3, 1.0)
    grey = rng.uniform(190, 225)
    blend = min(1.0, overcast * 1.2)

    def mix(clear: Colour, cloudy: float) -> Colour:
        b, g, r = (c * (1 - blend) + cloudy * blend for c in clear)
        return (b, g, r)

    return Light(
        sun=sun,
        sun_strength=float(direct),
        ambient=float(ambient),
        tint=(1.0 - 0.22 * warmth, 1.0 - 0.05 * warmth, 1.0 + 0.08 * warmth),
        sky_zenith=mix((200.0, 145.0, 85.0), float(grey * 0.85)),
        sky_horizon=mix((228.0, 212.0, 190.0 + 30 * warmth), float(grey)),
        haze_m=float(rng.uniform(500, 2500) * (1.2 - 0.6 * overcast)),
        clouds=float(rng.uniform(0.2, 1.0)),
    )
