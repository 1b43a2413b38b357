"""The map's layer of the fleet: planned routes, stops, and vehicles at their positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
import viser

from dashboard.scene import geometry
from dashboard.scene.canvas import Canvas, stroke_colours
from dashboard.scene.geometry import Array
from dashboard.scene.lanes import Drawing, Lanes
from dashboard.view import Rgb, VehicleView

MAX_VEHICLES: Final = 500
MAX_LABELS: Final = 40
"""Maximum number of labels of stops, and of vehicles; with more of a kind none is drawn."""
ROUTE_LANES: Final = 4
"""Number of routes drawn side by side; further ones share their lanes."""
_LANE_UNITS: Final[Array] = np.array([1.3 + 0.5 * lane for lane in range(ROUTE_LANES)])
"""Offset of each lane to the right of its road, in units."""
_DARK: Final[Rgb] = (29, 39, 51)
_WHITE: Final[Rgb] = (255, 255, 255)


class FleetLayer:
    """Draws vehicles, routes and stops on a canvas and updates them.

    Args:
        canvas: what to draw on.
        depots: junctions with a depot's marker, which get no stop's marker.
    """

    def __init__(self, canvas: Canvas, depots: Sequence[str] = ()) -> None:
        self._canvas = canvas
        self._depots = frozenset(depots)
        self._lanes = Lanes(canvas.network, 14 * canvas.unit_m, 0.55 * canvas.unit_m)
        x_min, y_min, x_max, y_max = canvas.network.bounds_m()
        self._label_spacing_m = max(8 * canvas.unit_m, 0.05 * max(x_max - x_min, y_max - y_min))
        self._routes: list[tuple[object, ...]] = []
        self._stops: tuple[tuple[str, str], ...] = ()
        self._stop_labels = 0
        self._places_m: Array = np.empty((0, 2))
        self._rgb: tuple[Rgb, ...] = ()
        self._nodes: list[viser.PointCloudHandle] = []
        self._labels: list[viser.LabelHandle] = []

    def update(self, vehicles: Sequence[VehicleView]) -> None:
        """Show the vehicles whose routes run on this network."""
        indices = self._lanes.index
        known = [
            van
            for van in vehicles
            if all(name in indices for name, _ in van.route)
            and (van.position is None or van.position[0] in indices)
        ]
        known = known[:MAX_VEHICLES]
        self._update_stops(known)
        self._update_routes(known)
        self._update_vans(known)

    def _update_stops(self, vehicles: Sequence[VehicleView]) -> None:
        junctions = self._canvas.network.junctions
        names: dict[str, set[str]] = {}
        for van in vehicles:
            for stop, node in van.stops:
                if node in junctions and node not in self._depots:
                    names.setdefault(node, set()).add(stop)
        # Stops at one junction share a label; separate ones would overlap.
        stops = tuple(sorted((" + ".join(sorted(names[node])), node) for node in names))
        if stops == self._stops:
            return
        places = [junctions[node] for _, node in stops]
        # Labels at neighbouring junctions of a large network would overlap too.
        near = geometry.group_nearby(np.array(places).reshape(-1, 2), self._label_spacing_m)
        groups = near if len(near) <= MAX_LABELS else []
        for index in range(len(groups), self._stop_labels):
            self._canvas.scene.remove_by_name(f"/stop_{index}")
        for index, group in enumerate(groups):
            stop, place = _joint_label([stops[member][0] for member in group]), places[group[0]]
            north = place[1] >= self._canvas.centre_m[1]
            self._canvas.label(
                f"/stop_{index}",
                stop[:40],
                np.array(place),
                1.0 if north else -1.0,
                "bottom-center" if north else "top-center",
            )
        if places:
            self._canvas.points("/stops", places, _DARK, 0.9, "circle")
        else:
            self._canvas.scene.remove_by_name("/stops")
        self._stops, self._stop_labels = stops, len(groups)

    def _update_routes(self, vehicles: Sequence[VehicleView]) -> None:
        routes: list[tuple[object, ...]] = [(van.route, van.rgb, van.expired) for van in vehicles]
        if routes == self._routes:
            return
        self._routes = routes
        lengths = np.array([len(van.route) for van in vehicles], dtype=np.int64)
        van_of_part = np.repeat(np.arange(len(vehicles)), lengths)
        parts = [part for van in vehicles for part in van.route]
        roads = np.array([self._lanes.index[name] for name, _ in parts], dtype=np.int64)
        together = np.array([platoon is not None for _, platoon in parts], dtype=np.bool_)
        lanes_m = _LANE_UNITS[van_of_part % ROUTE_LANES] * self._canvas.unit_m
        # Not from a van's last road to the first one of the next van.
        before = np.flatnonzero(van_of_part[:-1] == van_of_part[1:])

        drawing = self._lanes.road_strokes(roads, lanes_m)
        in_platoon = together[drawing.part]
        across = self._lanes.junction_strokes(roads, lanes_m, before)
        arrows = self._lanes.arrow_strokes(roads, lanes_m)
        alone = (_only(drawing, ~in_platoon), across, arrows)
        self._draw_routes("/routes_alone", alone, 0.16, vehicles, van_of_part)
        platoons = (_only(drawing, in_platoon),)
        self._draw_routes("/routes_platoon", platoons, 0.38, vehicles, van_of_part)

    def _draw_routes(
        self,
        name: str,
        drawings: Sequence[Drawing],
        units: float,
        vehicles: Sequence[VehicleView],
        van_of_part: npt.NDArray[np.int64],
    ) -> None:
        van = van_of_part[np.concatenate([drawing.part for drawing in drawings])]
        if not len(van):
            self._canvas.scene.remove_by_name(name)
            return
        strokes_m = np.concatenate([drawing.strokes for drawing in drawings])
        rgb = np.array([_faded(view.rgb) if view.expired else view.rgb for view in vehicles])
        # Between roads and vehicles, one above the other for any number of vehicles.
        heights = 0.02 + 0.024 * van / max(len(vehicles), 60)
        self._canvas.lines(name, strokes_m, stroke_colours(rgb[van]), units, heights)

    def _update_vans(self, vehicles: Sequence[VehicleView]) -> None:
        here = [
            (van, *van.position, _LANE_UNITS[index % ROUTE_LANES])
            for index, van in enumerate(vehicles)
            if van.position is not None and not van.expired
        ]
        places_m = np.array(
            [
                geometry.point_at(self._canvas.offset_line(name, lane), share)[0]
                for _, name, share, lane in here
            ]
        ).reshape(-1, 2)
        rgb = tuple(van.rgb for van, *_ in here)
        if rgb != self._rgb:
            self._redraw_vans(places_m, rgb)
        elif not np.array_equal(places_m, self._places_m):
            for node, height in zip(self._nodes, (0.05, 0.055), strict=True):
                node.points = self._canvas.positions(places_m, height)
        self._places_m, self._rgb = places_m, rgb
        self._label_vans(places_m, [van.vehicle[:40] for van, *_ in here])

    def _redraw_vans(self, places_m: Array, rgb: tuple[Rgb, ...]) -> None:
        for node in self._nodes:
            node.remove()
        self._nodes = []
        if rgb:
            # A white rim sets a vehicle off its route.
            colours = np.array(rgb, dtype=np.uint8)
            self._nodes = [
                self._canvas.points("/vans_rim", places_m, _WHITE, 1.9, "circle", 0.05),
                self._canvas.points("/vans", places_m, colours, 1.4, "circle", 0.055),
            ]

    def _label_vans(self, places_m: Array, names: Sequence[str]) -> None:
        # Vehicles of one platoon share a label; separate ones would overlap.
        groups = geometry.group_nearby(places_m, self._label_spacing_m)
        if len(groups) > MAX_LABELS:
            groups = []
        for index, group in enumerate(groups):
            text = _joint_label([names[member] for member in group])
            place = places_m[group[0]]
            if index == len(self._labels):
                name = f"/van_label_{index}"
                self._labels.append(self._canvas.label(name, text, place, -1.5, "top-center"))
                continue
            label = self._labels[index]
            position = self._canvas.label_position(place, -1.5)
            if not np.array_equal(label.position, position):
                label.position = position
            if label.text != text:
                label.text = text
        for label in self._labels[len(groups) :]:
            label.remove()
        del self._labels[len(groups) :]


def _joint_label(names: Sequence[str]) -> str:
    """One label for several names: the first three and the number of the rest."""
    more = f" + {len(names) - 3} more" if len(names) > 3 else ""
    return " + ".join(names[:3]) + more


def _only(drawing: Drawing, chosen: npt.NDArray[np.bool_]) -> Drawing:
    return Drawing(drawing.strokes[chosen], drawing.part[chosen])


def _faded(rgb: Rgb) -> Rgb:
    red, green, blue = (round(255 - (255 - part) * 0.3) for part in rgb)
    return red, green, blue
