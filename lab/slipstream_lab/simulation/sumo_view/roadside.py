"""Chooses where buildings, trees and lamp posts stand: off the roads and not before them."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from slipstream_lab.simulation.rsus import SceneSettings
from slipstream_lab.simulation.streetdrive.rendering import RoadsideObject
from slipstream_lab.simulation.sumo_view.ground import PAVEMENT_M, SHOULDER_M
from slipstream_lab.simulation.sumo_view.lanes import Carriageway, LaneRoads
from slipstream_lab.simulation.sumo_view.polylines import Floats, at, distances, shifted
from slipstream_lab.simulation.sumo_view.pose import CameraSite

_CELL_M = 0.5
_BACK_M, _AHEAD_M, _ASIDE_M = 80.0, 400.0, 200.0
_BLOCK_M = (26.0, 20.0)
"""Largest footprint of a building along and across the road."""
_SEEN_M, _THIN_M = 240.0, 110.0
"""Up to where things, and thin things, must not hide a road."""


class RoadsidePlan:
    """A map of the roads around the camera: what is free, and what would be hidden."""

    def __init__(self, roads: LaneRoads, site: CameraSite) -> None:
        rows, columns = round(2 * _ASIDE_M / _CELL_M), round((_BACK_M + _AHEAD_M) / _CELL_M)
        taken = np.zeros((rows, columns), dtype=np.uint8)
        outlines = [site.to_local(outline) for outline in roads.junctions]
        for way in roads.carriageways:
            kerb = way.beside_kerb(0.0, SHOULDER_M + max(PAVEMENT_M, way.walk_m))
            left, right = min(-SHOULDER_M, *kerb), max(way.width_m + SHOULDER_M, *kerb)
            borders = shifted(way.left, -left), shifted(way.left, -right)[::-1]
            outlines.append(site.to_local(np.concatenate(borders)))
        for outline in outlines:
            cells = np.rint((outline + np.array([_BACK_M, _ASIDE_M])) / _CELL_M).astype(np.int32)
            cv2.fillPoly(taken, [cells], (1,))
        self._taken: NDArray[np.bool_] = taken.astype(np.bool_)
        self._clear = cv2.distanceTransform(1 - taken, cv2.DIST_L2, 5) * _CELL_M

    def clearance_m(self, points: Floats) -> Floats:
        """Distance of points (n, 2) from the nearest road, 0 outside the map."""
        row, column, inside = self._cells(points)
        return np.where(inside, self._clear[row, column], 0.0)

    def occludes_road(self, points: Floats, within_m: float) -> bool:
        """Whether a thing with these corners (n, 2) stands, as the camera sees it, before a road
        that is nearer than a distance.
        """
        bearings = np.arctan2(points[:, 1], points[:, 0])
        nearest = float(np.linalg.norm(points, axis=1).min())
        rays = np.linspace(bearings.min(), bearings.max(), 9)
        reach = np.arange(nearest, max(within_m, nearest + 2.0), 2.0)
        beyond = np.stack(
            [np.outer(np.cos(rays), reach).ravel(), np.outer(np.sin(rays), reach).ravel()], axis=1
        )
        row, column, inside = self._cells(beyond)
        return bool((self._taken[row, column] & inside).any())

    def _cells(
        self, points: Floats
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        column = np.floor((points[:, 0] + _BACK_M) / _CELL_M).astype(np.int64)
        row = np.floor((points[:, 1] + _ASIDE_M) / _CELL_M).astype(np.int64)
        rows, columns = self._taken.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1), inside


def choose_objects(
    plan: RoadsidePlan,
    roads: LaneRoads,
    site: CameraSite,
    scene: SceneSettings,
    rng: np.random.Generator,
) -> list[RoadsideObject]:
    """Things in the painter's form, in the site's axes."""
    things: list[RoadsideObject] = []
    for kind, mean, tries, spread_m in (
        ("building", scene.buildings, 40, 60.0),
        ("tree", scene.trees, 25, 25.0),
    ):
        wanted = int(rng.poisson(mean))
        for _ in range(wanted * tries):
            if wanted == 0:
                break
            # Even in distance from the camera, which leaves fewer where the picture is small.
            spot = np.array([rng.uniform(25, 330), rng.uniform(-spread_m, spread_m)])
            spot[1] += math.copysign(8.0, spot[1])
            if _is_clear(plan, kind, spot):
                things.append((float(spot[0]), kind, float(spot[1])))
                wanted -= 1
    for way in roads.carriageways:
        things += [
            (float(x), "lamp", float(y))
            for x, y in _lamp_spots(way, site, scene.lamp_spacing_m, rng)
            if 15.0 < x < 300.0 and not plan.occludes_road(np.array([[x, y]]), _THIN_M)
        ]
    return things


def tree_shadow_feet(plan: RoadsidePlan, count: int, rng: np.random.Generator) -> list[Floats]:
    """Where trees beside the roads stand that only throw shadows into the picture."""
    spots = np.column_stack([rng.uniform(12, 110, 400), rng.uniform(-40, 40, 400)])
    clear = plan.clearance_m(spots)
    return list(spots[(clear > 1.0) & (clear < 6.0)][:count])


def _is_clear(plan: RoadsidePlan, kind: str, spot: Floats) -> bool:
    if kind == "tree":
        corners = spot + np.array([[-3.2, -3.2], [3.2, -3.2], [3.2, 3.2], [-3.2, 3.2]])
        return 3.4 < float(plan.clearance_m(spot[None])[0]) < 14.0 and not plan.occludes_road(
            corners, _SEEN_M
        )
    long, deep = _BLOCK_M
    side = 1.0 if spot[1] > 0 else -1.0
    corners = spot + np.array([[0, 0], [long, 0], [long, side * deep], [0, side * deep]])
    inner = spot + np.array([[a * long, side * b * deep] for a in (0.3, 0.7) for b in (0.3, 0.7)])
    clear = plan.clearance_m(np.concatenate([corners, inner]))
    return float(clear.min()) > 3.0 and not plan.occludes_road(corners, _SEEN_M)


def _lamp_spots(
    way: Carriageway, site: CameraSite, spacing_m: float, rng: np.random.Generator
) -> Floats:
    lamp_m = SHOULDER_M + PAVEMENT_M + 0.3
    line = shifted(way.left, -way.beside_kerb(lamp_m, lamp_m)[0])
    length = float(distances(line)[-1])
    spots = np.arange(float(rng.uniform(5, spacing_m)), length - 5.0, spacing_m)
    return site.to_local(at(line, spots)) if len(spots) else np.zeros((0, 2))
