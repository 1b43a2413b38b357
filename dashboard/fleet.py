"""The map's fleet: planned routes, stops, and the vans where their plans put them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import viser

from dashboard import geometry
from dashboard.canvas import Canvas
from dashboard.geometry import Array
from dashboard.views import VehicleView
from dashboard.words import Rgb

MAX_VEHICLES: Final = 60
MAX_LABELS: Final = 40
ROUTE_LANES: Final = 4
"""Routes drawn beside each other before they share a lane."""
_DARK: Final[Rgb] = (29, 39, 51)
_WHITE: Final[Rgb] = (255, 255, 255)


class FleetLayer:
    """Draws vehicles' plans on a canvas and keeps them up to date.

    Args:
        canvas: what to draw on.
        depots: junctions that are marked already, so not as stops again.
    """

    def __init__(self, canvas: Canvas, depots: Sequence[str] = ()) -> None:
        self._canvas = canvas
        self._depots = frozenset(depots)
        self._routes: list[tuple[object, ...]] = []
        self._stops: tuple[tuple[str, str], ...] = ()
        self._places_m: Array = np.empty((0, 2))
        self._rgb: tuple[Rgb, ...] = ()
        self._nodes: list[viser.PointCloudHandle] = []
        self._labels: list[viser.LabelHandle] = []

    def update(self, vehicles: Sequence[VehicleView]) -> None:
        """Show the vehicles whose routes run on this network."""
        segments = self._canvas.network.segments
        known = [van for van in vehicles if all(name in segments for name, _ in van.route)]
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
        # Stops at one junction share a label; theirs would lie on top of each other.
        planned = sorted((" + ".join(sorted(names[node])), node) for node in names)
        stops = tuple(planned[:MAX_LABELS])
        if stops == self._stops:
            return
        for index in range(len(stops), len(self._stops)):
            self._canvas.scene.remove_by_name(f"/stop_{index}")
        places = [junctions[node] for _, node in stops]
        for index, ((stop, _), place) in enumerate(zip(stops, places, strict=True)):
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
        self._stops = stops

    def _update_routes(self, vehicles: Sequence[VehicleView]) -> None:
        routes = [(van.route, van.rgb, van.expired) for van in vehicles]
        for index in range(max(len(routes), len(self._routes))):
            if routes[index : index + 1] == self._routes[index : index + 1]:
                continue
            for part in ("alone", "platoon"):
                self._canvas.scene.remove_by_name(f"/route_{index}_{part}")
            if index < len(vehicles):
                self._draw_route(index, vehicles[index])
        self._routes = list(routes)

    def _draw_route(self, index: int, van: VehicleView) -> None:
        unit_m = self._canvas.unit_m
        alone: list[Array] = []
        together: list[Array] = []
        before: Array | None = None
        for name, platoon in van.route:
            line = self._canvas.beside(name, _lane(index))
            if before is not None:
                alone.append(np.array([[before, line[0]]]))
            (alone if platoon is None else together).append(geometry.strokes(line))
            alone.append(geometry.arrowheads(line, 14 * unit_m, 0.55 * unit_m))
            before = line[-1]
        rgb = _faded(van.rgb) if van.expired else van.rgb
        height = 0.02 + 0.0004 * index
        for part, strokes, units in (("alone", alone, 0.16), ("platoon", together, 0.38)):
            if strokes:
                self._canvas.lines(
                    f"/route_{index}_{part}", np.concatenate(strokes), rgb, units, height
                )

    def _update_vans(self, vehicles: Sequence[VehicleView]) -> None:
        here = [
            (van, geometry.at(self._canvas.beside(van.position[0], _lane(index)), van.position[1]))
            for index, van in enumerate(vehicles)
            if van.position is not None and not van.expired
        ]
        places_m = np.array([place for _, (place, _) in here]).reshape(-1, 2)
        rgb = tuple(van.rgb for van, _ in here)
        if rgb != self._rgb:
            self._redraw_vans(places_m, rgb)
        elif not np.array_equal(places_m, self._places_m):
            for node, height in zip(self._nodes, (0.05, 0.055), strict=True):
                node.points = self._canvas.positions(places_m, height)
        self._places_m, self._rgb = places_m, rgb
        self._label_vans(places_m, [van.vehicle[:40] for van, _ in here])

    def _redraw_vans(self, places_m: Array, rgb: tuple[Rgb, ...]) -> None:
        for node in self._nodes:
            node.remove()
        self._nodes = []
        if rgb:
            # A white rim keeps a van apart from its route.
            colours = np.array(rgb, dtype=np.uint8)
            self._nodes = [
                self._canvas.points("/vans_rim", places_m, _WHITE, 1.9, "circle", 0.05),
                self._canvas.points("/vans", places_m, colours, 1.4, "circle", 0.055),
            ]

    def _label_vans(self, places_m: Array, names: Sequence[str]) -> None:
        # Vans of one platoon share a label; theirs would lie on top of each other.
        groups = geometry.near_each_other(places_m, 8 * self._canvas.unit_m)[:MAX_LABELS]
        for index, group in enumerate(groups):
            text = " + ".join(names[member] for member in group[:3])
            if len(group) > 3:
                text += f" + {len(group) - 3} more"
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


def _lane(index: int) -> float:
    """How far to the right of its road a vehicle's route is drawn, in units."""
    return 1.3 + 0.5 * (index % ROUTE_LANES)


def _faded(rgb: Rgb) -> Rgb:
    red, green, blue = (round(255 - (255 - part) * 0.3) for part in rgb)
    return red, green, blue
