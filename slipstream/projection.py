"""From latitude and longitude to a network's places, by the projection that its SUMO net names."""

from __future__ import annotations

import math
from dataclasses import dataclass
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
        # Imported here: only networks from maps have a projection.
        import pyproj

        try:
            x, y = pyproj.Proj(self.parameter)(longitude, latitude)
        except pyproj.exceptions.ProjError as error:
            raise ValueError(f"not a projection: {self.parameter!r}") from error
        place = float(x) + self.offset_m[0], float(y) + self.offset_m[1]
        if not all(map(math.isfinite, place)):
            raise ValueError(f"no place at latitude {latitude:g}, longitude {longitude:g}")
        return place


def projection_of(net: Any) -> Projection | None:
    """The projection of sumolib's net; None: it has none."""
    location = net.__dict__.get("_location") or {}
    parameter = str(location.get("projParameter", "!"))
    if parameter in _NONE:
        return None
    x, y = (float(part) for part in str(location["netOffset"]).split(","))
    return Projection(parameter, (x, y))
