"""Weather, hour and the camera's state of a scene, and the light that they leave."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from slipstream.errors import InputError
from slipstream_lab.simulation.streetdrive.rendering.light import Light

_KOSCHMIEDER = 3.912
"""Optical depth at the visibility range: contrast 2 % (Koschmieder 1924)."""


@dataclass(frozen=True)
class Conditions:
    """What differs from a dry, clear day and a clean camera.

    Args:
        low_sun: the sun 4 to 11 degrees high in a clear sky.
        snow_mm_h: rate of snowfall as water; any snow also lies on the ground.
        visibility_m: distance at which fog leaves 2 % of contrast.
        jpeg_quality: 1..100; below 100 frames are coded so, and blocks that hardly change repeat.
        exposure_s: time over which a frame gathers light; vehicles blur along their way.

    Raises:
        InputError: a value is out of range, or night and low sun are both asked for.
    """

    night: bool = False
    low_sun: bool = False
    rain_mm_h: float = 0.0
    snow_mm_h: float = 0.0
    visibility_m: float = math.inf
    dirt: float = 0.0
    jpeg_quality: int = 100
    exposure_s: float = 0.0

    def __post_init__(self) -> None:
        if self.night and self.low_sun:
            raise InputError(
                "clip settings", "night and a low sun at once", "give one", key="low_sun"
            )
        for key, low, high in (
            ("rain_mm_h", 0, 150),
            ("snow_mm_h", 0, 20),
            ("visibility_m", 20, math.inf),
            ("dirt", 0, 1),
            ("jpeg_quality", 1, 100),
            ("exposure_s", 0, 0.1),
        ):
            value = getattr(self, key)
            if not low <= value <= high:
                mend = f"give {low} to {high}" if high < math.inf else f"give {low} or more"
                raise InputError("clip settings", f"{value} is out of range", mend, key=key)

    @property
    def extinction_per_m(self) -> float:
        """Extinction by fog, rain and snow, 1/m.

        Fog by Koschmieder's law; rain 0.365 R^0.63 per km (Atlas 1953, in natural units); snow of
        1 mm/h leaves a visibility of 1 km (Rasmussen et al. 1999).
        """
        fog = _KOSCHMIEDER / self.visibility_m
        rain = 0.365e-3 * float(self.rain_mm_h**0.63)
        return fog + rain + _KOSCHMIEDER * self.snow_mm_h / 1000

    @property
    def wetness(self) -> float:
        """How wet the road is, 0..1."""
        return 1.0 - math.exp(-self.rain_mm_h / 2)

    @property
    def lamps_on(self) -> bool:
        """Whether vehicles drive with their lamps on."""
        return self.night or self.rain_mm_h > 2 or self.snow_mm_h > 0.5 or self.visibility_m < 500

    def light(self, drawn: Light, rng: np.random.Generator) -> Light:
        """The light that these conditions leave of a drawn one."""
        extinction = self.extinction_per_m
        light = drawn
        if self.low_sun:
            light = _low_sun(light, rng)
        if extinction > 0:
            light = _overcast(light, math.exp(-extinction * 400), rng)
            light = replace(light, fog_m=1 / extinction)
        return _night(light, rng) if self.night else light


CLEAR = Conditions()


def _low_sun(light: Light, rng: np.random.Generator) -> Light:
    elevation = math.radians(rng.uniform(4.0, 11.0))
    azimuth = math.atan2(light.sun[1], light.sun[0])
    level, share = rng.uniform(0.75, 1.1), rng.uniform(0.45, 0.65)
    flat = math.cos(elevation)
    warmth = rng.uniform(0.5, 1.3)
    return replace(
        light,
        sun=(flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)),
        sun_strength=level * share / math.sin(elevation),
        ambient=level * (1 - share),
        tint=(1 - 0.3 * warmth, 1 - 0.09 * warmth, 1 + 0.1 * warmth),
        sky_horizon=(190.0 - 40 * warmth, 205.0, 235.0),
        sky_zenith=(205.0, 165.0, 120.0),
        clouds=0.2,
        haze_m=float(rng.uniform(500, 1500)),
    )


def _overcast(light: Light, clear: float, rng: np.random.Generator) -> Light:
    """Grey sky; `clear` is the share of the direct light that is left."""
    grey = float(rng.uniform(165, 215))
    level = light.sun_strength * light.sun[2] + light.ambient
    share = 0.08 * clear
    return replace(
        light,
        sun_strength=level * share / max(light.sun[2], 0.1),
        ambient=level * (1 - share),
        tint=(1.0, 1.0, 1.0),
        sky_zenith=(grey * 0.92, grey * 0.9, grey * 0.88),
        sky_horizon=(grey, grey * 0.99, grey * 0.97),
        clouds=0.0,
    )


def _night(light: Light, rng: np.random.Generator) -> Light:
    sky = float(rng.uniform(8, 40))
    return replace(
        light,
        sun_strength=0.0,
        ambient=float(rng.uniform(0.08, 0.22)),
        tint=(0.9, 1.0, 1.05),
        sky_zenith=(sky * 0.7, sky * 0.6, sky * 0.6),
        sky_horizon=(sky, sky, sky * 1.15),
        clouds=0.0,
    )
