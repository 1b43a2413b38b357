"""Counts vehicle positions on the bus, and the vehicles that moved."""

from __future__ import annotations

import threading

from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.messages import ALL_POSITIONS, VehiclePosition, decode


class FleetMovement:
    """Positions since `listen`; it remembers one a vehicle."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last: dict[str, tuple[str, float]] = {}
        self._moved: set[str] = set()
        self._count = 0

    def listen(self, bus: Bus) -> None:
        """Count from now on."""
        bus.subscribe(ALL_POSITIONS, self.take, every=True)

    def take(self, key: str, payload: bytes) -> None:
        """Count one message; what is no position is left out."""
        try:
            position = decode(VehiclePosition, payload, key)
        except InputError:
            return
        place = (position.segment, position.share)
        with self._lock:
            self._count += 1
            if self._last.get(position.vehicle, place) != place:
                self._moved.add(position.vehicle)
            self._last[position.vehicle] = place

    def summary(self) -> dict[str, int]:
        """The figures, ready for JSON."""
        with self._lock:
            return {"positions": self._count, "vehicles_moved": len(self._moved)}
