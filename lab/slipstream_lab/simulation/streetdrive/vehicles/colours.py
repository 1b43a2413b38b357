"""Colours of glass, lamps and plates that all vehicle shapes share."""

from __future__ import annotations

from slipstream_lab.simulation.streetdrive.rendering import Colour

GLASS: Colour = (46.0, 42.0, 38.0)
DARK: Colour = (30.0, 30.0, 30.0)
HEADLAMP: Colour = (235.0, 240.0, 245.0)
TAIL: Colour = (35.0, 25.0, 190.0)
PLATE: Colour = (215.0, 220.0, 225.0)
