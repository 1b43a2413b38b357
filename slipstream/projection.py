"""Latitude and longitude of a network's places, by the projection that its SUMO net names."""

from __future__ import annotations

import math
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

    def degrees(self, place_m: tuple[float, float]) -> tuple[float, float]:
        """(latitude, longitude) of a place in the network, degrees (WGS 84)."""
        x, y = place_m[0] - self.offset_m[0], place_m[1] - self.offset_m[1]
        longitude, latitude = _proj(self.parameter)(x, y, inverse=True)
        return float(latitude), float(longitude)


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
