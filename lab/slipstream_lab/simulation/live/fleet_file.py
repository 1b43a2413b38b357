"""The dispatcher's fleet file: orders of the moment, and all vehicles."""

from __future__ import annotations

import json
import os
from collections.abc import Collection
from pathlib import Path

from slipstream_lab.simulation.scenarios.demand import Deliveries, fleet_at


class LiveFleetFile:
    """Rewritten as orders are released and served; its times count from then.

    Orders that were released before the last wave count as served when the world begins. All
    vehicles are listed: where each is, it tells the dispatcher itself.
    """

    def __init__(self, path: Path, deliveries: Deliveries, begin_s: float) -> None:
        self._path = path
        self._deliveries = deliveries
        open_since_s = max(0.0, begin_s - deliveries.settings.wave_s)
        self._over = {o.id for o in deliveries.orders if o.release_s < open_since_s}

    def write(self, now_s: float, served: Collection[str]) -> int:
        """Write the fleet of a moment atomically."""
        done = self._over.union(served)
        fleet = fleet_at(
            self._deliveries, now_s, dict.fromkeys(self._deliveries.vehicles, now_s), done
        )
        text = (
            json.dumps({"depots": [], "stops": [], "vehicles": []})
            if fleet is None
            else fleet.model_dump_json(indent=1, exclude_unset=True)
        )
        unfinished = self._path.with_suffix(".part")
        unfinished.write_text(text, encoding="utf-8")
        os.replace(unfinished, self._path)
        return len(self._deliveries.released(now_s, done))
