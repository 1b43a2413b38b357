"""The dispatcher's fleet file: open orders and free vehicles of the moment."""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Mapping
from pathlib import Path

from simulation.scenarios.demand import Deliveries, fleet_at


def open_since_s(deliveries: Deliveries, begin_s: float) -> float:
    """Release from which on orders are open in a world that begins at a time of day: those of the
    last wave and after it; older ones count as served.
    """
    return max(0.0, begin_s - deliveries.settings.wave_s)


class FleetFile:
    """Rewritten as orders are released and vehicles come and go; its times count from then.

    Args:
        path: of the file, in a folder that is there.
        deliveries: of the day.
    """

    def __init__(self, path: Path, deliveries: Deliveries) -> None:
        self._path = path
        self._deliveries = deliveries

    def write(self, now_s: float, idle: Mapping[str, float], taken: Collection[str]) -> int:
        """Write the fleet of a moment atomically.

        Args:
            now_s: s since midnight.
            idle: since when each free vehicle is at its depot, s.
            taken: orders that are served or on their way.

        Returns:
            Number of open orders that are not taken.
        """
        fleet = fleet_at(self._deliveries, now_s, idle, taken)
        text = (
            json.dumps({"depots": [], "stops": [], "vehicles": []})
            if fleet is None
            else fleet.model_dump_json(indent=1, exclude_none=True)
        )
        unfinished = self._path.with_suffix(".part")
        unfinished.write_text(text, encoding="utf-8")
        os.replace(unfinished, self._path)
        return len(self._deliveries.released(now_s, taken))
