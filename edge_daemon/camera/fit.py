"""Fits the view of a road to points and lines: a plane or a `CurvedRoad`.

What a curved road has beyond a pinhole camera over a plane are its terms: the lens, an arc in plan,
a vertical curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.optimize import least_squares

from edge_daemon.camera.consensus import Inliers
from edge_daemon.camera.curved import CurvedRoad
from edge_daemon.camera.homography import Array, CalibrationError, Homography, Lines
from edge_daemon.camera.pose import CameraPose, pose_of
from edge_daemon.settings import Term

Projection = Homography | CurvedRoad

_BOUNDS: Final[dict[Term, float]] = {"lens": 0.14, "arc": 1.2, "crest": 0.2}
"""Of the distortion; of the turn and of the change of gradient over half the stretch."""
_FOCAL_OF_WIDTH: Final = (0.5, 0.8, 1.2, 2.0, 3.5, 6.0, 10.0, 18.0)
_TURNS: Final = (0.0, -0.12, 0.12, -0.35, 0.35, -0.8, 0.8)
_STARTS: Final = 2
_GOOD_COST: Final = 0.5  # of a point, in a robust fit
_ROUNDS: Final = 3
_MAX_CALLS: Final = 600
_CAMERA: Final = 7  # focal length, rotation, shift


@dataclass(frozen=True)
class Observations:
    """What is known of a view: points on the road and where they are seen, both (n, 2), and points
    on lines of known offset.
    """

    road_m: Array
    image_px: Array
    lines: Lines

    def only(self, used: Inliers) -> Observations:
        """With those points alone, and all lines."""
        return Observations(self.road_m[used], self.image_px[used], self.lines)


def fit_road(
    known: Observations,
    size: tuple[int, int],
    terms: Sequence[Term],
    near: Projection | None = None,
) -> Projection:
    """The least squares fit of a plane to four points or more, or with terms of a curved road.

    `near`, a fit to nearly the same observations with the same terms, is where it starts.

    Raises:
        CalibrationError: they fix none.
    """
    if not terms:
        return Homography(known.road_m, known.image_px, known.lines)
    frame = _Frame(known, size, tuple(terms))
    if isinstance(near, CurvedRoad):
        return frame.refined(frame.parameters(near))
    if near is not None and (pose := pose_of(near, size)) is not None:
        return frame.refined(frame.over_plane(pose))
    best: tuple[Array, float] | None = None
    for start in frame.starts():
        found = frame.robust(start)
        if best is None or found[1] < best[1]:
            best = found
        if best[1] < _GOOD_COST * len(known.road_m):
            break
    if best is None:
        raise CalibrationError("no camera sees these points so", "check the points for mistakes")
    return frame.refined(best[0])


def line_misses_px(projection: Projection, lines: Lines) -> Array:
    """How far each point of the lines lies from its line as projected, px, shape (m,)."""
    if not len(lines.image_px):
        return np.zeros(0)
    road = projection.to_road(lines.image_px)
    road[:, 1] = lines.offset_m
    step = np.array([0.05, 0.0])
    seen = projection.to_image(road)
    tangent = projection.to_image(road + step) - projection.to_image(road - step)
    length = np.hypot(tangent[:, 0], tangent[:, 1])
    off = seen - lines.image_px
    across = (off[:, 0] * tangent[:, 1] - off[:, 1] * tangent[:, 0]) / length
    return np.asarray(np.where(np.isfinite(across), np.abs(across), np.inf))


def parameter_count(terms: Sequence[Term]) -> int:
    """Free parameters of the model."""
    return _CAMERA + len(terms) if terms else 8


class _Frame:
    """Observations in units of half the stretch, and a curved road's parameters for them.

    Parameters are ln(focal length / width), rotation (3), shift (3) and one a term.
    """

    def __init__(self, known: Observations, size: tuple[int, int], terms: tuple[Term, ...]) -> None:
        low, high = known.road_m.min(axis=0), known.road_m.max(axis=0)
        self.origin_m = (low + high) / 2
        self.half_m = float(high[0] - low[0]) / 2
        if not self.half_m > 0 or not np.ptp(np.append(known.lines.offset_m, known.road_m[:, 1])):
            raise CalibrationError("all points lie on one line on the road", "spread the points")
        self.known, self.size, self.terms = known, size, terms
        self._stations = self._first_stations()

    def road(self, parameters: Array) -> CurvedRoad:
        """The road of some parameters."""
        term = dict(zip(self.terms, parameters[_CAMERA:].tolist(), strict=True))
        return CurvedRoad(
            self.origin_m,
            self.half_m,
            self.size,
            float(np.exp(np.clip(parameters[0], -5, 7))) * self.size[0],
            parameters[1:4],
            parameters[4:7] * self.half_m,
            term.get("lens", 0.0),
            term.get("arc", 0.0) / self.half_m,
            term.get("crest", 0.0) / self.half_m,
        )

    def parameters(self, road: CurvedRoad) -> Array:
        """The parameters of a road, moved to this frame where its own is another."""
        shift = road.origin_m - self.origin_m
        # Frames differ by what a point adds at an end: small, and the fit goes on from there.
        moved = road.shift_m - road.matrix @ np.append(shift, 0.0)
        term = {
            "lens": road.distortion,
            "arc": road.curvature_per_m * self.half_m,
            "crest": road.bend_per_m * self.half_m,
        }
        return np.concatenate(
            [
                [np.log(road.focal_px / self.size[0])],
                road.rotation,
                moved / self.half_m,
                [term[name] for name in self.terms],
            ]
        )

    def over_plane(self, pose: CameraPose) -> Array:
        """The parameters of the camera that sees the road as a plane."""
        matrix = pose.rotation
        shift = -matrix @ np.append(pose.foot_m - self.origin_m, pose.height_m)
        rotation = np.asarray(cv2.Rodrigues(matrix)[0]).ravel()
        focal = [np.log(pose.focal_px / self.size[0])]
        return np.concatenate([focal, rotation, shift / self.half_m, np.zeros(len(self.terms))])

    def _first_stations(self) -> Array:
        """Where the lines are met, for a start: across the road lies about in a row of pixels."""
        rows = self.known.image_px[:, 1]
        order = np.argsort(rows)
        at = self.known.lines.image_px[:, 1]
        inside = (at >= rows.min()) & (at <= rows.max())
        stations = np.interp(at, rows[order], self.known.road_m[order, 0])
        return np.where(inside, stations, np.nan)

    def starts(self) -> list[Array]:
        """Some cameras over flat roads that see the points roughly so, best first."""
        found = []
        middle = np.array(self.size) / 2
        met = np.isfinite(self._stations)
        lines = self.known.lines
        extra = np.column_stack([self._stations[met], lines.offset_m[met]])
        road = np.concatenate([self.known.road_m, extra])
        image = np.concatenate([self.known.image_px, lines.image_px[met]])
        for turn in _TURNS if "arc" in self.terms else (0.0,):
            for focal in _FOCAL_OF_WIDTH:
                start = np.zeros(_CAMERA + len(self.terms))
                start[0] = np.log(focal)
                if "arc" in self.terms:
                    start[_CAMERA + self.terms.index("arc")] = turn
                flat = self.road(start).surface(road)
                k = np.diag([focal * self.size[0], focal * self.size[0], 1.0])
                k[:2, 2] = middle
                try:
                    ok, rotation, shift = cv2.solvePnP(
                        flat, image, k, np.zeros(4), flags=cv2.SOLVEPNP_SQPNP
                    )
                except cv2.error:  # the points lie within too small a part of the picture
                    continue
                if not ok:
                    continue
                start[1:4], start[4:7] = rotation.ravel(), shift.ravel() / self.half_m
                if self.road(start).centre_m[2] <= 0:
                    continue
                found.append((float(np.sum(np.abs(self._misses(start)))), start))
        found.sort(key=lambda pair: pair[0])
        return [start for _, start in found[:_STARTS]]

    def robust(self, start: Array) -> tuple[Array, float]:
        """A fit that few wrong points do not bend, and its cost."""
        bounds = np.full(len(start), np.inf)
        bounds[_CAMERA:] = [_BOUNDS[term] for term in self.terms]
        fit = least_squares(
            self._misses, start, bounds=(-bounds, bounds), loss="cauchy", f_scale=1.0,
            x_scale="jac", max_nfev=15, ftol=1e-4, xtol=1e-5,
        )  # fmt: skip
        return np.asarray(fit.x), float(fit.cost)

    def refined(self, start: Array | tuple[Array, float]) -> CurvedRoad:
        """The least squares fit from a start; where lines are met is found again in between."""
        at = start[0] if isinstance(start, tuple) else start
        for _ in range(_ROUNDS if len(self.known.lines.image_px) else 1):
            if len(self.known.lines.image_px):
                self._stations = self.road(at).to_road(self.known.lines.image_px)[:, 0]
            if 2 * len(self.known.image_px) < len(at):
                raise CalibrationError("too few points for this road", "add points")
            at = np.asarray(
                least_squares(self._misses, at, method="lm", x_scale="jac", max_nfev=_MAX_CALLS).x
            )
        bounds = [_BOUNDS[term] for term in self.terms]
        road = self.road(at)
        if (np.abs(at[_CAMERA:]) > bounds).any() or not road.height_m > 0:
            raise CalibrationError("no such road fits the points", "check the points for mistakes")
        return road

    def _misses(self, parameters: Array) -> Array:
        road = self.road(parameters)
        off = np.nan_to_num(road.to_image(self.known.road_m) - self.known.image_px, nan=1e4)
        if not len(self._stations):
            return np.asarray(off.ravel())
        lines = self.known.lines
        met = np.isfinite(self._stations)
        places = np.column_stack([self._stations[met], lines.offset_m[met]])
        step = np.array([0.05, 0.0])
        tangent = road.to_image(places + step) - road.to_image(places - step)
        miss = road.to_image(places) - lines.image_px[met]
        across = miss[:, 0] * tangent[:, 1] - miss[:, 1] * tangent[:, 0]
        across = across / np.hypot(tangent[:, 0], tangent[:, 1])
        return np.concatenate([off.ravel(), np.nan_to_num(across, nan=1e4)])
