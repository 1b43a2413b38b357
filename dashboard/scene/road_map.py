"""The map: all roads, the watched ones by their traffic, depots, cameras and the fleet.

Each layer is one scene node; of an update only the arrays that changed are sent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt
import viser

from dashboard.scene import geometry, shapes
from dashboard.scene.canvas import FOV_RAD, Batch, Canvas
from dashboard.scene.fleet import LANE_UNITS, FleetLayer, Placed
from dashboard.scene.geometry import Array
from dashboard.scene.marks import Mark
from dashboard.view import labels
from dashboard.view.build import DashboardView
from dashboard.view.labels import Rgb, Traffic
from dashboard.view.model import RoadView, RsuView
from slipstream.roads import RoadNetwork

MAX_DASHES: Final = 3600
"""Dashes of all watched roads, about; with more roads they are longer."""
_BAND_UNITS: Final = 0.85
_CAMERA_UNITS: Final = 3.2
"""Offset of a camera's pole to the right of its road, in units: outside the routes' lanes."""
POLE_UNITS: Final = 2.0
_ROAD_RGB: Final[Rgb] = (203, 209, 217)
_GAP_RGB: Final[dict[Traffic, Rgb]] = {
    "stable": (0, 158, 115),
    "turbulent": (252, 228, 210),
    "unknown": (228, 231, 235),
}
_DARK: Final[Rgb] = (29, 39, 51)


@dataclass(frozen=True)
class Drawn:
    """What the map shows at one moment, for labels and clicks."""

    marks: tuple[Mark, ...]
    placed: Placed
    view: DashboardView


class RoadMap:
    """Draws a network, its traffic and its fleet, and updates them."""

    def __init__(
        self,
        server: viser.ViserServer,
        network: RoadNetwork,
        depots: Sequence[str],
    ) -> None:
        self._server = server
        self._network = network
        self._names = tuple(network.segments)
        self.canvas = Canvas(network)
        self.fleet = FleetLayer(server.scene, self.canvas, depots)
        self._watched: tuple[str, ...] = ()
        self._traffic: tuple[Traffic, ...] = ()
        self._dashes = Batch(server.scene, "/watched", shapes.QUAD, "toon3")
        self._poles = Batch(server.scene, "/rsus", shapes.POLE)
        self._strokes: Array = np.empty((0, 2, 2))
        self._dash: npt.NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._road_of_dash: npt.NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._middle = cache(self._road_middle)
        self._stands: dict[tuple[str, ...], tuple[Array, float] | None] = {}
        self._prepare_scene()
        self._draw_roads()
        self._fixed = tuple(self._draw_depots(depots))

    def update(self, view: DashboardView) -> Drawn:
        """Show a view."""
        roads = [road for road in view.roads if road.segment in self._network.segments]
        calm = {road.segment for road in roads if road.traffic == "stable"}
        with self._server.atomic():
            self._update_watched(roads)
            cameras = self._update_rsus(view.rsus)
            placed, marks = self.fleet.update(view.vehicles, calm)
        return Drawn(
            (*self._fixed, *cameras, *marks, *(self._road_mark(road) for road in roads)),
            placed,
            view,
        )

    def line(self, segment: str) -> Array | None:
        """The middle of a road's band, (N, 2), m; None if this network lacks the road."""
        if segment not in self._network.segments:
            return None
        return self.canvas.offset_line(segment, LANE_UNITS)

    def road_at(self, place_m: Array) -> tuple[str, float]:
        """The road nearest to a place, and how far away its middle is, m."""
        stroke, away_m = geometry.nearest_stroke(self._all_strokes, place_m)
        return self._names[self._road_of_stroke[stroke]], away_m

    def stand(self, segments: tuple[str, ...]) -> tuple[Array, float] | None:
        """Place of an RSU's pole, m, and where its camera looks, rad from the east.

        It stands beside the middle of its road; of several roads, of the one nearest to them all.
        None if this network has none of the roads.
        """
        if segments not in self._stands:
            known = [name for name in segments if name in self._network.segments]
            self._stands[segments] = self._find_stand(known) if known else None
        return self._stands[segments]

    def _find_stand(self, known: Sequence[str]) -> tuple[Array, float]:
        lines = [self.canvas.offset_line(name, _CAMERA_UNITS) for name in known]
        ends = [geometry.point_at(line, 0.5) for line in lines]
        middles = np.array([place for place, _ in ends])
        nearest = int(np.argmin(np.linalg.norm(middles - middles.mean(axis=0), axis=1)))
        place, ahead = ends[nearest]
        # To its road, and some way along it.
        return place, math.atan2(ahead[1], ahead[0]) + math.radians(120)

    def _prepare_scene(self) -> None:
        scene = self._server.scene
        scene.world_axes.visible = False
        scene.set_up_direction("+z")
        # viser's own lights cast shadows from a picture of the sky: in software each frame took
        # seconds.
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        # Together they show what faces upwards in about its own colour (π would be its own in full,
        # before the browser's tone mapping), and sides darker.
        scene.add_light_ambient("/ambient", intensity=1.85)
        scene.add_light_directional("/sun", intensity=0.85, position=(-0.45, -0.7, 1.0))
        camera = self._server.initial_camera
        camera.up = (0.0, 0.0, 1.0)
        camera.near, camera.far, camera.fov = 0.02, 1000.0, FOV_RAD
        camera.position, camera.look_at = self.canvas.fit(900, 900)

    def _draw_roads(self) -> None:
        # Each direction on its own side, so that a two-way road shows both.
        lines = [self.canvas.offset_line(name, LANE_UNITS) for name in self._names]
        bands = [geometry.ribbon(line, _BAND_UNITS * self.canvas.unit_m) for line in lines]
        first = np.cumsum([0, *(len(corners) for corners, _ in bands)])
        faces = [own + start for (_, own), start in zip(bands, first[:-1], strict=True)]
        corners = np.concatenate([corners for corners, _ in bands])
        self.canvas.area(self._server.scene, "/roads", corners, np.concatenate(faces), _ROAD_RGB)
        self._all_strokes = np.concatenate([geometry.strokes(line) for line in lines])
        self._road_of_stroke = np.repeat(np.arange(len(lines)), [len(line) - 1 for line in lines])

    def _draw_depots(self, depots: Sequence[str]) -> list[Mark]:
        junctions = self._network.junctions
        known = [node for node in depots if node in junctions]
        places = np.array([junctions[node] for node in known]).reshape(-1, 2)
        batch = Batch(self._server.scene, "/depots", shapes.DEPOT)
        batch.show(self.canvas.bodies(places, np.zeros(len(places)), _DARK, 2.4))
        tops = self.canvas.positions(places, 2.0)
        return [
            Mark("depot", node, "Depot", (float(x), float(y), float(z)))
            for node, (x, y, z) in zip(known, tops, strict=True)
        ]

    def _update_watched(self, roads: Sequence[RoadView]) -> None:
        watched = tuple(road.segment for road in roads)
        traffic = tuple(road.traffic for road in roads)
        if (watched, traffic) == (self._watched, self._traffic):
            return
        if watched != self._watched:
            self._cut_dashes(watched)
        self._watched, self._traffic = watched, traffic
        rgb = np.empty((len(self._dash), 3), dtype=np.int64)
        state_of_dash = np.array(traffic)[self._road_of_dash] if roads else np.empty(0, dtype=str)
        for state in sorted(set(traffic)):
            mine = state_of_dash == state
            drawn = _pattern(state, self._dash[mine])
            rgb[mine] = np.where(drawn[:, None], labels.TRAFFIC_RGB[state], _GAP_RGB[state])
        self._dashes.show(self.canvas.strips(self._strokes, rgb, _BAND_UNITS, 0.03))

    def _cut_dashes(self, watched: Sequence[str]) -> None:
        segments = self._network.segments
        total_m = sum(segments[name].length_m for name in watched)
        dash_m = max(0.8 * self.canvas.unit_m, total_m / MAX_DASHES)
        parts = [
            geometry.dash_strokes(self.canvas.offset_line(name, LANE_UNITS), dash_m)
            for name in watched
        ]
        self._strokes = np.concatenate([cut for cut, _ in parts] or [np.empty((0, 2, 2))])
        self._dash = np.concatenate([dash for _, dash in parts] or [np.empty(0, dtype=np.int64)])
        self._road_of_dash = np.repeat(np.arange(len(parts)), [len(dash) for _, dash in parts])

    def _update_rsus(self, rsus: Sequence[RsuView]) -> list[Mark]:
        stands = ((rsu, self.stand(rsu.health.segments)) for rsu in rsus)
        here = [(rsu, stand) for rsu, stand in stands if stand is not None]
        places = np.array([place for _, (place, _) in here]).reshape(-1, 2)
        headings = np.array([heading for _, (_, heading) in here])
        rgb = [_DARK if rsu.level == "ok" else labels.LEVEL_RGB[rsu.level] for rsu, _ in here]
        colours = np.array(rgb).reshape(-1, 3)
        self._poles.show(self.canvas.bodies(places, headings, colours, POLE_UNITS))
        tops = self.canvas.positions(places, 1.3 * POLE_UNITS)
        return [
            Mark("rsu", rsu.rsu, _rsu_text(rsu), (float(x), float(y), float(z)), rsu.level == "bad")
            for (rsu, _), (x, y, z) in zip(here, tops, strict=True)
        ]

    def _road_mark(self, road: RoadView) -> Mark:
        speed = "" if road.speed_kmh is None else f", {road.speed_kmh:.0f} km/h"
        sign = labels.TRAFFIC_SIGN[road.traffic]
        text = f"{sign} {road.segment[:40]}: {road.traffic}{speed}"
        return Mark("road", road.segment, text, self._middle(road.segment))

    def _road_middle(self, segment: str) -> tuple[float, float, float]:
        place, _ = geometry.point_at(self.canvas.offset_line(segment, LANE_UNITS), 0.5)
        x, y, z = self.canvas.positions(place[None], 0.1)[0]
        return float(x), float(y), float(z)


def _rsu_text(rsu: RsuView) -> str:
    return rsu.rsu[:40] if rsu.level == "ok" else f"{rsu.rsu[:40]}: {rsu.status}"


def _pattern(state: Traffic, dash: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Which dashes are coloured: all (stable), two of three (turbulent), or every other one."""
    if state == "stable":
        return np.ones(len(dash), dtype=np.bool_)
    drawn: npt.NDArray[np.bool_] = dash % 3 < 2 if state == "turbulent" else dash % 2 < 1
    return drawn
