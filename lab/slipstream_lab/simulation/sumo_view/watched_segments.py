"""The stretches of edges that the RSU watches, and their calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slipstream.errors import InputError
from slipstream_lab.simulation.rsus import RsuSettings, RsuWatchSettings
from slipstream_lab.simulation.streetdrive import Point, SegmentText, calibration_text
from slipstream_lab.simulation.streetdrive.rendering import PinholeCamera
from slipstream_lab.simulation.sumo_view.lanes import Carriageway, LaneRoads
from slipstream_lab.simulation.sumo_view.polylines import Floats, at, distances
from slipstream_lab.simulation.sumo_view.pose import CameraSite

NEAR_M, FAR_M = 20.0, 80.0
_MIN_LENGTH_M = 10.0
_WORTH_WATCHING_M = 30.0
_EDGE_PX = 2.0


@dataclass(frozen=True)
class SegmentStretch:
    """A watched stretch of an edge, between two distances along it, and how many of its lanes,
    without those at the kerb.
    """

    segment_id: str
    way: Carriageway
    from_m: float
    to_m: float
    lanes: int

    @property
    def width_m(self) -> float:
        """Of the watched lanes."""
        widths = self.way.widths_m
        return sum(widths[-self.lanes :] if self.way.kerb_left else widths[: self.lanes])

    @property
    def left_m(self) -> float:
        """Of the watched lanes' left border, to the right of the carriageway's."""
        return self.way.width_m - self.width_m if self.way.kerb_left else 0.0

    def part(self, from_m: float, to_m: float, right_m: float) -> Floats:
        """A line at a distance to the right of the watched lanes' left border, between two driven
        distances.
        """
        return self.way.part(from_m, to_m, self.left_m + right_m)

    @property
    def polygon(self) -> Floats:
        """Outline in the net, m, (n, 2): along the left border, back along the right one."""
        left = self.part(self.from_m, self.to_m, 0.0)
        right = self.part(self.from_m, self.to_m, self.width_m)
        return np.concatenate([left, right[::-1]])

    @property
    def direction(self) -> Floats:
        """Unit vector (2,) from its beginning to its end."""
        middle = self.part(self.from_m, self.to_m, self.width_m / 2)
        way = middle[-1] - middle[0]
        return np.asarray(way / np.linalg.norm(way))


@dataclass(frozen=True)
class View:
    """A camera and its axes: which parts of the net it sees."""

    camera: PinholeCamera
    site: CameraSite

    def sees(self, points: Floats) -> NDArray[np.bool_]:
        """Which road points (n, 2) of the net lie in the picture."""
        return self.camera.sees(self.project(points), _EDGE_PX) & self._ahead(points)

    def project(self, points: Floats) -> Floats:
        """Pixels (n, 2) of road points (n, 2) of the net."""
        local = self.site.to_local(points)
        return self.camera.project(np.column_stack([local, np.zeros(len(local))]))[0]

    def _ahead(self, points: Floats) -> NDArray[np.bool_]:
        local = self.site.to_local(points)
        depth = self.camera.project(np.column_stack([local, np.zeros(len(local))]))[1]
        return np.asarray(depth > 0.5, dtype=np.bool_)


def choose_stretches(
    rsu: RsuSettings, roads: LaneRoads, view: View, source: Path
) -> tuple[SegmentStretch, ...]:
    """The stretches that the file names, or every edge along the view that is long in it.

    Raises:
        InputError: an unknown edge, one that is not in view, a stretch that leaves the picture, or
            nothing to watch.
    """
    if rsu.watch:
        return tuple(_named(watch, roads, view, source) for watch in rsu.watch)
    found = []
    for way in roads.carriageways:
        inside = _in_view(way, view, NEAR_M, FAR_M)
        if inside is None or inside[1] - inside[0] < _WORTH_WATCHING_M:
            continue
        stretch = SegmentStretch(way.edge, way, *inside, len(way.widths_m))
        heading = math.atan2(stretch.direction[1], stretch.direction[0])
        looks = view.site.axis_rad + view.camera.yaw_rad
        if abs(math.cos(heading - looks)) > 0.5:
            found.append(stretch)
    if not found:
        raise InputError(
            source, "no edge is in view 20 to 80 m away", "turn the camera to a road", key="view"
        )
    return tuple(found)


def _named(watch: RsuWatchSettings, roads: LaneRoads, view: View, source: Path) -> SegmentStretch:
    key = f"watch.{watch.edge}"
    way = roads.find(watch.edge)
    if way is None:
        known = watch.edge in roads.edges
        problem = "not near the mast, or without lanes" if known else "no such edge in the net"
        raise InputError(source, problem, "give an edge in view", key=key)
    lanes = len(way.widths_m) - watch.from_lane
    if lanes < 1:
        problem = f"it has no lane {watch.from_lane}"
        raise InputError(source, problem, "lanes count from 0 at the kerb", key=key)
    low, high = watch.from_m, watch.to_m
    for value in (low, high):
        if value is not None and value > way.length_m + 0.01:
            raise InputError(
                source, f"{value:g} m is beyond its {way.length_m:.1f} m", "mend it", key=key
            )
    given = low is not None and high is not None
    inside = _in_view(way, view, 0.0 if given else NEAR_M, math.inf if given else FAR_M)
    if inside is None:
        raise InputError(source, "the edge is not in view", "turn the camera to it", key=key)
    start, end = low if low is not None else inside[0], high if high is not None else inside[1]
    seen = _in_view(way, view, 0.0, math.inf) or inside
    if start < seen[0] - 1.0 or end > seen[1] + 1.0 or end - start < _MIN_LENGTH_M:
        raise InputError(
            source,
            f"{start:.0f} to {end:.0f} m cannot be watched",
            f"give {_MIN_LENGTH_M:g} m or more "
            f"between {math.ceil(seen[0])} and {math.floor(seen[1])} m",
            key=key,
        )
    return SegmentStretch(watch.id or watch.edge, way, start, end, lanes)


def _in_view(
    way: Carriageway, view: View, near_m: float, far_m: float
) -> tuple[float, float] | None:
    """The longest stretch in view at distances from the mast's foot, whole metres, or None."""
    along = np.arange(0.0, math.floor(way.length_m) + 1.0)
    if len(along) < 2:
        return None
    visible = np.ones(len(along), dtype=np.bool_)
    for right_m in (0.0, way.width_m):
        line = way.part(0.0, way.length_m, right_m)
        points = _every(line, along / way.length_m)
        away = np.linalg.norm(view.site.to_local(points), axis=1)
        visible &= view.sees(points) & (away >= near_m) & (away <= far_m)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], visible.astype(np.int8), [0]])))
    if not len(edges):
        return None
    runs = edges.reshape(-1, 2)
    start, end = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return (float(along[start]), float(along[end - 1])) if end - start > 1 else None


