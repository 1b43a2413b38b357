"""A stored cycle in words, for people and with the figures for programs."""

from __future__ import annotations

from slipstream.explain.explanation import Explanation, as_text, explanation
from slipstream.explain.facts import (
    CycleFacts,
    InsertedStop,
    OfferedTour,
    RefusalReason,
    RefusedPlatoon,
    TourObstacle,
    VehicleAccount,
    facts_data,
    facts_of,
)
from slipstream.explain.words import refusal_line
