"""Who may use a road, as a SUMO net has it: permissions by vehicle class, limits of height, width,
length and mass, and speed limits by class.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, get_args

from slipstream.vehicle_types import RoutingProfile, VehicleClass

log = logging.getLogger(__name__)

ALL_CLASSES: Final[frozenset[str]] = frozenset(get_args(VehicleClass))

_FOOT_M: Final = 0.3048
_INCH_M: Final = 0.0254
_POUND_KG: Final = 0.45359237
_SHORT_TON_KG: Final = 907.18474
_NUMBER: Final = r"\d+(?:[.,]\d+)?"
_FEET: Final = re.compile(
    rf"({_NUMBER})\s*(?:['′’](?!['′’])|ft\b\.?|feet\b)"
    rf"(?:\s*({_NUMBER})\s*(?:[\"″”]|''|in\b|inch\b|inches\b)|({_NUMBER})(?![\d.,'′’]))?",
    re.IGNORECASE,
)
_INCHES: Final = re.compile(rf"({_NUMBER})\s*(?:[\"″”]|''|in\b|inch\b|inches\b)", re.IGNORECASE)
_VALUE: Final = re.compile(rf"({_NUMBER})(?:\s*([a-z]+)\b\.?)?", re.IGNORECASE)
_THOUSANDS: Final = re.compile(r"\d{1,3},\d{3}")
_BETWEEN: Final = re.compile(r"[\s;|/,]+")
_METRES: Final = {"": 1.0, "m": 1.0, "metres": 1.0, "meters": 1.0, "cm": 0.01}
_KILOGRAMS: Final = {
    **dict.fromkeys(("", "t", "tonne", "tonnes"), 1000.0),
    "kg": 1.0,
    **dict.fromkeys(("lbs", "lb", "pounds"), _POUND_KG),
    **dict.fromkeys(("st", "ton", "tons"), _SHORT_TON_KG),
}
_WHOLE: Final = frozenset({"kg", "lbs", "lb", "pounds"})
"""Units whose numbers have a comma before the thousands, not before decimals."""
_NO_LIMIT: Final = re.compile(
    r"(?:none|no|no_sign|default|below_default|unsigned|unlimited|implicit)\b", re.IGNORECASE
)
"""What OpenStreetMap has where no limit is signed."""
_AXLE_SHARE: Final = 0.7
"""Of a vehicle's permitted mass, taken to be the most on one axle: an assumption about vans and
lorries of two axles, whose axle loads a fleet does not tell."""
_HIGHEST_AXLE_KG: Final = 11_500.0
"""Permitted on a driven axle in the European Union (96/53/EC): a higher limit is none."""
_STRICTEST: Final = {"maxheight": 2.0, "maxwidth": 2.0, "maxlength": 5.0, "maxweight": 2500.0}
"""m and kg: what a limit that cannot be read counts as. Signs are rarely lower, so that a vehicle
that might be above it is kept off."""


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


def access_of(
    edge: Any, type_speeds: Mapping[str, Mapping[str, float]], unread: list[str]
) -> Access:
    """Who may use an edge of sumolib's net.

    Dimensions and mass are those of OpenStreetMap, which netconvert takes over as parameters of the
    edge with ``--osm.extra-attributes`` and their keys. Of several values, as an edge has that is
    made of several ways, the smallest holds.

    Args:
        type_speeds: speed limits by class of each edge type (``restriction`` in the net).
        unread: gets a line for each limit that cannot be read.
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

    def limit(key: str, units: Mapping[str, float], strictest: float) -> float | None:
        text = str(edge.getParam(key) or "")
        try:
            return smallest(text, units)
        except ValueError:
            unread.append(f"edge {edge.getID()!r}: {key} {text[:40]!r}")
            return strictest

    lengths = {
        key: limit(key, _METRES, _STRICTEST[key]) for key in ("maxheight", "maxwidth", "maxlength")
    }
    strictest_kg = _STRICTEST["maxweight"]
    axle_kg = limit("maxaxleload", _KILOGRAMS, _AXLE_SHARE * strictest_kg)
    masses = [
        *(limit(key, _KILOGRAMS, strictest_kg) for key in ("maxweight", "maxweightrating")),
        None if axle_kg is None or axle_kg >= _HIGHEST_AXLE_KG else axle_kg / _AXLE_SHARE,
    ]
    return Access(
        None if classes == ALL_CLASSES else classes,
        lengths["maxheight"],
        lengths["maxwidth"],
        lengths["maxlength"],
        min((mass for mass in masses if mass is not None), default=None),
        speeds,
    )


def warn_of_unread(source: str, unread: Sequence[str]) -> None:
    """Say in one line how many limits of a net cannot be read, and what they count as."""
    if unread:
        told = ", ".join(f"{key} {value:g}" for key, value in _STRICTEST.items())
        log.warning(
            "%s: %d limits cannot be read and count as the strictest (%s; m and kg), first %s",
            *(source, len(unread), told, unread[0]),
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


def smallest(text: str, units: Mapping[str, float]) -> float | None:
    """The smallest value in a limit of OpenStreetMap; None: no limit.

    Args:
        text: one or more values with or without units, such as "3.5 t", "14 25", "12'6\"", "none".
        units: factors by unit; where these are of length, feet and inches are read too.

    Raises:
        ValueError: something in it is no value.
    """
    found: list[float] = []
    text, at = text.strip(), 0
    while at < len(text):
        value, at = _value_at(text, at, units)
        found += [] if value is None else [value]
        gap = _BETWEEN.match(text, at)
        if gap is None and at < len(text):
            raise ValueError(f"{text[at:]!r} is no value")
        at = len(text) if gap is None else gap.end()
    return min(found, default=None)


def _value_at(text: str, at: int, units: Mapping[str, float]) -> tuple[float | None, int]:
    """(a value, None where it is no limit; where it ends)."""
    if free := _NO_LIMIT.match(text, at):
        return None, free.end()
    if units is _METRES:
        if feet := _FEET.match(text, at):
            inches = _number(feet[2] or feet[3] or "0")
            return _number(feet[1]) * _FOOT_M + inches * _INCH_M, feet.end()
        if alone := _INCHES.match(text, at):
            return _number(alone[1]) * _INCH_M, alone.end()
    found = _VALUE.match(text, at)
    unit = "" if found is None else str(found[2] or "").lower()
    if found is None or unit not in units:
        raise ValueError(f"{text[at:]!r} is no value")
    number = found[1]
    if unit in _WHOLE and _THOUSANDS.fullmatch(number):
        number = number.replace(",", "")
    return _number(number) * units[unit], found.end()


def _number(text: str) -> float:
    return float(text.replace(",", "."))