def _every(line: Floats, shares: Floats) -> Floats:
    return at(line, shares * float(distances(line)[-1]))


def _correspondences(
    stretches: tuple[SegmentStretch, ...], view: View
) -> list[tuple[Point, Point]]:
    """Pairs of (pixel, road point), on both borders of each stretch, denser where it is near."""
    pairs: dict[Point, Point] = {}
    for stretch in stretches:
        length = stretch.to_m - stretch.from_m
        middle = view.site.to_local(stretch.part(stretch.from_m, stretch.to_m, 0.0))
        coming = np.linalg.norm(middle[0]) > np.linalg.norm(middle[-1])
        shares = (np.geomspace(1.0, 4.0, 6) - 1.0) / 3.0
        for share in (1.0 - shares) if coming else shares:
            for right_m in (0.0, stretch.width_m):
                along = stretch.from_m + share * length
                part = stretch.part(min(along, stretch.to_m - 0.02), stretch.to_m, right_m)
                x, y = (round(float(v), 2) for v in part[0])
                u, v = view.project(np.array([[x, y]]))[0]
                pairs[(x, y)] = (float(u), float(v))
    return [(pixel, road) for road, pixel in pairs.items()]


def camera_text(name: str, stretches: tuple[SegmentStretch, ...], view: View) -> str:
    """The content of camera.toml; the road plane has the net's coordinates."""
    segments = [
        SegmentText(
            stretch.segment_id,
            [(float(x), float(y)) for x, y in stretch.polygon],
            ", ".join(f"{part:.6f}" for part in stretch.direction),
            stretch.lanes,
            stretch.width_m / stretch.lanes,
        )
        for stretch in stretches
    ]
    pairs = _correspondences(stretches, view)
    return calibration_text("a camera in a SUMO net", name, view.camera, pairs, segments)
