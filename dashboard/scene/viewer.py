"""What one browser alone sees of the scene: labels that fit, and its selection."""

from __future__ import annotations

import threading
import time
from typing import Final

import numpy as np
import viser
import viser.transforms

from dashboard.scene import geometry, labelling, shapes
from dashboard.scene.canvas import FOV_RAD, TILT_RAD, Batch
from dashboard.scene.fleet import LANE_UNITS, VEHICLE_UNITS
from dashboard.scene.geometry import Array
from dashboard.scene.marks import Eye, Mark, at_pixel
from dashboard.scene.road_map import POLE_UNITS, Drawn, RoadMap
from dashboard.selection import Selection
from dashboard.view.labels import Rgb

MAX_CANVAS_PX: Final = 65536
"""Sides of a canvas that a camera is fitted to, px; larger ones are no browser's."""
LABEL_PERIOD_S: Final = 0.2
"""Shortest time between two choices of labels while the camera moves, s."""
ROAD_PICK_PX: Final = 10.0
"""How far beside a road a click still selects it, px."""
_CAMERA_PITCH_RAD: Final = 0.35
_SELECTED_RGB: Final[Rgb] = (255, 196, 0)


class Viewer:
    """The labels and the selection of one browser."""

    def __init__(self, client: viser.ClientHandle, road_map: RoadMap) -> None:
        self._client = client
        self._map = road_map
        self._lock = threading.Lock()
        self._drawn: Drawn | None = None
        self._labels: dict[tuple[str, str], viser.LabelHandle] = {}
        self._texts: dict[tuple[str, str], tuple[str, tuple[float, float, float]]] = {}
        self._spare: list[viser.LabelHandle] = []
        self._labels_made = 0
        self._labelled_s = 0.0
        scene = client.scene
        self._ring = Batch(scene, "/selected", shapes.RING, "toon3")
        self._cone: tuple[tuple[str, ...], viser.CameraFrustumHandle] | None = None
        self._route = Batch(scene, "/selected_route", shapes.QUAD, "toon3")
        self.selection: Selection | None = None

    def eye(self) -> Eye | None:
        """The browser's camera; None before it has one that can be used."""
        camera = self._client.camera
        width, height, fov = camera.image_width, camera.image_height, camera.fov
        turn: Array = viser.transforms.SO3(np.asarray(camera.wxyz)).as_matrix().astype(np.float64)
        usable = 0 < width <= MAX_CANVAS_PX and 0 < height <= MAX_CANVAS_PX and 0.01 < fov < 3.1
        if not usable or not np.isfinite(camera.position).all() or not np.isfinite(turn).all():
            return None
        return Eye(np.asarray(camera.position), turn, fov, width, height)

    def show(self, drawn: Drawn) -> None:
        """Follow an update of the map."""
        with self._lock:
            self._drawn = drawn
            self._follow()

    def camera_moved(self) -> None:
        """Choose labels anew, at a limited rate."""
        if time.monotonic() - self._labelled_s < LABEL_PERIOD_S:
            # The next update of the map does it.
            return
        with self._lock:
            self._follow()

    def select(self, selection: Selection | None) -> None:
        """Mark something; unknown names are marked as soon as they are there."""
        with self._lock:
            self.selection = selection
            self._follow()

    def pick(self, pixel: Array) -> Selection | None:
        """The vehicle, the camera or the road at a pixel of the canvas."""
        eye, drawn = self.eye(), self._drawn
        if eye is None or drawn is None:
            return None
        mark = at_pixel(eye, drawn.marks, pixel)
        if mark is not None and mark.kind in ("van", "rsu"):
            return Selection("van" if mark.kind == "van" else "rsu", mark.id)
        middle = np.array([eye.width_px / 2, eye.height_px / 2])
        ray = eye.turn @ np.append((pixel - middle) / eye.focal_px, 1.0)
        if ray[2] >= -1e-6:
            return None
        depth = -eye.position[2] / ray[2]
        place_m = self._map.canvas.places_m((eye.position + depth * ray)[None])[0]
        road, away_m = self._map.road_at(place_m)
        away_px = away_m * self._map.canvas.scale * eye.focal_px / depth
        reach = max(ROAD_PICK_PX, LANE_UNITS * self._map.canvas.unit * eye.focal_px / depth)
        return Selection("road", road) if away_px <= reach else None

    def fit(self, tilt: float = TILT_RAD) -> None:
        """Show the whole map."""
        eye = self.eye()
        if eye is not None:
            position, look_at = self._map.canvas.fit(eye.width_px, eye.height_px, tilt)
            self._look(position, look_at)

    def go_to_selection(self) -> bool:
        """Look at what is selected from near by; False if it is not on the map."""
        mark = self._selected_mark()
        if mark is not None:
            look_at = np.array(mark.position) * (1, 1, 0)
            away = np.array([0.0, -np.cos(TILT_RAD), np.sin(TILT_RAD)])
            self._look(look_at + away * 45 * self._map.canvas.unit, look_at)
        return mark is not None

    def _look(self, position: Array, look_at: Array) -> None:
        with self._client.atomic():
            camera = self._client.camera
            camera.up_direction = (0.0, 0.0, 1.0)
            camera.position = position
            camera.look_at = look_at
            camera.fov = FOV_RAD

    def _selected_mark(self) -> Mark | None:
        selected, drawn = self.selection, self._drawn
        if selected is None or drawn is None:
            return None
        for mark in drawn.marks:
            if (mark.kind, mark.id) == (selected.kind, selected.id):
                return mark
        return None

    def _follow(self) -> None:
        drawn, eye = self._drawn, self.eye()
        if drawn is None or eye is None:
            return
        self._labelled_s = time.monotonic()
        with self._client.atomic():
            self._show_labels(eye, drawn)
            self._show_selection(drawn)

    def _show_labels(self, eye: Eye, drawn: Drawn) -> None:
        chosen = labelling.fitting(eye, drawn.marks, self._selected_mark(), self._labels.keys())
        wanted = {(mark.kind, mark.id): mark for mark in chosen}
        for key in [key for key in self._labels if key not in wanted]:
            label = self._labels.pop(key)
            label.visible = False
            del self._texts[key]
            self._spare.append(label)
        for key, mark in wanted.items():
            now = (mark.text, mark.position)
            if self._texts.get(key) == now:
                continue
            self._texts[key] = now
            label = self._labels.get(key) or self._new_label()
            self._labels[key] = label
            if label.text != mark.text:
                label.text = mark.text
            label.position = mark.position
            if not label.visible:
                label.visible = True

    def _new_label(self) -> viser.LabelHandle:
        if self._spare:
            return self._spare.pop()
        self._labels_made += 1
        return self._client.scene.add_label(
            f"/labels/{self._labels_made}", "", anchor="bottom-center"
        )

    def _show_selection(self, drawn: Drawn) -> None:
        canvas, selected, mark = self._map.canvas, self.selection, self._selected_mark()
        places, strokes, rgb = np.empty((0, 2)), np.empty((0, 2, 2)), np.empty((0, 3), int)
        if selected is not None and mark is not None and selected.kind != "road":
            places = canvas.places_m(np.array([mark.position]))
        if selected is not None and selected.kind == "van":
            van = next((van for van in drawn.view.vehicles if van.vehicle == selected.id), None)
            if van is not None and van.route:
                strokes = self._map.fleet.route_strokes(van)
                rgb = np.tile(np.array(van.rgb), (len(strokes), 1))
        if selected is not None and selected.kind == "road":
            line = self._map.line(selected.id)
            strokes = np.empty((0, 2, 2)) if line is None else geometry.strokes(line)
            rgb = np.tile(np.array(_SELECTED_RGB), (len(strokes), 1))
        rsu = None
        if selected is not None and selected.kind == "rsu":
            rsu = next((rsu for rsu in drawn.view.rsus if rsu.rsu == selected.id), None)
        self._show_cone(rsu.health.segments if rsu is not None else ())
        self._ring.show(
            canvas.bodies(places, np.zeros(len(places)), _SELECTED_RGB, 0.9 * VEHICLE_UNITS, 0.25)
        )
        width, height = (0.5, 0.3) if selected and selected.kind == "van" else (1.6, -0.02)
        self._route.show(canvas.strips(strokes, rgb, width, height))

    def _show_cone(self, segments: tuple[str, ...]) -> None:
        """What the camera that watches these roads sees, roughly; nothing without roads."""
        if self._cone is not None:
            if self._cone[0] == segments:
                return
            self._cone[1].remove()
            self._cone = None
        stand = self._map.stand(segments) if segments else None
        if stand is None:
            return
        place_m, heading = stand
        canvas = self._map.canvas
        flat = np.array([np.cos(heading), np.sin(heading), 0.0])
        ahead = np.cos(_CAMERA_PITCH_RAD) * flat - np.sin(_CAMERA_PITCH_RAD) * np.array([0, 0, 1.0])
        right = np.cross(flat, np.array([0, 0, 1.0]))
        turn = viser.transforms.SO3.from_matrix(
            np.column_stack((right, np.cross(ahead, right), ahead))
        )
        cone = self._client.scene.add_camera_frustum(
            "/selected_view",
            fov=0.7,
            aspect=16 / 9,
            scale=6 * canvas.unit,
            thickness=0.12 * canvas.unit,
            color=_SELECTED_RGB,
            variant="filled",
            wxyz=turn.wxyz,
            position=canvas.positions(place_m[None], POLE_UNITS)[0],
            cast_shadow=False,
            receive_shadow=False,
        )
        self._cone = segments, cone
