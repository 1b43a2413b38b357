"""A still scene with a camera: paints vehicles into it and measures them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.conditions import CLEAR, Conditions
from slipstream_lab.simulation.streetdrive.rendering.ground import (
    Palette,
    lit,
    paint_ground,
    shade_sky,
    view_ground,
)
from slipstream_lab.simulation.streetdrive.rendering.lamps import (
    at_night,
    light_road,
    paint_lamps,
    street_lit,
)
from slipstream_lab.simulation.streetdrive.rendering.light import Light
from slipstream_lab.simulation.streetdrive.rendering.mesh import Colour, Floats
from slipstream_lab.simulation.streetdrive.rendering.moving import paint_mirrored, paint_moving
from slipstream_lab.simulation.streetdrive.rendering.painter import (
    Image,
    PlacedMesh,
    Seen,
    fill,
    measure,
    paint_shadow,
    paint_vehicle,
)
from slipstream_lab.simulation.streetdrive.rendering.scenery import (
    Density,
    paint_scenery,
    paint_tree_shadows,
)
from slipstream_lab.simulation.streetdrive.rendering.weathered import (
    sky_mirror,
    snowed,
    sun_mirror,
    wet,
)
from slipstream_lab.simulation.streetdrive.traffic import Road


@dataclass(frozen=True)
class Occluder:
    """A polygon in pixels (n, 2) that stands in front of everything, such as a sign post."""

    pixels: Floats
    colour: Colour


class Backdrop:
    """A painted picture without vehicles, on which vehicles move.

    `even` is the same picture in even light of factor 1, which vehicles' beams light at night.
    """

    def __init__(
        self,
        camera: PinholeCamera,
        light: Light,
        background: Image,
        occluders: Sequence[Occluder] = (),
        *,
        conditions: Conditions = CLEAR,
        even: Image | None = None,
    ) -> None:
        self.camera = camera
        self.light = light
        self._background = background
        self._covers = tuple(occluders)
        self.conditions = conditions
        self._even = even

    def render(self, vehicles: Sequence[PlacedMesh]) -> tuple[Image, list[Seen | None]]:
        """The picture (h, w, 3) BGR and what is seen of each vehicle, in the order given."""
        position = self.camera.position_m
        order = sorted(
            range(len(vehicles)),
            key=lambda i: (
                -float(np.hypot(vehicles[i].x_m - position[0], vehicles[i].y_m - position[1]))
            ),
        )
        sorted_vehicles = [vehicles[i] for i in order]
        sorted_seen = measure(self.camera, sorted_vehicles, [c.pixels for c in self._covers])
        image = self._background.copy()
        shown = [v for v, s in zip(sorted_vehicles, sorted_seen, strict=True) if s is not None]
        for vehicle in shown:
            paint_shadow(image, self.camera, self.light, vehicle)
        if self._even is not None:
            driven = [vehicle for vehicle in shown if vehicle.mesh.has_lamps]
            light_road(image, self._even, self.camera, driven)
        for vehicle in shown:
            self._paint(image, vehicle)
        for cover in self._covers:
            fill(image, cover.pixels, cover.colour)
        seen: list[Seen | None] = [None] * len(vehicles)
        for i, what in zip(order, sorted_seen, strict=True):
            seen[i] = what
        return image, seen

    def _paint(self, image: Image, vehicle: PlacedMesh) -> None:
        given = self.conditions
        if given.exposure_s > 0 and vehicle.speed_mps > 0:
            paint_moving(image, self.camera, self.light, vehicle, given.exposure_s)
        else:
            paint_vehicle(image, self.camera, self.light, vehicle)
        if given.wetness > 0:
            paint_mirrored(image, self.camera, vehicle, 0.3 * given.wetness)
        if given.lamps_on:
            paint_lamps(image, self.camera, vehicle, given)


class Stage(Backdrop):
    """The straight road's background, painted once.

    `weather` draws what the conditions leave open; without it they are a dry, clear day's.
    """

    def __init__(
        self,
        camera: PinholeCamera,
        road: Road,
        light: Light,
        palette: Palette,
        rng: np.random.Generator,
        *,
        density: Density | None = None,
        tree_shadows: int = 3,
        occluders: Sequence[Occluder] = (),
        conditions: Conditions = CLEAR,
        weather: np.random.Generator | None = None,
    ) -> None:
        self.road = road
        drawn = weather or np.random.default_rng(0)
        if conditions != CLEAR:
            light = conditions.light(light, drawn)
        night = conditions.night
        # At night all is painted in even light first, and lit by lamps then.
        day = light if not night else replace(light, ambient=1.0, sky_zenith=(90.0,) * 3)
        sky = shade_sky(camera, light, rng)
        view = view_ground(camera, rng)
        surface = paint_ground(view, road, palette)
        if conditions.snow_mm_h > 0:
            b, g, r = (0.6 * c + 90 for c in palette.foliage)
            palette = replace(palette, foliage=(b, g, r))
            surface = snowed(surface, view, road, float(drawn.uniform(0.1, 0.9)))
        wetness = conditions.wetness
        if wetness > 0:
            surface = wet(surface, view, road, wetness)
        ground = lit(surface, view, day)
        if wetness > 0 and not night:
            ground = sky_mirror(ground, view, camera, light, road, wetness)
        if conditions.low_sun:
            ground = sun_mirror(ground, view, camera, light, road)
        if light.shadow_strength > 0.15:
            paint_tree_shadows(ground, camera, light, road, rng, tree_shadows)
        picture = np.where(view.hits[..., None], ground, sky)
        background: Image = np.clip(picture, 0, 255).astype(np.uint8)
        things = paint_scenery(background, camera, day, road, palette, rng, density or Density())
        even = None
        if night:
            even = background
            light = street_lit(light, [(x, y) for x, kind, y in things if kind == "lamp"], drawn)
            background = at_night(background, view, camera, light, wetness, drawn)
        super().__init__(camera, light, background, occluders, conditions=conditions, even=even)
