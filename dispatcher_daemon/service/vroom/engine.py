"""Ways between coordinates over our roads: what VROOM asks a routing engine for."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from dispatcher_daemon.fleet import Fleet, located, to_node_m, with_unknown_nodes
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import Floats, Travel, roads_of
from dispatcher_daemon.service.vroom.model import Ints, Matrices
from dispatcher_daemon.service.vroom.schema import Coordinates
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.roads.snapping import MAX_SNAP_M
from slipstream.vehicle_types import PRESETS

log = logging.getLogger(__name__)

PROFILES: Final = {"car": "paper_car", **{name: name for name in PRESETS}}
"""Vehicle type by name of a profile."""
_WH_PER_KWH: Final = 1000.0
_POLYLINE_DEGREES: Final = 1e5


class RoutingError(InputError):
    """Coordinates that no road of the network is near to: VROOM's code 3."""


@dataclass(frozen=True)
class RoutingEngine:
    """Roads in the traffic of one moment.

    Attributes:
        minimise: of ways: travel time, or energy, which is then what they cost, in whole Wh.
    """

    network: RoadNetwork
    snapshot: TrafficSnapshot
    minimise: Literal["time", "energy"] = "time"

    def ways(self, profile: str, places: Sequence[Coordinates], source: str) -> RoadWays:
        """Ways of a profile's vehicles between places.

        Raises:
            InputError: there is no such profile.
            RoutingError: a place is too far from any road.
        """
        if profile not in PROFILES:
            mend = f"take one of {', '.join(PROFILES)}, or give matrices.{profile}"
            raise InputError(source, f"no profile {profile!r}", mend, key="vehicles.profile")
        names = [str(number) for number in range(len(places))]
        rows = [
            {"id": name, "lat": latitude, "lon": longitude}
            for name, (longitude, latitude) in zip(names, places, strict=True)
        ]
        data = {
            "depots": [{"id": "depot", **{k: rows[0][k] for k in ("lat", "lon")}}],
            "stops": rows,
            "vehicles": [{"id": "vehicle", "type": PROFILES[profile]}],
        }
        try:
            fleet = located(Fleet.model_validate(with_unknown_nodes(data)), self.network, source)
        except InputError as error:
            name = (error.key or "").split(".")
            place = places[int(name[1])] if len(name) > 1 and name[1].isdigit() else places[0]
            mend = (
                f"give places within {MAX_SNAP_M:.0f} m of a road where vehicles may stop, or the "
                "network of that region"
            )
            raise RoutingError(source, error.problem, mend, key=f"location {list(place)}") from None
        _tell_distances(fleet, self.network)
        problem = RoutingProblem(self.network, fleet, search=self.minimise)
        return RoadWays(self, Travel(problem, roads_of(problem, self.snapshot)), tuple(names))


def _tell_distances(fleet: Fleet, network: RoadNetwork) -> None:
    """Log how many places are served further away than a place may lie from its road."""
    found = [(to_node_m(network, s.lat, s.lon, s.node) or 0.0, s) for s in fleet.stops]
    far = [(away_m, stop) for away_m, stop in found if away_m > MAX_SNAP_M]
    if far:
        away_m, stop = max(far, key=lambda item: item[0])
        log.warning(
            "%d of %d locations are served more than %.0f m away, [%g, %g] %.0f m away, at %r",
            *(len(far), len(found), MAX_SNAP_M, stop.lon, stop.lat, away_m, stop.node),
        )


@dataclass(frozen=True)
class RoadWays:
    """Ways between some places, by their numbers."""

    engine: RoutingEngine
    travel: Travel
    names: tuple[str, ...]

    def matrices(self) -> Matrices:
        """Times, distances and, where energy is minimised, costs in Wh."""
        travel = self.travel
        rows = [travel.row[name] for name in self.names]
        every = np.ix_(rows, rows)
        reached = np.isfinite(travel.search_cost_kwh[every])

        def whole(values: Floats) -> Ints:
            rounded = np.floor(np.where(reached, values[every], 0.0) + 0.5)
            return np.where(reached, rounded, -1).astype(np.int64)

        costs = None
        if self.engine.minimise == "energy":
            costs = whole(np.maximum(travel.search_cost_kwh, 0.0) * _WH_PER_KWH)
        return Matrices(whole(travel.duration_s), whole(travel.distance_m), costs)

    def points(self, places: Sequence[int]) -> list[tuple[float, float]]:
        """(latitude, longitude) along the ways between places in order.

        Raises:
            ValueError: no road leads between two of them.
        """
        network = self.engine.network
        shape: list[tuple[float, float]] = []
        for a, b in pairwise(places):
            leg = self.travel.leg(self.names[a], self.names[b])
            if leg is None:
                raise ValueError(f"no way from {a} to {b}")
            for segment in leg.path:
                for point in network.segments[segment].shape:
                    if not shape or shape[-1] != point:
                        shape.append(point)
        if network.projection is None or not shape:
            return []
        return list(network.projection.degrees(shape))


def polyline(points: Sequence[tuple[float, float]]) -> str:
    """Points in the encoded polyline format with five decimals."""
    text, last = [], (0, 0)
    for point in points:
        now = round(point[0] * _POLYLINE_DEGREES), round(point[1] * _POLYLINE_DEGREES)
        for change in (now[0] - last[0], now[1] - last[1]):
            bits = ~(change << 1) if change < 0 else change << 1
            while bits >= 0x20:
                text.append(chr((0x20 | (bits & 0x1F)) + 63))
                bits >>= 5
            text.append(chr(bits + 63))
        last = now
    return "".join(text)
