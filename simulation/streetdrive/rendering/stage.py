"""A still scene with a camera: paints vehicles into it and measures them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simulation.streetdrive.rendering.camera import Camera
from simulation.streetdrive.rendering.ground import Palette, shade_ground, shade_sky
from simulation.streetdrive.rendering.light import Light
from simulation.streetdrive.rendering.mesh import Colour, Floats
from simulation.streetdrive.rendering.painter import (
    Image,
    Placed,
    Seen,
    fill,
    measure,
    paint_shadow,
    paint_vehicle,
)
from simulation.streetdrive.rendering.scenery import Density, paint_scenery, paint_tree_shadows
from simulation.streetdrive.traffic import Road


@dataclass(frozen=True)
class Occluder:
    """A polygon in pixels (n, 2) that stands in front of everything, such as a sign post."""

    pixels: Floats
    colour: Colour


class Backdrop:
    """A painted picture without vehicles, on which vehicles move."""

    def __init__(
        self, camera: Camera, light: Light, background: Image, occluders: Sequence[Occluder] = ()
    ) -> None:
        self.camera = camera
        self.light = light
        self._background = background
        self._covers = tuple(occluders)

    def render(self, vehicles: Sequence[Placed]) -> tuple[Image, list[Seen | None]]:
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
        for vehicle in shown:
            paint_vehicle(image, self.camera, self.light, vehicle)
        for cover in self._covers:
            fill(image, cover.pixels, cover.colour)
        seen: list[Seen | None] = [None] * len(vehicles)
        for i, what in zip(order, sorted_seen, strict=True):
            seen[i] = what
        return image, seen


class Stage(Backdrop):
    """The straight road's background, painted once."""

    def __init__(
        self,
        camera: Camera,
        road: Road,
        light: Light,
        palette: Palette,
        rng: np.random.Generator,
        *,
        density: Density | None = None,
        tree_shadows: int = 3,
        occluders: Sequence[Occluder] = (),
    ) -> None:
        self.road = road
        sky = shade_sky(camera, light, rng)
        ground, hits = shade_ground(camera, road, palette, light, rng)
        if light.shadow_strength > 0.15:
            paint_tree_shadows(ground, camera, light, road, rng, tree_shadows)
        picture = np.where(hits[..., None], ground, sky)
        background: Image = np.clip(picture, 0, 255).astype(np.uint8)
        paint_scenery(background, camera, light, road, palette, rng, density or Density())
        super().__init__(camera, light, background, occluders)
