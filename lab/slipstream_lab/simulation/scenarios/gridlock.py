"""Detection of gridlock in a running simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream_lab.simulation.scenarios.acceptance import clock

CHECK_S: Final = 600.0
"""Between two checks."""

_STANDING_MPS: Final = 0.1
_STUCK_SHARE: Final = 0.8
_STUCK_CHECKS: Final = 3
_STUCK_VEHICLES: Final = 50


class GridlockWatch:
    """Gridlock: at three checks in a row, ten minutes apart, four fifths of the vehicles stand.
    `since_s`: simulated time at which it was a gridlock; None: never.
    """

    def __init__(self) -> None:
        self.since_s: float | None = None
        self._stuck = 0

    def update(self, now_s: float) -> bool:
        """Take in the running simulation; True if it is in a gridlock."""
        import libsumo

        names = libsumo.vehicle.getIDList()
        standing = sum(libsumo.vehicle.getSpeed(name) < _STANDING_MPS for name in names)
        stuck = len(names) >= _STUCK_VEHICLES and standing >= _STUCK_SHARE * len(names)
        self._stuck = self._stuck + 1 if stuck else 0
        if self._stuck >= _STUCK_CHECKS:
            self.since_s = now_s
        return self.since_s is not None

    def refuse(self, now_s: float, source: str | Path) -> None:
        """Check, and end a simulation in a gridlock. Raises InputError: it is in a gridlock."""
        if self.update(now_s):
            raise InputError(
                source, f"gridlock at {clock(now_s)}", "take fewer trips or another network"
            )
