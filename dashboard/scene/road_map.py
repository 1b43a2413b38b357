"""The map: all roads, the watched ones by their traffic, depots, cameras and the fleet.

Each layer is one scene node, updated only when its content has changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
import viser

from dashboard.scene import geometry
from dashboard.scene.canvas import FOV_RAD, Canvas, stroke_colours
from dashboard.scene.fleet import ROUTE_LANES, FleetLayer
from dashboard.scene.geometry import Array
from dashboard.view import DashboardView, Rgb, RoadView, Traffic, labels
from slipstream.roads import RoadNetwork

MAX_LABELS: Final = 40
"""Maximum number of labelled roads; with more none is labelled, as labels would hide the map."""
_ROAD_RGB: Final[Rgb] = (195, 202, 211)
_GAP_RGB: Final[dict[Traffic, Rgb]] = {
    "stable": (0, 158, 115),
    "turbulent": (252, 228, 210),
    "unknown": (228, 231, 235),
}
_DARK: Final[Rgb] = (29, 39, 51)


class RoadMap:
    """Draws a network, its traffic and its fleet, and updates them.

    Args:
        server: the viser server to draw on.
        network: the road network.
        depots: junctions of the depots; unknown ones are not marked.
    """

    def __init__(
        self, server: viser.ViserServer, network: RoadNetwork, depots: Sequence[str]
    ) -> None:
        self._server = server
        self._network = network
        self._canvas = Canvas(server.scene, network)
        self._fleet = FleetLayer(self._canvas, depots)
        self._watched: tuple[str, ...] = ()
        self._traffic: tuple[Traffic, ...] = ()
        self._node: viser.LineSegmentsHandle | None = None
        self._dash: npt.NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._road_of_dash: npt.NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._labels: dict[str, viser.LabelHandle] = {}
        self._prepare_scene()
        self._draw_roads()
        self._draw_depots(depots)

    def update(self, view: DashboardView) -> None:
        """Show a view; unchanged nodes are not sent again."""
        roads = [road for road in view.roads if road.segment in self._network.segments]
        with self._server.atomic():
            self._update_watched(roads)
            self._update_labels(roads if len(roads) <= MAX_LABELS else ())
            self._fleet.update(view.vehicles)

    def fit(self, width_px: int, height_px: int) -> tuple[Array, Array]:
        """Camera position and the point it looks at, for the network to fill a canvas."""
        return self._canvas.fit(width_px, height_px)

    def _prepare_scene(self) -> None:
        self._server.scene.world_axes.visible = False
        self._server.scene.set_up_direction("+z")
        camera = self._server.initial_camera
        camera.up = (0.0, 1.0, 0.0)
        camera.near, camera.far, camera.fov = 0.1, 1000.0, FOV_RAD
        camera.position, camera.look_at = self.fit(900, 900)

    def _draw_roads(self) -> None:
        # Each direction on its own side, so that a two-way road shows both.
        lines = [self._canvas.offset_line(name, 0.35) for name in self._network.segments]
        strokes = np.concatenate([geometry.strokes(line) for line in lines])
        self._canvas.lines("/roads", strokes, _ROAD_RGB, 0.22, height=0.0)

    def _draw_depots(self, depots: Sequence[str]) -> None:
        junctions = self._network.junctions
        places = [junctions[node] for node in depots if node in junctions]
        if places:
            self._canvas.points("/depots", places, _DARK, 1.3, "square")
        for index, place in enumerate(places[:MAX_LABELS]):
            name = f"/depot_label_{index}"
            self._canvas.label(name, "Depot", np.array(place), 1.4, "bottom-center")

    def _update_watched(self, roads: Sequence[RoadView]) -> None:
        watched = tuple(road.segment for road in roads)
        traffic = tuple(road.traffic for road in roads)
        if (watched, traffic) == (self._watched, self._traffic):
            return
        if watched != self._watched:
            self._draw_watched(watched)
        self._watched, self._traffic = watched, traffic
        if self._node is None:
            return
        rgb = np.empty((len(self._dash), 3), dtype=np.int64)
        state_of_dash = np.array(traffic)[self._road_of_dash]
        for state in sorted(set(traffic)):
            mine = state_of_dash == state
            drawn = _pattern(state, self._dash[mine])
            rgb[mine] = np.where(drawn[:, None], labels.TRAFFIC_RGB[state], _GAP_RGB[state])
        self._node.colors = stroke_colours(rgb)

    def _draw_watched(self, watched: Sequence[str]) -> None:
        if self._node is not None:
            self._node.remove()
            self._node = None
        if not watched:
            self._canvas.scene.remove_by_name("/cameras")
            return
        places = np.array([self._camera(name)[0] for name in watched])
        self._canvas.points("/cameras", places, _DARK, 1.1, "diamond")
        dash_m = 0.5 * self._canvas.unit_m
        parts = [
            geometry.dash_strokes(self._canvas.offset_line(name, 0.6), dash_m) for name in watched
        ]
        self._dash = np.concatenate([dash for _, dash in parts])
        self._road_of_dash = np.repeat(np.arange(len(parts)), [len(dash) for _, dash in parts])
        strokes = np.concatenate([cut for cut, _ in parts])
        colours = np.zeros((len(strokes), 2, 3), dtype=np.uint8)
        self._node = self._canvas.lines("/watched", strokes, colours, 0.8, height=0.01)

    def _update_labels(self, roads: Sequence[RoadView]) -> None:
        shown = {road.segment: road for road in roads}
        for name in [name for name in self._labels if name not in shown]:
            self._labels.pop(name).remove()
        for name, road in shown.items():
            speed = "" if road.speed_kmh is None else f", {road.speed_kmh:.0f} km/h"
            sign = labels.TRAFFIC_SIGN[road.traffic]
            text = f"{sign} {name[:40]}: {road.traffic}{speed}"
            if name not in self._labels:
                self._labels[name] = self._draw_label(name, text)
            elif self._labels[name].text != text:
                self._labels[name].text = text

    def _camera(self, segment: str) -> tuple[Array, Array]:
        """Place of the marker of a road's camera, and the road's direction there."""
        # Beside the middle of its road, outside the routes' lanes.
        return geometry.point_at(self._canvas.offset_line(segment, 1.9 + 0.5 * ROUTE_LANES), 0.5)

    def _draw_label(self, segment: str, text: str) -> viser.LabelHandle:
        place, ahead = self._camera(segment)
        node = f"/camera_{segment.encode().hex()}_label"
        # On the side away from the road: the right-hand side of an eastbound road is its south.
        if ahead[0] >= 0:
            return self._canvas.label(node, text, place, -1.0, "top-center")
        return self._canvas.label(node, text, place, 1.0, "bottom-center")


def _pattern(state: Traffic, dash: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Which dashes are coloured: all (stable), two of three (turbulent), or every other pair."""
    if state == "stable":
        return np.ones(len(dash), dtype=np.bool_)
    drawn: npt.NDArray[np.bool_] = dash % 6 < 4 if state == "turbulent" else dash % 4 < 2
    return drawn
