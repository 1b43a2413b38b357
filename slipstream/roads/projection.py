"""Between latitude and longitude and a network's places, by the projection of its SUMO net."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

_NONE: Final = ("", "!", "-")
"""What a SUMO net has instead of a projection."""


@dataclass(frozen=True)
class Projection:
    """A map projection.

    Attributes:
        parameter: as PROJ takes it.
        offset_m: added to what it gives.
    """

    parameter: str
    offset_m: tuple[float, float]

    def place_m(self, latitude: float, longitude: float) -> tuple[float, float]:
        """Place in the network of a point in degrees (WGS 84), m.

        Raises:
            ValueError: the projection has no such point, or is none.
        """
        x, y = _proj(self.parameter)(longitude, latitude)
        place = float(x) + self.offset_m[0], float(y) + self.offset_m[1]
        if not all(map(math.isfinite, place)):
            raise ValueError(f"no place at latitude {latitude:g}, longitude {longitude:g}")
        return place

    def degrees(self, places_m: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
        """Latitude and longitude (WGS 84) of places in the network.

        Args:
            places_m: at least one.

        Raises:
            ValueError: one of them is nowhere on the earth, or the projection is none.
        """
        x, y = zip(*places_m, strict=True)
        dx, dy = self.offset_m
        found = _proj(self.parameter)([v - dx for v in x], [v - dy for v in y], inverse=True)
        points = tuple(
            (float(latitude), float(longitude)) for longitude, latitude in zip(*found, strict=True)
        )
        for (latitude, longitude), place in zip(points, places_m, strict=True):
            if not (abs(latitude) <= 90 and abs(longitude) <= 180):
                raise ValueError(f"no latitude and longitude at ({place[0]:g}, {place[1]:g}) m")
        return points


@lru_cache
def _proj(parameter: str) -> Any:
    # Imported here: only networks from maps have a projection.
    import pyproj

    try:
        return pyproj.Proj(parameter)
    except pyproj.exceptions.ProjError as error:
        raise ValueError(f"not a projection: {parameter!r}") from error


def projection_of(net: Any) -> Projection | None:
    """The projection of sumolib's net; None: it has none."""
    location = net.__dict__.get("_location") or {}
    parameter = str(location.get("projParameter", "!"))
    if parameter in _NONE:
        return None
    x, y = (float(part) for part in str(location["netOffset"]).split(","))
    return Projection(parameter, (x, y))
