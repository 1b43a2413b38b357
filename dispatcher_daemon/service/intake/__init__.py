"""Orders that callers submit: checked, stored, then told; shown, cancelled, pinned and released."""

from __future__ import annotations

from dispatcher_daemon.service.intake.intake import MAX_AT_ONCE, OrderIntake, OrdersRefused
from dispatcher_daemon.service.intake.over_bus import OrderAnswers
from dispatcher_daemon.service.intake.reading import Given, Pin, Settlement, read_request

__all__ = [
    "MAX_AT_ONCE",
    "Given",
    "OrderAnswers",
    "OrderIntake",
    "OrdersRefused",
    "Pin",
    "Settlement",
    "read_request",
]
