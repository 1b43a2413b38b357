"""Projections lead both ways."""

from __future__ import annotations

import pytest

from slipstream.roads.projection import Projection

TROY = Projection(
    "+proj=utm +zone=18 +ellps=WGS84 +datum=WGS84 +units=m +no_defs", (-605160.10, -4727192.42)
)


def test_a_place_has_one_latitude_and_longitude() -> None:
    """There and back to a centimetre."""
    places = [(0.0, 0.0), (2040.5, -310.25), (-500.0, 4300.0)]
    degrees = TROY.degrees(places)
    assert degrees[0] == pytest.approx((42.6900, -73.7162), abs=1e-4)
    for place, point in zip(places, degrees, strict=True):
        assert TROY.place_m(*point) == pytest.approx(place, abs=0.01)


def test_a_place_off_the_earth_is_none() -> None:
    """It is named, and no infinite latitude is given."""
    with pytest.raises(ValueError, match=r"no latitude and longitude at \(1e\+12, 0\) m"):
        TROY.degrees([(0.0, 0.0), (1e12, 0.0)])
