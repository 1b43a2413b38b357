"""The map's layers of the fleet: planned routes, stops, vehicles and the platoons they are in."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt
import viser

from dashboard.scene import geometry, shapes
from dashboard.scene.canvas import Batch, Canvas
from dashboard.scene.geometry import Array
from dashboard.scene.lanes import Lanes
from dashboard.scene.marks import Mark
from dashboard.view import labels
from dashboard.view.labels import Rgb
from dashboard.view.model import VehicleView

MAX_VEHICLES: Final = 2000
MAX_ROUTE_STRIPS: Final = 6000
"""Strips of the routes, each in its vehicle's colour; with more, each road is drawn once."""
MAX_PLATOON_STRIPS: Final = 600
"""Strips of platoons' ways, likewise."""
ROUTE_LANES: Final = 4
"""Number of routes drawn side by side; further ones share their lanes."""
VEHICLE_UNITS: Final = 2.2
"""Length of a drawn vehicle, in units."""
LANE_UNITS: Final = 0.5
"""Offset of a road's band, and of the vehicles on it, to the right of its line, in units."""
_ROUTE_UNITS: Final[Array] = np.array([1.0 + 0.24 * lane for lane in range(ROUTE_LANES)])
"""Offset of each lane of routes to the right of its road's line, in units: beside the band."""
PLANNED_OPACITY: Final = 0.38
"""Of vehicles that nobody hears: never heard, they are where their plans put them; silent, where
they were heard last."""
_MAX_LINK_VEHICLES: Final = 12.0
"""Members of a platoon further apart than so many drawn vehicles are not linked."""
_LINK_RGB: Final[Rgb] = (0, 120, 90)
_ALL_ROUTES_RGB: Final[Rgb] = (120, 140, 170)
_STOP_RGB: Final[Rgb] = (60, 72, 88)


@dataclass(frozen=True)
class Placed:
    """The vehicles that are drawn, and where.

    Attributes:
        vehicles: in the order of the arrays.
        reported: which of them report where they are, (N,); the others are where their plans put
            them.
        places_m: (N, 2).
        headings: from the east, anticlockwise, rad, (N,).
    """

    vehicles: tuple[VehicleView, ...]
    reported: npt.NDArray[np.bool_]
    places_m: Array
    headings: Array


