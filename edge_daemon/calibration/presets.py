"""Lane marks by national rules, whose period fixes lengths; sources are in docs/calibration.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class LaneMarks:
    """The marks between lanes of one kind of road; the period is from the beginning of one dash to
    that of the next, the lane's width from middle to middle of its lines.
    """

    name: str
    dash_m: float
    period_m: float
    lane_width_m: float


LANE_MARKS: Final = (
    LaneMarks("Germany, Autobahn", 6.0, 18.0, 3.75),
    LaneMarks("Germany, outside towns", 4.0, 12.0, 3.5),
    LaneMarks("Germany, in towns", 3.0, 9.0, 3.25),
    LaneMarks("United Kingdom, over 40 mph", 2.0, 9.0, 3.65),
    LaneMarks("United Kingdom, up to 40 mph", 1.0, 6.0, 3.65),
    LaneMarks("France, T1", 3.0, 13.0, 3.5),
    LaneMarks("United States", 3.05, 12.19, 3.66),
    LaneMarks("Czechia, motorway", 6.0, 18.0, 3.75),
    LaneMarks("Netherlands, motorway", 3.0, 12.0, 3.5),
)
