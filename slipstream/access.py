"""Who may use a road, as a SUMO net has it: permissions by vehicle class, limits of height, width,
length and mass, and speed limits by class.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, get_args

from slipstream.vehicle_types import RoutingProfile, VehicleClass

log = logging.getLogger(__name__)

ALL_CLASSES: Final[frozenset[str]] = frozenset(get_args(VehicleClass))

_FOOT_M: Final = 0.3048
_INCH_M: Final = 0.0254
_POUND_KG: Final = 0.45359237
_SHORT_TON_KG: Final = 907.18474
_FEET = re.compile(r"(\d+(?:\.\d+)?)\s*(?:'|ft)\s*(?:(\d+(?:\.\d+)?)\s*(?:\"|in)?)?")
_NUMBER = re.compile(r"(\d+(?:[.,]\d+)?)\s*([a-zA-Z]*)")
_METRES: Final = {"": 1.0, "m": 1.0, "cm": 0.01}
_KILOGRAMS: Final = {
    "": 1000.0,
    "t": 1000.0,
    "kg": 1.0,
    "lbs": _POUND_KG,
    "lb": _POUND_KG,
    "st": _SHORT_TON_KG,
}
_NO_LIMIT: Final = frozenset({"", "none", "no", "default", "unsigned", "no_sign", "below_default"})
"""What OpenStreetMap has where no limit is signed."""


@dataclass(frozen=True)
class Access:
    """Who may use a segment.

    Attributes:
        classes: vehicle classes that may; None: all.
        max_height_m: None: no limit.
        max_width_m: likewise.
        max_length_m: likewise.
        max_mass_kg: likewise, of the permitted mass.
        class_speeds_mps: speed limits by class where they differ from the segment's.
    """

    classes: frozenset[str] | None = None
    max_height_m: float | None = None
    max_width_m: float | None = None
    max_length_m: float | None = None
    max_mass_kg: float | None = None
    class_speeds_mps: Mapping[str, float] = field(default_factory=dict)

    def admits(self, profile: RoutingProfile) -> bool:
        """Whether vehicles of a profile may use it; what is not known of them meets no limit."""
        if self.classes is not None and profile.vehicle_class not in self.classes:
            return False
        return all(
            limit is None or size is None or size <= limit
            for limit, size in (
                (self.max_height_m, profile.height_m),
                (self.max_width_m, profile.width_m),
                (self.max_length_m, profile.length_m),
                (self.max_mass_kg, profile.gross_mass_kg),
            )
        )

    def speed_limit_mps(self, limit_mps: float, profile: RoutingProfile) -> float:
        """The limit that holds for vehicles of a profile, where the segment's is ``limit_mps``."""
        return self.class_speeds_mps.get(profile.vehicle_class, limit_mps)


OPEN: Final = Access()
"""Everybody may use it."""


def access_of(edge: Any, type_speeds: Mapping[str, Mapping[str, float]]) -> Access:
    """Who may use an edge of sumolib's net.

    Dimensions and mass are those of OpenStreetMap, which netconvert takes over as parameters of the
    edge with ``--osm.extra-attributes maxheight,maxwidth,maxlength,maxweight``.

    Args:
        edge: of the net.
        type_speeds: speed limits by class of each edge type (``restriction`` in the net).
    """
    allowed = {vehicle_class for lane in edge.getLanes() for vehicle_class in lane.getPermissions()}
    classes = frozenset(ALL_CLASSES & allowed)
    limit_mps = float(edge.getSpeed())
    speeds: dict[str, float] = {}
    for vehicle_class in classes:
        lanes = [float(la.getSpeed()) for la in edge.getLanes() if la.allows(vehicle_class)]
        speed = type_speeds.get(edge.getType(), {}).get(vehicle_class, max(lanes))
        if speed != limit_mps and speed > 0:
            speeds[vehicle_class] = speed
    where = f"edge {edge.getID()!r}"
    return Access(
        None if classes == ALL_CLASSES else classes,
        _length_m(edge.getParam("maxheight"), where),
        _length_m(edge.getParam("maxwidth"), where),
        _length_m(edge.getParam("maxlength"), where),
        _least(
            _mass_kg(edge.getParam("maxweight"), where),
            _mass_kg(edge.getParam("maxweightrating"), where),
        ),
        speeds,
    )


def classes_of_turn(connections: Any) -> frozenset[str] | None:
    """Vehicle classes that may take a turn by one of its connections (sumolib's); None: all."""
    allowed: set[str] = set()
    for connection in connections:
        from_lane, to_lane = connection.getFromLane(), connection.getToLane()
        allowed |= {
            c
            for c in ALL_CLASSES
            if connection.allows(c) and from_lane.allows(c) and to_lane.allows(c)
        }
    return None if allowed == ALL_CLASSES else frozenset(allowed)


def _least(*limits: float | None) -> float | None:
    return min((limit for limit in limits if limit is not None), default=None)


def _length_m(text: str | None, where: str) -> float | None:
    """A length of OpenStreetMap: metres, or feet and inches; None: no limit."""
    if text is None or text.strip().lower() in _NO_LIMIT:
        return None
    feet = _FEET.fullmatch(text.strip())
    if feet is not None:
        return float(feet[1]) * _FOOT_M + float(feet[2] or 0.0) * _INCH_M
    return _with_unit(text, _METRES, where)


def _mass_kg(text: str | None, where: str) -> float | None:
    """A mass of OpenStreetMap: tonnes unless it says otherwise; None: no limit."""
    if text is None or text.strip().lower() in _NO_LIMIT:
        return None
    return _with_unit(text, _KILOGRAMS, where)


def _with_unit(text: str, units: Mapping[str, float], where: str) -> float | None:
    found = _NUMBER.fullmatch(text.strip())
    unit = None if found is None else units.get(found[2].lower())
    if found is None or unit is None:
        log.warning("%s: its limit %r is not understood and does not count", where, text[:40])
        return None
    return float(found[1].replace(",", ".")) * unit