class FleetLayer:
    """Draws vehicles, routes and stops, and updates them."""

    def __init__(
        self,
        scene: viser.SceneApi,
        canvas: Canvas,
        depots: Collection[str] = (),
    ) -> None:
        self._scene = scene
        self._canvas = canvas
        self._depots = frozenset(depots)
        self.lanes = Lanes(canvas.network, 14 * canvas.unit_m, 0.5 * canvas.unit_m)
        self._routes: object = None
        self._platoons: object = None
        self._stops: tuple[tuple[str, str], ...] = ()
        self._stop_marks: tuple[Mark, ...] = ()
        self._route_batch = Batch(scene, "/routes", shapes.QUAD, "toon3")
        self._platoon_batch = Batch(scene, "/platoons", shapes.QUAD, "toon3")
        self._link_batch = Batch(scene, "/platoon_links", shapes.QUAD, "toon3")
        self._stop_batch = Batch(scene, "/stops", shapes.STOP)
        # By whether they report where they are.
        self._body_batches = {
            True: Batch(scene, "/vans", shapes.VAN),
            False: Batch(scene, "/planned_vans", shapes.VAN, opacity=PLANNED_OPACITY),
        }
        self._line = cache(lambda name: canvas.offset_line(name, LANE_UNITS))

    def update(
        self, vehicles: Sequence[VehicleView], open_roads: Collection[str]
    ) -> tuple[Placed, list[Mark]]:
        """Show the vehicles whose routes run on this network."""
        indices = self.lanes.index
        known = [
            van
            for van in vehicles
            if all(name in indices for name, _ in van.route)
            and (van.position is None or van.position[0] in indices)
        ][:MAX_VEHICLES]
        self._update_stops(known)
        self._update_routes(known)
        self._update_platoons(known, frozenset(open_roads))
        drawn = [van for van in known if van.position and (van.silence or not van.expired)]
        placed = self._place(drawn, open_roads)
        self._update_bodies(placed)
        return placed, [*self._vehicle_marks(placed), *self._stop_marks]

    def route_strokes(self, van: VehicleView) -> Array:
        """Strokes of one vehicle's whole way, (N, 2, 2), m."""
        names = [name for name, _ in van.route if name in self.lanes.index]
        roads = np.array([self.lanes.index[name] for name in names], dtype=np.int64)
        lanes_m = np.full(len(roads), _ROUTE_UNITS[0] * self._canvas.unit_m)
        before = np.arange(max(len(roads) - 1, 0))
        across = self.lanes.junction_strokes(roads, lanes_m, before)
        return np.concatenate((self.lanes.road_strokes(roads, lanes_m).strokes, across.strokes))

    def _update_stops(self, vehicles: Sequence[VehicleView]) -> None:
        junctions = self._canvas.network.junctions
        names: dict[str, set[str]] = {}
        for van in vehicles:
            for stop in van.plan.stops:
                if stop.node in junctions and stop.node not in self._depots:
                    names.setdefault(stop.node, set()).add(stop.stop)
        # Stops at one junction share a label; separate ones would overlap.
        stops = tuple(sorted((_joint_label(sorted(names[node])), node) for node in names))
        if stops == self._stops:
            return
        self._stops = stops
        places = np.array([junctions[node] for _, node in stops]).reshape(-1, 2)
        flat = np.zeros(len(places))
        self._stop_batch.show(self._canvas.bodies(places, flat, _STOP_RGB, 0.8))
        tops = self._canvas.positions(places, 0.6)
        self._stop_marks = tuple(
            Mark("stop", node, text, (float(top[0]), float(top[1]), float(top[2])))
            for (text, node), top in zip(stops, tops, strict=True)
        )

    def _update_routes(self, vehicles: Sequence[VehicleView]) -> None:
        routes = [(van.route, van.rgb, van.expired) for van in vehicles]
        if routes == self._routes:
            return
        self._routes = routes
        van_of_part, roads = self._parts(vehicles)
        lanes_m = _ROUTE_UNITS[van_of_part % ROUTE_LANES] * self._canvas.unit_m
        drawing = self.lanes.road_strokes(roads, lanes_m)
        if len(drawing.strokes) > MAX_ROUTE_STRIPS:
            self._show_driven_roads(roads)
            return
        self._scene.remove_by_name("/all_routes")
        # Not from a van's last road to the first one of the next van.
        before = np.flatnonzero(van_of_part[:-1] == van_of_part[1:])
        drawings = (
            drawing,
            self.lanes.junction_strokes(roads, lanes_m, before),
            self.lanes.arrow_strokes(roads, lanes_m),
        )
        van = van_of_part[np.concatenate([part.part for part in drawings])]
        rgb = np.array([_faded(view.rgb) if view.expired else view.rgb for view in vehicles])
        strokes_m = np.concatenate([part.strokes for part in drawings])
        # Above the roads, one above the other.
        heights = 0.08 + 0.1 * van / max(len(vehicles), 60)
        colours = rgb.reshape(-1, 3)[van]
        self._route_batch.show(self._canvas.strips(strokes_m, colours, 0.2, heights))

    def _show_driven_roads(self, roads: npt.NDArray[np.int64]) -> None:
        """Each road that a route leads over once, wider the more routes there are."""
        driven, counts = np.unique(roads, return_counts=True)
        lane_m = np.full(len(driven), _ROUTE_UNITS[0] * self._canvas.unit_m)
        drawing = self.lanes.road_strokes(driven, lane_m)
        widths = (0.12 + 0.5 * np.sqrt(counts / counts.max()))[drawing.part]
        corners, faces = geometry.bands(drawing.strokes, widths * self._canvas.unit_m)
        self._route_batch.clear()
        # One colour: plain triangles are drawn in a third of the time of a batch.
        self._canvas.area(self._scene, "/all_routes", corners, faces, _ALL_ROUTES_RGB, 0.06)

    def _update_platoons(self, vehicles: Sequence[VehicleView], open_roads: frozenset[str]) -> None:
        parts = [
            (index, name)
            for index, van in enumerate(vehicles)
            if not van.expired
            for name, platoon in van.route
            if platoon is not None and name in open_roads
        ]
        key = [(index % ROUTE_LANES, vehicles[index].rgb, name) for index, name in parts]
        if key == self._platoons:
            return
        self._platoons = key
        # Many routes over one road hide each other: one of each lane is enough, and one in all
        # where the routes themselves are drawn as one.
        many = len(key) > MAX_PLATOON_STRIPS
        drawn = sorted(
            {
                (0 if many else lane, name): _LINK_RGB if many else rgb for lane, rgb, name in key
            }.items()
        )
        roads = np.array([self.lanes.index[name] for (_, name), _ in drawn], dtype=np.int64)
        lanes = np.array([lane for (lane, _), _ in drawn], dtype=np.int64)
        drawing = self.lanes.road_strokes(roads, _ROUTE_UNITS[lanes] * self._canvas.unit_m)
        rgb = np.array([rgb for _, rgb in drawn]).reshape(-1, 3)[drawing.part]
        self._platoon_batch.show(self._canvas.strips(drawing.strokes, rgb, 0.34, 0.2))

    def _parts(
        self, vehicles: Sequence[VehicleView]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """For each road that is driven, by each vehicle: the vehicle's and the road's number."""
        lengths = np.array([len(van.route) for van in vehicles], dtype=np.int64)
        roads = [self.lanes.index[name] for van in vehicles for name, _ in van.route]
        return np.repeat(np.arange(len(vehicles)), lengths), np.array(roads, dtype=np.int64)

    def _place(self, vehicles: Sequence[VehicleView], open_roads: Collection[str]) -> Placed:
        count = len(vehicles)
        places, ahead = np.empty((count, 2)), np.empty((count, 2))
        for index, van in enumerate(vehicles):
            assert van.position is not None
            places[index], ahead[index] = geometry.point_at(
                self._line(van.position[0]), van.position[1]
            )
        links = []
        for platoon in _platoons(vehicles, open_roads):
            for leader, follower in pairwise(platoon):
                apart = float(np.linalg.norm(places[leader] - places[follower]))
                if apart > _MAX_LINK_VEHICLES * VEHICLE_UNITS * self._canvas.unit_m:
                    continue
                # Drawn vehicles are longer than real ones: they would stand inside each other.
                room = 1.25 * VEHICLE_UNITS * self._canvas.unit_m
                if apart < room:
                    places[follower] = places[leader] - room * ahead[leader]
                links.append((places[leader], places[follower]))
        strokes = np.array(links).reshape(-1, 2, 2)
        self._link_batch.show(self._canvas.strips(strokes, _LINK_RGB, 0.34, 0.5))
        return Placed(
            tuple(vehicles),
            np.array([van.progress.reported for van in vehicles], dtype=np.bool_),
            places,
            np.arctan2(ahead[:, 1], ahead[:, 0]),
        )

    def _update_bodies(self, placed: Placed) -> None:
        rgb = np.array([_body_rgb(van) for van in placed.vehicles]).reshape(-1, 3)
        for reported, batch in self._body_batches.items():
            mine = placed.reported == reported
            bodies = self._canvas.bodies(
                placed.places_m[mine], placed.headings[mine], rgb[mine], VEHICLE_UNITS
            )
            batch.show(bodies)

    def _vehicle_marks(self, placed: Placed) -> list[Mark]:
        tops = self._canvas.positions(placed.places_m, 0.75 * VEHICLE_UNITS)
        return [
            Mark(
                "van",
                van.vehicle,
                _label(van),
                (float(x), float(y), float(z)),
                van.silence == "bad",
            )
            for van, (x, y, z) in zip(placed.vehicles, tops, strict=True)
        ]


def _body_rgb(van: VehicleView) -> Rgb:
    """Its colour; a silent one with work to do has that of trouble."""
    if van.silence == "warn" or van.silence == "bad":
        return labels.LEVEL_RGB[van.silence]
    return van.rgb


def _label(van: VehicleView) -> str:
    """Its name, and what it is where nobody hears it."""
    name = van.vehicle[:40]
    if van.silence is not None:
        return f"{name}, silent"
    return f"{name}, by plan" if van.progress.state == "planned" else name


def _platoons(vehicles: Sequence[VehicleView], open_roads: Collection[str]) -> list[list[int]]:
    """Vehicles that are in a platoon where they are now, by their plans if nobody has heard them,
    each platoon from its leader on."""
    members: dict[str, list[tuple[int, float, int]]] = {}
    for index, van in enumerate(vehicles):
        assert van.position is not None
        road, share = van.position
        if road not in open_roads or not van.progress.on_road:
            continue
        order = next((n for n, part in enumerate(van.route) if part[0] == road), None)
        platoon = None if order is None else van.route[order][1]
        if platoon is not None:
            # Routes before the platoon differ: what is left of it says who is ahead.
            left = sum(name == platoon for _, name in van.route[order:])
            members.setdefault(platoon, []).append((left, -share, index))
    return [[index for *_, index in sorted(group)] for group in members.values() if len(group) > 1]


def _joint_label(names: Sequence[str]) -> str:
    """One label for several names: the first three and the number of the rest."""
    more = f" + {len(names) - 3} more" if len(names) > 3 else ""
    return (" + ".join(names[:3]) + more)[:40]


def _faded(rgb: Rgb) -> Rgb:
    red, green, blue = (round(255 - (255 - part) * 0.3) for part in rgb)
    return red, green, blue
